# SPDX-License-Identifier: Apache-2.0
"""Linearization of the amplifier: which torque command yields a torque (thesis 4.1.1, fig 4-3).

For small commands the servo amplifier gives too little torque. The thesis corrects that with a map
from desired torque to command in three pieces: a line, a cubic between about -0.025 and +0.025 Nm,
a line. The map is continuous; its slope steps by about a tenth at the joints. Torque and command
are both in Nm on the motor shaft: a perfect amplifier would give a torque equal to the command.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..settings import Setting, validated
from .limits import TorqueLimits

_LARGEST_STEP = 1e-4  # [Nm] at a joint, the rounding of a printed fit; 0.03 N at the handle
# [Nm] between torque and command up to the peak torque. Half of the thesis's nonlinear range is
# 0.025 (4.1.1), read as the torque that is lost; four times that is 33 N at the handle, which no
# measured amplifier needs and a patient would feel.
_FARTHEST = 0.1
# [Nm] on each side of zero. To compensate a dead zone that the amplifier does not have is a relay:
# with 0.07 on the thesis's amplifier OBSERVER swings by 64 N, whatever the chatter guard does; with
# 0.05 no mode exceeds 2 N rms.
_WIDEST_ZONE = 0.05
SMALLEST_JOINT = 0.004
"""Half of the least distance between the joints [Nm]: it bounds the slope at zero."""
_CHECKS = 400
"""Points over the range of torques; the command rises, so between two it hides 5 mNm at most."""


class Line(NamedTuple):
    """The command outside the joints: slope T + offset_Nm."""

    slope: Annotated[float, Setting("command per torque", "", 0.01, 100.0)]
    offset_Nm: Annotated[float, Setting("command at zero torque", "Nm", -10.0, 10.0)]


class Linearization(NamedTuple):
    """Map from desired torque T [Nm] to torque command [Nm]; fields as the keys of its file.

    joints_Nm: where the pieces meet, lower and upper; lower, upper: the lines below and above them;
    middle: between them the command is c3 T^3 + c2 T^2 + c1 T + c0 with middle = (c3, c2, c1, c0).
    """

    joints_Nm: Annotated[tuple[float, float], Setting("where the pieces meet", "Nm", -10.0, 10.0)]
    lower: Line
    middle: tuple[float, float, float, float]
    upper: Line

    def flaw(self) -> str:
        """Return why the map is not continuous, monotonic and close to the torque, or nothing."""
        low, high = self.joints_Nm
        if not low < high:
            return f"joints_Nm: {high!r} Nm is not above {low!r} Nm"
        if high - low < 2.0 * SMALLEST_JOINT:
            return f"joints_Nm: {high!r} Nm is less than {2e3 * SMALLEST_JOINT:g} mNm above {low!r}"
        zone = 0.5 * (self.upper.offset_Nm - self.lower.offset_Nm)
        if zone > _WIDEST_ZONE:
            return f"upper.offset_Nm: a dead zone of {zone:.3g} Nm, more than {_WIDEST_ZONE:g} Nm"
        c3, c2, c1, _ = self.middle
        turning = [-c2 / (3.0 * c3)] if c3 != 0.0 and low < -c2 / (3.0 * c3) < high else []
        if not all((3.0 * c3 * t + 2.0 * c2) * t + c1 > 0.0 for t in [low, high, *turning]):
            return f"middle: {self.middle!r} does not rise all the way between the joints"
        for name, line, joint in (("lower", self.lower, low), ("upper", self.upper, high)):
            step = line.slope * joint + line.offset_Nm - torque_command(self, joint)
            if not abs(step) <= _LARGEST_STEP:
                offset = f"{name}.offset_Nm: {line.offset_Nm!r} Nm"
                return f"{offset} makes a step of {step:.3g} Nm at {joint:g} Nm"
        return _far_off(self)


IDENTITY = Linearization((-0.025, 0.025), Line(1.0, 0.0), (0.0, 0.0, 1.0, 0.0), Line(1.0, 0.0))


def torque_command(linearization: Linearization, torque: float) -> float:
    """Return the torque command [Nm] that yields a torque [Nm]."""
    low, high = linearization.joints_Nm
    if torque < low:
        return linearization.lower.slope * torque + linearization.lower.offset_Nm
    if torque > high:
        return linearization.upper.slope * torque + linearization.upper.offset_Nm
    c3, c2, c1, c0 = linearization.middle
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
    lower, upper = Line(1.0, -dead_zone), Line(1.0, dead_zone)
    return validated(Linearization((-joint, joint), lower, (c3, 0.0, c1, 0.0), upper))


def _far_off(linearization: Linearization) -> str:
    """Return the piece where |command - torque| is too large, and the problem; empty if nowhere."""
    peak = TorqueLimits().peak
    torques = [peak * (2.0 * k / _CHECKS - 1.0) for k in range(_CHECKS + 1)]
    worst = max(torques, key=lambda torque: abs(torque_command(linearization, torque) - torque))
    command = torque_command(linearization, worst)
    if abs(command - worst) <= _FARTHEST:
        return ""
    low, high = linearization.joints_Nm
    piece = "lower" if worst < low else "upper" if worst > high else "middle"
    return (
        f"{piece}: {tuple(getattr(linearization, piece))!r} makes the command {command:.3g} Nm for "
        f"a torque of {worst:.3g} Nm, more than {_FARTHEST:g} Nm apart"
    )
