# SPDX-License-Identifier: Apache-2.0
"""The friction model's file and its part of a module's calibration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..control.friction import FrictionBranch, FrictionModel, friction_force
from ..resources import resource_path
from .strict_mapping import CalibrationError, Section
from .yaml_file import read_calibration

FORMAT = "screw_module_ros/friction"
THESIS_FILE = "params/friction_thesis.yaml"
_LARGEST_PLAUSIBLE = 60.0  # [N], about four times what the thesis measured


class FrictionFileError(CalibrationError):
    """A friction file that cannot be used."""


def load_friction_model(path: str | Path) -> FrictionModel:
    """Read a friction file (see params/friction_thesis.yaml, which explains each key).

    Raises FrictionFileError naming the file, the key, what is wrong and the way out.
    """
    return read_friction_model(read_calibration(path, FORMAT, FrictionFileError))


def thesis_friction() -> FrictionModel:
    """Return the model of the thesis's module (section 5.2.5)."""
    return load_friction_model(resource_path(THESIS_FILE))


def read_friction_model(section: Section) -> FrictionModel:
    """Read the friction model in a section of a calibration; raises the section's error."""
    low = section.number("low_mm", -1000.0, 1000.0)
    high = section.number("high_mm", -1000.0, 1000.0)
    fastest = section.number("fastest_mm_s", 1.0, 2000.0)
    model = FrictionModel(
        low=low,
        high=high,
        fastest=fastest,
        ramp_speed=section.number("ramp_speed_mm_s", 0.1, fastest),
        lead=section.number("lead_mm", 0.1, 1000.0),
        phase=section.number("phase_rad"),
        gravity=section.number("gravity_N", -100.0, 100.0),
        up=_read_branch(section.section("up")),
        down=_read_branch(section.section("down")),
    )
    if not low < high:
        problem = f"{high:g} is not above low_mm {low:g}"
        section.fail("high_mm", problem, "give the range of the fit")
    section.finish()
    _check_plausible(section, model)
    return model


def friction_values(model: FrictionModel) -> dict[str, Any]:
    """Return the mapping that `read_friction_model` reads, in the order of the packaged file."""
    return {
        "low_mm": model.low,
        "high_mm": model.high,
        "fastest_mm_s": model.fastest,
        "ramp_speed_mm_s": model.ramp_speed,
        "lead_mm": model.lead,
        "phase_rad": model.phase,
        "gravity_N": model.gravity,
        "up": _branch_values(model.up),
        "down": _branch_values(model.down),
    }


def _read_branch(section: Section) -> FrictionBranch:
    order = "the polynomial's coefficients from the highest power to the constant"
    branch = FrictionBranch(
        trend=section.numbers("trend", 8, order),
        ripple=section.numbers("ripple", 6, order),
        flip_below=section.number("flip_below_mm"),
        break_speed=section.number("break_speed_mm_s", 0.0, 2000.0),
        low_gain=section.number("low_gain", 0.0, 100.0),
        low_exponent=section.number("low_exponent", 0.0, 2.0),
        high_slope=section.number("high_slope", -1.0, 1.0),
        high_offset=section.number("high_offset", 0.0, 100.0),
    )
    section.finish()
    return branch


def _branch_values(branch: FrictionBranch) -> dict[str, Any]:
    return {
        "trend": branch.trend,
        "ripple": branch.ripple,
        "flip_below_mm": branch.flip_below,
        "break_speed_mm_s": branch.break_speed,
        "low_gain": branch.low_gain,
        "low_exponent": branch.low_exponent,
        "high_slope": branch.high_slope,
        "high_offset": branch.high_offset,
    }


def _check_plausible(section: Section, model: FrictionModel) -> None:
    """Refuse coefficients that give implausible forces, checked at each 1 % of the range.

    Fv rises or falls throughout on each side of its break, so the ends of both sides suffice.
    """
    for step in range(101):
        z = (model.low + (model.high - model.low) * step / 100.0) / 1000.0
        for branch, way in ((model.up, 1e-3), (model.down, -1e-3)):
            at_break = (nearly * branch.break_speed for nearly in (1.0 - 1e-9, 1.0 + 1e-9))
            for velocity in (way * v for v in (model.ramp_speed, model.fastest, *at_break)):
                force = friction_force(model, z, velocity)
                if not abs(force) <= _LARGEST_PLAUSIBLE:
                    section.fail(
                        "up" if velocity > 0.0 else "down",
                        f"{force:.3g} N of friction at {z:.3f} m and {velocity:.3f} m/s, more than "
                        f"{_LARGEST_PLAUSIBLE:g} N",
                        "check the coefficients and their order",
                    )
