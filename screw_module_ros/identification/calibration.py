# SPDX-License-Identifier: Apache-2.0
"""Writes the files of a module from the results: its calibration and its gain limits.

Controller and amplifier load the calibration. The gain limits of a linear model stand beside the
impedance that the handle delivers; `delivered_impedance` writes them.
"""

from __future__ import annotations

import math
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import yaml

from ..calibration import gain_limits
from ..calibration.gain_limits import LOADS, Loop, conditions_of
from ..calibration.limits_file import text_checksum
from ..calibration.module import ModuleCalibration, SensorBias, write_calibration
from ..calibration.version import fits, law_version
from ..control.law import Law
from ..control.laws import margin_of, modes_of_gains
from ..control.laws.thesis import THESIS as THESIS_LAW
from ..control.vertical_settings import VerticalSettings
from ..files import replace
from ..settings import Field, Setting, fields
from ..software import version
from . import friction_model, gravity, inertia, stability, static_torque, torque_response
from .force_metric import apparent_mass
from .lab import Lab, MissingResult
from .results import NOTHING, Experiment, Quantity, Result, no_figures
from .trials import RELEASE

NAME = "calibration"
FILE = "module_calibration.yaml"


class Settings(NamedTuple):
    """Identity of the module."""

    serial: Annotated[str, Setting("serial number of the module")] = "SIM-0001"


def run(lab: Lab, settings: Settings) -> Result:
    """Write the file into the lab's folder.

    Raises MissingResult without one of the results, SettingError for implausible values.
    """
    friction = lab.result(friction_model.NAME)
    torque = lab.result(static_torque.NAME)
    weight = lab.result(gravity.NAME).quantity("gravity")
    mass = lab.result(inertia.NAME).quantity("mass")
    delay = lab.result(torque_response.NAME).quantity("loop_delay")
    residuals = {
        "friction_rms_N": friction.value("rms"),
        "friction_within_2N": friction.value("within"),
        "linearization_correlation": torque.value("correlation"),
        "linearization_left_N": torque.value("largest_at_handle"),
        "gravity_sd_N": weight.uncertainty,
        "mass_sd_kg": mass.uncertainty,
    }
    path, zero = lab.folder / FILE, lab.stand.zero()
    write_calibration(
        path,
        ModuleCalibration(
            serial=own_serial(lab, settings.serial),
            date=date_now(),
            software=version(),
            friction=friction_model.friction_model_of(friction),
            linearization=static_torque.linearization_of(torque),
            gravity_N=weight.value,
            mass_kg=mass.value,
            sensor_bias=SensorBias(zero[:3], zero[3:]),
            residuals=residuals,
            delay_s=delay.value,
            drive_delay_s=delay.value - lab.result(torque_response.NAME).value("delay"),
        ),
    )
    quantities = (
        Quantity("gravity", weight.value, weight.uncertainty, "N", "weight the controller carries"),
        Quantity("mass", mass.value, mass.uncertainty, "kg", "mass that moves with the handle"),
        Quantity("delay", delay.value, delay.uncertainty, "s", "from a sample to its force"),
    )
    return Result(NAME, quantities, settings._asdict(), (f"written: {path.name}",))


EXPERIMENT = Experiment(
    NAME, "writes the module's calibration file, which controller and amplifier load, from results",
    Settings, run, no_figures, NOTHING,
    ("static_torque", "torque_response", "gravity", "friction_model", "inertia"),
)  # fmt: skip


# The gain limits -----------------------------------------------------------------------

GAIN_LIMITS = "module_gain_limits.yaml"
_SIMULATED = "SIM-"  # how the serial numbers of simulated modules begin


def write_gain_limits(lab: Lab, result: Result, serial: str) -> None:
    """Write the file into the lab's folder, with gains if `stability` has a result.

    result: of `delivered_impedance`; serial: of the module. The checksum covers the text before
    it. Raises OSError.
    """
    content: dict[str, Any] = {
        "format": gain_limits.FORMAT,
        "version": gain_limits.VERSION,
        "serial": serial,
        "date": date_now(),
        "software": version(),
        "bench": lab.stand.name,
        "asked_for": {"stiffness_N_m": result.settings["stiffness"]},
        "delivered": {q.name: _delivered(q) for q in result.quantities} | _over_frequency(result),
    }
    content["laws"] = _laws(lab)
    write_sealed(lab.folder / GAIN_LIMITS, content)


def write_sealed(path: Path, content: dict[str, Any]) -> None:
    """Write a file of gain limits with the checksum of its text at the end. Raises OSError."""
    text = _as_yaml(content)
    replace(path, text + _as_yaml({"sha256": text_checksum(text)}))


def date_now() -> str:
    """Return the present date as such files have it, in UTC."""
    return datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")


def own_serial(lab: Lab, serial: str) -> str:
    """Return the serial number for a file about the module on the lab's stand.

    Raises ValueError for a simulated module's number on hardware, and for another one than the
    controller has.
    """
    if lab.stand.serial not in ("", serial):
        raise ValueError(
            f"serial: {serial} is not the module_serial of impedance_controller: name "
            f"{lab.stand.serial}, or start the controller with the number of the module"
        )
    if RELEASE not in lab.stand.offers and serial.startswith(_SIMULATED):
        raise ValueError(
            f"serial: {serial} is a simulated module's: name that of this one, with settings such "
            "as {serial: ARM-0007}"
        )
    return serial


def _delivered(q: Quantity) -> dict[str, Any]:
    found = {"value": round(q.value, 6), "unit": q.unit, "what": q.text}
    if math.isfinite(q.uncertainty):
        found["uncertainty"] = round(q.uncertainty, 6)
    return found


def _over_frequency(result: Result) -> dict[str, Any]:
    """Return resistance and apparent mass over the frequency, by mode."""
    if "frequencies" not in result.data:
        return {}
    frequencies, table = result.data["frequencies"], {}
    for name in (key[11:] for key in result.data if key.startswith("resistance_")):
        mass = apparent_mass(
            result.data[f"reactance_{name}"], frequencies, result.settings["stiffness"]
        )
        rows = {"resistance_Ns_m": result.data[f"resistance_{name}"], "apparent_mass_kg": mass}
        table[name] = {
            row: [round(float(v), 4) if np.isfinite(v) else None for v in values]
            for row, values in rows.items()
        }
    what = (
        "Re Z, and Im Z without the commanded spring as a mass. Where Re Z is negative the handle "
        "gives energy to what it touches. Compensated friction is taken from this margin."
    )
    return {
        "impedance_over_frequency": {
            "frequencies_Hz": [float(f) for f in frequencies], "modes": table, "what": what,
        }
    }  # fmt: skip


def _laws(lab: Lab) -> dict[str, Any]:
    """Return for each law that is judged its largest stable gains, with limits and conditions.

    Raises MissingResult if the gains are of another version of a law or of other masses, or kept no
    conditions.
    """
    if not (lab.folder / f"{stability.NAME}.yaml").exists():
        return {}
    gains = lab.result(stability.NAME)
    if gains.settings["masses"] == stability.NOMINAL:
        raise MissingResult(
            f"the gains of {stability.NAME} were found with the masses of its settings, not with "
            "this module's: run gravity and inertia, then stability again"
        )
    return {law.name: _law(law, gains) for law in lab.stand.laws if law.judged}


def _law(law: Law, gains: Result) -> dict[str, Any]:
    """Return one law's part of the file; gains: result of `stability`. Raises MissingResult."""
    # A result of an earlier version has those of one law, not below its name.
    earlier = {THESIS_LAW.name: gains.settings.get("law_version", "")}
    version = gains.settings.get("laws", earlier).get(law.name, "")
    if not version:
        raise MissingResult(
            f"{stability.NAME} has found no gains of law {law.name}: run {stability.NAME} again"
        )
    if not fits(version, law):
        raise MissingResult(
            f"the gains of {stability.NAME} were found for version {version} of law {law.name}, "
            f"now it is {law_version(law)}: run {stability.NAME} again"
        )
    known = gains.settings.get("conditions", {THESIS_LAW.name: gains.settings})[law.name]
    wanted = conditions_of(law, VerticalSettings(), law.settings(), Loop(0.0, 0.0, 0.0))
    if missing := set(wanted) - set(known):
        raise MissingResult(
            f"the result of {stability.NAME} does not say with which {min(missing)} its gains were "
            f"found, an older version wrote it: run {stability.NAME} again"
        )
    usual, ranges = law.settings(), fields(law.settings)
    stable: dict[str, dict[str, float]] = {load: {} for load in stability.ENVIRONMENTS}
    found = {}
    for gain in modes_of_gains(law):
        name = margin_of(law, gain).name
        for load, on in stable.items():
            q = gains.quantity(f"{name}_{load}")
            on[gain] = q.value
            found[q.name] = {
                "gain": _rounded(q.value),
                "uncertainty": _rounded(q.uncertainty),
                "margin": _rounded(_over(q.value, getattr(usual, gain))),
                "what": q.text,
            }
    limiting = {
        load: {gain: _rounded_down(value, ranges[gain]) for gain, value in stable[load].items()}
        for load in LOADS
    }
    most = {gain: min(on[gain] for on in limiting.values()) for gain in modes_of_gains(law)}
    exceeded = {
        load: {gain: round(value, 2) for gain, value in on.items() if value < most[gain]}
        for load, on in stable.items()
        if load not in limiting
    }
    return {
        "version": version,
        "largest_gains": found,
        "largest_gains_on": limiting,
        "exceeds": {load: on for load, on in exceeded.items() if on},
        # To the last bit: the controller compares them.
        "conditions": {name: known[name] for name in wanted},
    }


def _over(value: float, usual: float) -> float:
    """Return the margin of a largest gain over the default, infinite over none."""
    return value / usual if usual else math.inf


def _rounded_down(gain: float, of: Field) -> float:
    """Return a gain rounded down and within the range of its setting."""
    return math.floor(100.0 * min(gain, of.setting.high)) / 100.0


def _rounded(value: float) -> float | None:
    """Return a value for the file, nothing for one that is infinite or unknown."""
    return round(value, 2) if math.isfinite(value) else None


def _as_yaml(content: dict[str, Any]) -> str:
    """Return a text of YAML, in the order of the keys."""
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
