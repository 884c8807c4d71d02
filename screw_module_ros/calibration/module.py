# SPDX-License-Identifier: Apache-2.0
"""Calibration of one module: the result of the characterization, in one file for the nodes.

::

    format: screw_module_ros/calibration
    version: 1
    serial: SIM-0001
    date: '2001-05-11T09:30:00Z'      # UTC
    software: 0.1.0                   # version of this package
    gravity_N: 10.0
    mass_kg: 5.5
    sensor_bias: {force_N: [0.1, -0.2, 0.3], torque_Nm: [0.0, 0.0, 0.0]}
    residuals: {friction_rms_N: 0.8, linearization_correlation: 0.99996}
    delay_s: 0.00082                  # from a sample to its force, and of it
    drive_delay_s: 0.00022            # the drive's part; an earlier file has neither
    friction: ...         # the keys of params/friction_thesis.yaml without its format and version
    linearization: ...    # the keys of a linearization file without its format and version
    checksum: ...         # 64 hexadecimal digits

The checksum is the SHA-256 of all other keys in a canonical form: JSON with the keys sorted at
every level, no spaces, ASCII only, and each number as the shortest decimal of its double (`10`,
`10.0` and `1.0e+1` are the same number). Layout and comments do not change it; any change of a
value does. It protects against accidents and edits by hand, not against forgery.

Friction model and linearization may also be files of their own::

    format: screw_module_ros/linearization
    version: 1
    joints_Nm: [-0.025, 0.025]
    lower: {slope: 1.0, offset_Nm: -0.025}
    middle: [-880.0, 0.0, 2.55, 0.0]    # cubic, highest power first
    upper: {slope: 1.0, offset_Nm: 0.025}
"""

from __future__ import annotations

import hashlib
import json
from datetime import datetime, timedelta
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import yaml

from ..control.friction import FrictionModel
from ..control.linearization import Linearization
from ..files import replace
from ..resources import resource_path
from ..settings import Setting, SettingError, plain, read
from ..settings_file import VERSION, read_file

FORMAT = "screw_module_ros/calibration"
FRICTION_FORMAT = "screw_module_ros/friction"
LINEARIZATION_FORMAT = "screw_module_ros/linearization"
THESIS_FILE = "params/friction_thesis.yaml"
_HEADER = """\
# Calibration of one module, written by its characterization. Not to be edited: the nodes refuse a
# file whose checksum no longer fits its values. Layout and comments do not matter.
"""
_LARGEST_WEIGHT_DIFFERENCE = 5.0  # [N] between the weight carried and that in the friction fits
# Share of the mass: with an error of twice that OBSERVER would carry the whole mass.
_LARGEST_MASS_SD = 0.2
_RESIDUALS = {
    "friction_rms_N": (0.0, 20.0),
    "friction_within_2N": (0.0, 1.0),
    "linearization_correlation": (0.9, 1.0),
    "linearization_left_N": (0.0, 5.0),
    "gravity_sd_N": (0.0, 10.0),
    "mass_sd_kg": (0.0, 10.0),
}
_FINITE = (-1e300, 1e300)  # range of any other residual
_Triple = tuple[float, float, float]


class SensorBias(NamedTuple):
    """Bias of the force sensor along and about x, y, z."""

    force_N: Annotated[_Triple, Setting("forces", "N", -1000.0, 1000.0)]
    torque_Nm: Annotated[_Triple, Setting("torques", "Nm", -100.0, 100.0)]


class ModuleCalibration(NamedTuple):
    """Result of the characterization of one module; fields as the keys of its file.

    date: of the identification, ISO 8601 in UTC with seconds, ending in Z or +00:00; residuals: how
    well it all fits, by names that carry their unit, like friction_rms_N; checksum: of all the
    others, set by `write_calibration` and the loader.
    """

    serial: Annotated[str, Setting("of the module")]
    date: Annotated[str, Setting("of the identification")]
    software: Annotated[str, Setting("version of this package")]
    gravity_N: Annotated[float, Setting("carries the moving parts' weight", "N", -50.0, 50.0)]
    mass_kg: Annotated[float, Setting("moves with the handle, motor included", "kg", 0.5, 50.0)]
    sensor_bias: SensorBias
    residuals: dict[str, float]
    friction: FrictionModel
    linearization: Linearization
    delay_s: Annotated[
        float, Setting("from a sample to its force, 0: not measured", "s", 0.0, 5e-3)
    ] = 0.0
    drive_delay_s: Annotated[
        float, Setting("of it from the write to the drive on", "s", 0.0, 5e-3)
    ] = 0.0
    checksum: str = ""

    def identity(self, path: str | Path) -> str:
        """Return the identity for diagnostics and bags; path is the file it came from."""
        return f"{self.serial} {self.date} sha256:{self.checksum[:12]} {Path(path).name}"

    def flaw(self) -> str:
        """Return which value is implausible beside the others, empty if none is."""
        for name in ("serial", "software"):
            text = getattr(self, name)
            if not text or text != text.strip():
                return f"{name} = {text!r}: a text without spaces around it is wanted"
        if not _is_utc(self.date):
            return f"date = {self.date!r} is no date and time in UTC like 2001-05-11T09:30:00Z"
        for name, value in self.residuals.items():
            low, high = _RESIDUALS.get(name, _FINITE)
            if not low <= value <= high:
                return f"residuals.{name} = {value!r}: {low:g} to {high:g} is wanted"
        fitted = self.friction.gravity_N
        if not abs(self.gravity_N - fitted) <= _LARGEST_WEIGHT_DIFFERENCE:
            return (
                f"gravity_N = {self.gravity_N:g} N, but friction was fitted with a weight of "
                f"{fitted:g} N: fit friction with the same weight"
            )
        deviation = self.residuals.get("mass_sd_kg", 0.0)
        if not deviation <= _LARGEST_MASS_SD * self.mass_kg:
            return (
                f"mass_kg = {self.mass_kg:g} kg with a standard deviation of {deviation:g} kg, "
                f"more than {100.0 * _LARGEST_MASS_SD:g} %: identify the inertia again, with more "
                "and faster records"
            )
        return ""


def load_friction_model(path: str | Path) -> FrictionModel:
    """Return the friction model of a file, as params/friction_thesis.yaml explains it.

    Raises SettingError naming the file, the key and what is wrong.
    """
    return read_file(path, FrictionModel, FRICTION_FORMAT)


def thesis_friction() -> FrictionModel:
    """Return the model of the thesis's module (section 5.2.5)."""
    return load_friction_model(resource_path(THESIS_FILE))


def load_linearization(path: str | Path) -> Linearization:
    """Return the linearization of a file. Raises SettingError naming file, key and problem."""
    return read_file(path, Linearization, LINEARIZATION_FORMAT)


def load_module_calibration(path: str | Path, serial: str) -> ModuleCalibration:
    """Return the calibration of the module with that serial.

    Raises SettingError naming file, key and problem: when the file cannot be read or parsed, has a
    value out of range, was changed after it was written, or belongs to another module. An empty
    serial is also refused, because the module is then unknown.
    """
    calibration = read_file(path, ModuleCalibration, FORMAT)
    found = content_checksum(calibration)
    if calibration.checksum != found:
        raise SettingError(
            f"{path}: checksum: the file was changed after it was written (its values give "
            f"{found[:12]}, it says {calibration.checksum[:12]!r}); restore the file as it was "
            "written, or identify the module anew"
        )
    check_serial(path, calibration.serial, serial)
    return calibration


def check_serial(path: str | Path, written: str, serial: str) -> None:
    """Raise SettingError unless a file of the module `written` is for this module.

    serial: that of this module, empty if nobody said which it is: then no file is for it.
    """
    if not serial:
        raise SettingError(
            f"{path}: serial: the file belongs to module {written!r}, and which module this is was "
            "not said; set module_serial to the serial on the module"
        )
    if written != serial:
        raise SettingError(
            f"{path}: serial: the file belongs to module {written!r}, this is module {serial!r} "
            "(module_serial); name the file of this module, or identify it"
        )


def content_checksum(calibration: ModuleCalibration) -> str:
    """Return the SHA-256 of the canonical content, in hexadecimal.

    It covers the record instead of the file's text: unknown keys and keys written twice are
    refused, so the record holds the whole file.
    """
    values = {"format": FORMAT, "version": float(VERSION), **_stored(calibration)}
    del values["checksum"]
    canonical = json.dumps(values, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode("ascii")).hexdigest()


def _stored(calibration: ModuleCalibration) -> dict[str, Any]:
    """Return what a file has: as those of earlier versions where no delay was measured."""
    unknown = {"delay_s", "drive_delay_s"} if calibration.delay_s == 0.0 else set()
    return {key: value for key, value in plain(calibration).items() if key not in unknown}


def write_calibration(path: str | Path, calibration: ModuleCalibration) -> ModuleCalibration:
    """Write a calibration atomically; return the calibration with its checksum.

    Values are checked as by the loader; the given checksum is ignored. Raises SettingError, also
    for an error of the disk.
    """
    try:
        checked = read(ModuleCalibration, plain(calibration))
    except SettingError as problem:
        raise SettingError(f"{path}: {problem}; nothing was written") from None
    written = checked._replace(checksum=content_checksum(checked))
    text = _HEADER + yaml.safe_dump(
        {"format": FORMAT, "version": VERSION, **_stored(written)},
        sort_keys=False, allow_unicode=True, default_flow_style=None, width=100,
    )  # fmt: skip
    try:
        replace(Path(path), text)
    except (OSError, ValueError) as problem:  # ValueError: a path that names no file
        reason = getattr(problem, "strerror", "") or problem
        raise SettingError(
            f"{path}: cannot be written ({reason}); check folder, permissions and free space"
        ) from problem
    return written


def _is_utc(text: str) -> bool:
    try:
        return datetime.strptime(text, "%Y-%m-%dT%H:%M:%S%z").utcoffset() == timedelta(0)
    except ValueError:
        return False
