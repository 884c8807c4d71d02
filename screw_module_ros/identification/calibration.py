# SPDX-License-Identifier: Apache-2.0
"""Writes the module's calibration file, which controller and amplifier load, from the results."""

from __future__ import annotations

from datetime import datetime, timezone
from typing import Annotated, NamedTuple

from ..calibration.module import ModuleCalibration, SensorBias, write_calibration
from ..settings import Setting
from . import friction_model, gravity, inertia, static_torque
from .certificate import own_serial, software
from .lab import Lab
from .results import NOTHING, Experiment, Quantity, Result, no_figures

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
    residuals = {
        "friction_rms_N": friction.value("rms"),
        "friction_within_2N": friction.value("within"),
        "linearization_correlation": torque.value("correlation"),
        "linearization_left_N": torque.value("largest_at_handle"),
        "gravity_sd_N": weight.uncertainty,
        "mass_sd_kg": mass.uncertainty,
    }
    path, zero = lab.folder / FILE, lab.bench.zero()
    write_calibration(
        path,
        ModuleCalibration(
            serial=own_serial(lab, settings.serial),
            date=datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
            software=software(),
            friction=friction_model.friction_model_of(friction),
            linearization=static_torque.linearization_of(torque),
            gravity_N=weight.value,
            mass_kg=mass.value,
            sensor_bias=SensorBias(zero[:3], zero[3:]),
            residuals=residuals,
        ),
    )
    quantities = (
        Quantity("gravity", weight.value, weight.uncertainty, "N", "weight the controller carries"),
        Quantity("mass", mass.value, mass.uncertainty, "kg", "mass that moves with the handle"),
    )
    return Result(NAME, quantities, settings._asdict(), (f"written: {path.name}",))


EXPERIMENT = Experiment(
    NAME, "writes the module's calibration file, which controller and amplifier load, from results",
    Settings, run, no_figures, NOTHING, ("static_torque", "gravity", "friction_model", "inertia"),
)  # fmt: skip
