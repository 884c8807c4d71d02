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
    friction: ...         # the keys of params/friction_thesis.yaml without its format and version
    linearization: ...    # the keys of a linearization file without its format and version
    checksum: ...         # 64 hexadecimal digits

The checksum is the SHA-256 of all other keys in a canonical form: JSON with the keys sorted at
every level, no spaces, ASCII only, and each number as the shortest decimal of its double (`10`,
`10.0` and `1.0e+1` are the same number). Layout and comments do not change it; any change of a
value does. It protects against accidents and edits by hand, not against forgery.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, NamedTuple

import yaml

from ..settings import Setting
from .module_fields import FORMAT, ModuleCalibration, content_checksum, content_values, read_content
from .strict_mapping import CalibrationError, Section
from .yaml_file import VERSION, check_serial, read_calibration

__all__ = [
    "CalibrationSettings",
    "ModuleCalibration",
    "ModuleCalibrationError",
    "chosen_calibration",
    "load_module_calibration",
    "write_calibration",
]

_HEADER = """\
# Calibration of one module, written by its characterization. Not to be edited: the nodes refuse a
# file whose checksum no longer fits its values. Layout and comments do not matter.
"""
_IDENTIFY = "restore the file as it was written, or identify the module anew"
_NOT_WRITTEN = "nothing was written: look for the cause in the identification"


class ModuleCalibrationError(CalibrationError):
    """A module's calibration file that cannot be used or written."""


class CalibrationSettings(NamedTuple):
    """Parameters of a node that loads a module's calibration."""

    calibration_file: Annotated[
        str, Setting("calibration file of the module, empty for none")
    ] = ""
    module_serial: Annotated[
        str, Setting("serial of the connected module, empty when unknown")
    ] = ""


def chosen_calibration(
    settings: CalibrationSettings, other: str, other_file: str
) -> ModuleCalibration | None:
    """Return the calibration that the settings name, None for none.

    other, other_file: name and value of the setting for a file with a part of the calibration; only
    one of the two files may be named. Raises ModuleCalibrationError.
    """
    path = settings.calibration_file
    if not path:
        return None
    if other_file:
        raise ModuleCalibrationError(
            f"{path}: it is named by calibration_file, and {other} names {other_file}; a "
            "calibration holds that too: empty one of the two parameters"
        )
    return load_module_calibration(path, settings.module_serial)


def load_module_calibration(path: str | Path, serial: str) -> ModuleCalibration:
    """Read the calibration of the module with that serial.

    Raises ModuleCalibrationError naming file, key, problem and way out: when the file cannot be
    read or parsed, has a value out of range, was changed after it was written, or belongs to
    another module. An empty serial is also refused, because the module is then unknown.
    """
    top = read_calibration(path, FORMAT, ModuleCalibrationError, _IDENTIFY)
    noted = top.text("checksum")
    calibration = read_content(top)
    found = content_checksum(calibration)
    if noted != found:
        top.fail(
            "checksum",
            f"the file was changed after it was written (its values give {found[:12]}, it says "
            f"{noted[:12]!r})",
            _IDENTIFY,
        )
    check_serial(str(path), calibration.serial, serial, ModuleCalibrationError)
    return calibration._replace(checksum=found)


def write_calibration(path: str | Path, calibration: ModuleCalibration) -> ModuleCalibration:
    """Write a calibration atomically; return the calibration with its checksum.

    Values are checked as by the loader; the given checksum is ignored. Raises
    ModuleCalibrationError, also for an error of the disk.
    """
    content = content_values(calibration)
    checked = read_content(Section(str(path), "", content, ModuleCalibrationError, _NOT_WRITTEN))
    written = checked._replace(checksum=content_checksum(checked))
    values = {
        "format": FORMAT,
        "version": VERSION,
        **content_values(written),
        "checksum": written.checksum,
    }
    text = _HEADER + yaml.safe_dump(
        values, sort_keys=False, allow_unicode=True, default_flow_style=None, width=100
    )
    try:
        _replace(Path(path), text)
    except (OSError, ValueError) as problem:  # ValueError: a path that names no file
        reason = getattr(problem, "strerror", "") or problem
        raise ModuleCalibrationError(
            f"{path}: cannot be written ({reason}); check folder, permissions and free space"
        ) from problem
    return written


def _replace(path: Path, text: str) -> None:
    """Replace the file's text atomically: at any moment the file is the old or the new one."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with beside.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)  # otherwise a power failure may restore the old file
    finally:
        os.close(folder)
