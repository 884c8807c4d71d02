# SPDX-License-Identifier: Apache-2.0
"""The linearization's file and its part of a module's calibration (thesis 4.1.1)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..control.linearization import Linearization, linearization_flaw
from .strict_mapping import CalibrationError, Section
from .yaml_file import read_calibration

FORMAT = "screw_module_ros/linearization"
_FILE_KEYS = {
    "upper_joint": "joints_Nm",
    "lower_slope": "lower.slope",
    "lower_offset": "lower.offset_Nm",
    "cubic": "middle",
    "upper_slope": "upper.slope",
    "upper_offset": "upper.offset_Nm",
}


class LinearizationFileError(CalibrationError):
    """A linearization file that cannot be used."""


def load_linearization(path: str | Path) -> Linearization:
    """Read a linearization file.

    ::

        format: screw_module_ros/linearization
        version: 1
        joints_Nm: [-0.025, 0.025]
        lower: {slope: 1.0, offset_Nm: -0.025}
        middle: [-880.0, 0.0, 2.55, 0.0]    # cubic, highest power first
        upper: {slope: 1.0, offset_Nm: 0.025}

    Raises LinearizationFileError naming the file, the key, what is wrong and the way out.
    """
    return read_linearization(read_calibration(path, FORMAT, LinearizationFileError))


def read_linearization(section: Section) -> Linearization:
    """Read the linearization in a section of a calibration; raises the section's error."""
    joints = section.numbers("joints_Nm", 2, "the torques where the pieces meet, lower and upper")
    lower_slope, lower_offset = _read_line(section.section("lower"))
    cubic = section.numbers("middle", 4, "the cubic's coefficients from the highest power down")
    upper_slope, upper_offset = _read_line(section.section("upper"))
    section.finish()
    linearization = Linearization(
        *joints, lower_slope, lower_offset, cubic, upper_slope, upper_offset
    )
    field, problem = linearization_flaw(linearization)
    if field:
        section.fail(_FILE_KEYS[field], problem, "fit the three pieces again")
    return linearization


def linearization_values(linearization: Linearization) -> dict[str, Any]:
    """Return the mapping that `read_linearization` reads."""
    one = linearization
    return {
        "joints_Nm": [one.lower_joint, one.upper_joint],
        "lower": {"slope": one.lower_slope, "offset_Nm": one.lower_offset},
        "middle": one.cubic,
        "upper": {"slope": one.upper_slope, "offset_Nm": one.upper_offset},
    }


def _read_line(section: Section) -> tuple[float, float]:
    line = section.number("slope"), section.number("offset_Nm", -10.0, 10.0)
    section.finish()
    return line
