# SPDX-License-Identifier: Apache-2.0
"""Content of a module's calibration: keys in the file, their ranges and their checksum.

`module_file` shows the file, reads and writes it.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from ..control.friction import FrictionModel
from ..control.linearization import Linearization
from .friction_file import friction_values, read_friction_model
from .linearization_file import linearization_values, read_linearization
from .strict_mapping import Section
from .yaml_file import VERSION

FORMAT = "screw_module_ros/calibration"
_LONGEST_TEXT = 64
_LARGEST_WEIGHT_DIFFERENCE = 5.0  # [N] between the weight carried and that in the friction fits
# Share of the mass: with an error of twice that OBSERVER would carry the whole mass.
_LARGEST_MASS_SD = 0.2
_AS_WRITTEN = "give it as the characterization does"
_RESIDUAL_NAME = re.compile(r"[a-z]\w*", re.ASCII)
_RESIDUAL_RANGES = {
    "friction_rms_N": (0.0, 20.0),
    "friction_within_2N": (0.0, 1.0),
    "linearization_correlation": (0.9, 1.0),
    "linearization_left_N": (0.0, 5.0),
    "gravity_sd_N": (0.0, 10.0),
    "mass_sd_kg": (0.0, 10.0),
}


class ModuleCalibration(NamedTuple):
    """Result of the characterization of one module.

    serial: of the module; date: of the identification, ISO 8601 in UTC with seconds, ending in Z
    or +00:00; software: version of this package; gravity: force that carries the moving parts'
    weight [N]; mass: that moves with the handle, the motor's inertia included [kg]; sensor_bias:
    of the force sensor, three forces [N] and three torques [Nm]; residuals: how well it all fits,
    by names that carry their unit, like friction_rms_N; checksum: of all the others, set by
    `write_calibration` and the loader.
    """

    serial: str
    date: str
    software: str
    friction: FrictionModel
    linearization: Linearization
    gravity: float
    mass: float
    sensor_bias: tuple[float, float, float, float, float, float]
    residuals: dict[str, float]
    checksum: str = ""

    def identity(self, path: str | Path) -> str:
        """Return the identity for diagnostics and bags; path is the file it came from."""
        return f"{self.serial} {self.date} sha256:{self.checksum[:12]} {Path(path).name}"


def content_values(calibration: ModuleCalibration) -> dict[str, Any]:
    """Return the file's mapping without format, version and checksum, of Python's own types."""
    return _plain(
        {
            "serial": calibration.serial,
            "date": calibration.date,
            "software": calibration.software,
            "gravity_N": calibration.gravity,
            "mass_kg": calibration.mass,
            "sensor_bias": {
                "force_N": calibration.sensor_bias[:3],
                "torque_Nm": calibration.sensor_bias[3:],
            },
            "residuals": calibration.residuals,
            "friction": friction_values(calibration.friction),
            "linearization": linearization_values(calibration.linearization),
        }
    )


def read_content(top: Section) -> ModuleCalibration:
    """Read what `content_values` gives, the checksum still empty; raises the section's error."""
    calibration = ModuleCalibration(
        serial=_text(top, "serial"),
        date=_date(top),
        software=_text(top, "software"),
        friction=read_friction_model(top.section("friction")),
        linearization=read_linearization(top.section("linearization")),
        gravity=top.number("gravity_N", -50.0, 50.0),
        mass=top.number("mass_kg", 0.5, 50.0),
        sensor_bias=_sensor_bias(top.section("sensor_bias")),
        residuals=_residuals(top.section("residuals")),
    )
    top.finish()
    fitted = calibration.friction.gravity
    if not abs(calibration.gravity - fitted) <= _LARGEST_WEIGHT_DIFFERENCE:
        top.fail(
            "gravity_N",
            f"{calibration.gravity:g} N, but friction was fitted with a weight of {fitted:g} N",
            "fit friction with the same weight",
        )
    deviation = calibration.residuals.get("mass_sd_kg", 0.0)
    if not deviation <= _LARGEST_MASS_SD * calibration.mass:
        top.fail(
            "mass_kg",
            f"{calibration.mass:g} kg with a standard deviation of {deviation:g} kg, more than "
            f"{100.0 * _LARGEST_MASS_SD:g} %",
            "identify the inertia again, with more and faster records",
        )
    return calibration


def content_checksum(calibration: ModuleCalibration) -> str:
    """Return the SHA-256 of the canonical content (see `module_file`), in hexadecimal.

    It covers the tuple instead of the file's keys: each key is read exactly once and unknown keys
    are refused, so the tuple holds the whole file.
    """
    values = {"format": FORMAT, "version": VERSION, **content_values(calibration)}
    canonical = json.dumps(_with_doubles(values), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode("ascii")).hexdigest()


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    if hasattr(value, "tolist"):  # numpy's numbers and arrays
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    return value


def _with_doubles(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _with_doubles(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_with_doubles(part) for part in value]
    return float(value) if isinstance(value, int) else value


def _text(section: Section, key: str) -> str:
    text = section.text(key)
    if len(text) > _LONGEST_TEXT or not text.isprintable() or text != text.strip():
        problem = f"{text[:20]!r} is not up to {_LONGEST_TEXT} printable characters, trimmed"
        section.fail(key, problem, _AS_WRITTEN)
    return text


def _date(section: Section) -> str:
    text = section.text("date")
    try:
        offset = datetime.strptime(text, "%Y-%m-%dT%H:%M:%S%z").utcoffset()
    except ValueError:
        offset = None
    if offset != timedelta(0):
        problem = f"{text[:40]!r} is no date and time in UTC like 2001-05-11T09:30:00Z"
        section.fail("date", problem, _AS_WRITTEN)
    return text


def _sensor_bias(section: Section) -> tuple[float, ...]:
    forces = section.numbers("force_N", 3, "the bias along x, y, z", -1000.0, 1000.0)
    torques = section.numbers("torque_Nm", 3, "the bias about x, y, z", -100.0, 100.0)
    section.finish()
    return forces + torques


def _residuals(section: Section) -> dict[str, float]:
    found = {}
    for name in section.names():
        if not _RESIDUAL_NAME.fullmatch(name):
            section.fail(name, "a name of letters, digits and _ is needed", _AS_WRITTEN)
        found[name] = section.number(name, *_RESIDUAL_RANGES.get(name, (-math.inf, math.inf)))
    section.finish()
    return found
