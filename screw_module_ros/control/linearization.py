# SPDX-License-Identifier: Apache-2.0
"""Linearization of the amplifier: which torque command yields a torque (thesis 4.1.1, fig 4-3).

For small commands the servo amplifier gives too little torque. The thesis corrects that with a map
from desired torque to command in three pieces: a line, a cubic between about -0.025 and +0.025 Nm,
a line. The map is continuous; its slope steps by about a tenth at the joints. Torque and command
are both in Nm on the motor shaft: a perfect amplifier would give a torque equal to the command.
"""

from __future__ import annotations

from typing import NamedTuple

from .limits import TorqueLimits

_LARGEST_STEP = 1e-4  # [Nm] at a joint, the rounding of a printed fit; 0.03 N at the handle
# [Nm] between torque and command up to the peak torque. The thesis's offset is 0.025 (4.1.1); four
# times that is 33 N at the handle, which no measured amplifier needs and a patient would feel.
_FARTHEST = 0.1
# [Nm] on each side of zero. To compensate a dead zone that the amplifier does not have is a relay:
# with 0.07 on the thesis's amplifier OBSERVER swings by 64 N, whatever the chatter guard does; with
# 0.05 no mode exceeds 2 N rms.
_WIDEST_ZONE = 0.05
SMALLEST_JOINT = 0.004
"""Half of the least distance between the joints [Nm]: it bounds the slope at zero."""
_CHECKS = 400  # over the range of torques; the command rises, so between two it hides 5 mNm at most


class Linearization(NamedTuple):
    """Map from desired torque T [Nm] to torque command [Nm].

    lower_joint, upper_joint: where the pieces meet [Nm]; below and above them the command is
    slope T + offset [Nm], between them c3 T^3 + c2 T^2 + c1 T + c0 with cubic = (c3, c2, c1, c0).
    """

    lower_joint: float
    upper_joint: float
    lower_slope: float
    lower_offset: float
    cubic: tuple[float, float, float, float]
    upper_slope: float
    upper_offset: float


IDENTITY = Linearization(-0.025, 0.025, 1.0, 0.0, (0.0, 0.0, 1.0, 0.0), 1.0, 0.0)


def torque_command(linearization: Linearization, torque: float) -> float:
    """Return the torque command [Nm] that yields a torque [Nm]."""
    if torque < linearization.lower_joint:
        return linearization.lower_slope * torque + linearization.lower_offset
    if torque > linearization.upper_joint:
        return linearization.upper_slope * torque + linearization.upper_offset
    c3, c2, c1, c0 = linearization.cubic
    return ((c3 * torque + c2) * torque + c1) * torque + c0


def default_linearization(dead_zone: float = 0.025, joint: float = 0.025) -> Linearization:
    """Return the map for an amplifier that ignores the first dead_zone [Nm] of a command.

    Lines of slope 1 are shifted outward by dead_zone; between -joint and +joint [Nm] an odd cubic
    joins them with nine tenths of their slope. The thesis prints no coefficients. This map follows
    figures 4-2 and 4-3, read so that the dead zone is as wide as the range that it disturbs. The
    calibration file of a measured amplifier replaces it.
    """
    slope = 0.9
    edge = joint + dead_zone
    c1 = (3.0 * edge - slope * joint) / (2.0 * joint)
    c3 = (slope * joint - edge) / (2.0 * joint**3)
    linearization = Linearization(
        -joint, joint, 1.0, -dead_zone, (c3, 0.0, c1, 0.0), 1.0, dead_zone
    )
    return validated_linearization(linearization)


def validated_linearization(linearization: Linearization) -> Linearization:
    """Return the map unchanged when it is continuous, monotonic and close to the torque.

    Raises ValueError naming the field, its value and the problem.
    """
    field, problem = linearization_flaw(linearization)
    if field:
        raise ValueError(f"Linearization: {field}: {problem}")
    return linearization


def linearization_flaw(linearization: Linearization) -> tuple[str, str]:
    """Return the first wrong field and its problem, or two empty strings."""
    low, high = linearization.lower_joint, linearization.upper_joint
    if not -10.0 <= low < high <= 10.0:
        return "upper_joint", f"{high!r} Nm is not above lower_joint {low!r} Nm"
    if high - low < 2.0 * SMALLEST_JOINT:
        return "upper_joint", f"{high!r} Nm is less than {2e3 * SMALLEST_JOINT:g} mNm above {low!r}"
    zone = 0.5 * (linearization.upper_offset - linearization.lower_offset)
    if zone > _WIDEST_ZONE:
        return "upper_offset", f"a dead zone of {zone:.3g} Nm, more than {_WIDEST_ZONE:g} Nm"
    for name in ("lower_slope", "upper_slope"):
        slope = getattr(linearization, name)
        if not 0.01 <= slope <= 100.0:
            return name, f"{slope!r} is outside 0.01 to 100"
    c3, c2, c1, _ = linearization.cubic
    turning = [-c2 / (3.0 * c3)] if c3 != 0.0 and low < -c2 / (3.0 * c3) < high else []
    if not all((3.0 * c3 * t + 2.0 * c2) * t + c1 > 0.0 for t in [low, high, *turning]):
        return "cubic", f"{linearization.cubic!r} does not rise all the way between the joints"
    for name, slope, offset, joint in (
        ("lower_offset", linearization.lower_slope, linearization.lower_offset, low),
        ("upper_offset", linearization.upper_slope, linearization.upper_offset, high),
    ):
        step = slope * joint + offset - torque_command(linearization, joint)
        if not abs(step) <= _LARGEST_STEP:
            return name, f"{offset!r} Nm makes a step of {step:.3g} Nm at {joint:g} Nm"
    return _far_off(linearization)


def _far_off(linearization: Linearization) -> tuple[str, str]:
    """Return the piece where |command - torque| is too large, and the problem; empty if nowhere."""
    peak = TorqueLimits().peak
    torques = [peak * (2.0 * k / _CHECKS - 1.0) for k in range(_CHECKS + 1)]
    worst = max(torques, key=lambda torque: abs(torque_command(linearization, torque) - torque))
    command = torque_command(linearization, worst)
    if abs(command - worst) <= _FARTHEST:
        return "", ""
    below, above = worst < linearization.lower_joint, worst > linearization.upper_joint
    field = "lower_offset" if below else "upper_offset" if above else "cubic"
    return field, (
        f"{getattr(linearization, field)!r} makes the command {command:.3g} Nm for a torque of "
        f"{worst:.3g} Nm, more than {_FARTHEST:g} Nm apart"
    )
