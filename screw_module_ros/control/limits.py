# SPDX-License-Identifier: Apache-2.0
"""Limits every command passes: force, rate, speed, ends of travel, motor torque.

All are continuous, so that none of them can chatter, and all only ever take force away from what
asks for more, or push inward: none drives outward by itself.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..settings import Setting


class CommandLimits(NamedTuple):
    """Largest force commands, everything in them: impedance, weight, friction and feedback.

    What the robot presses on the hand is limited in the law, by 65 N up and 45 N down of spring and
    damper (thesis 2.1.1); what it takes to carry 10 N of weight and to overcome 10 to 20 N of
    friction comes on top. These limits are for what goes wrong, so controller and amplifier both
    have them, by the same names.

    command_rate is the amplifier's own. The controller's `force_rate`, 2000 N/s, is a limit of its
    law; twice that lets every step of it pass, also where commands come with half a period of
    jitter, and holds what a foreign sender or a defect in a controller may do to 4 N a millisecond.
    Zero is not held back.
    """

    command_up: Annotated[
        float, Setting("largest command upward, weight and friction included", "N", 0.0, 150.0)
    ] = 95.0
    command_down: Annotated[
        float, Setting("largest command downward, friction included", "N", 0.0, 150.0)
    ] = 75.0
    command_rate: Annotated[
        float, Setting("fastest change of the command that is followed", "N/s", 10.0, 1e6)
    ] = 4000.0


class TorqueLimits(NamedTuple):
    """Motor torque limits (thesis 3.1.6: 0.42 Nm continuous).

    The copper loss goes with the square of the torque. `heat` is that square through a first-order
    lag; the peak torque is allowed until the heat nears what the continuous torque makes, then the
    limit comes down smoothly to the continuous torque. Twice the continuous torque as peak is our
    choice: the largest command of 95 N needs 0.29 Nm.
    """

    continuous: Annotated[float, Setting("torque that may stand for ever", "Nm", 1e-3, 100.0)] = (
        0.42
    )
    peak: Annotated[float, Setting("torque that is never exceeded", "Nm", 1e-3, 100.0)] = 0.84
    time_constant: Annotated[
        float, Setting("time constant of the motor's heating", "s", 0.5, 1000.0)
    ] = 5.0


# Share of the heat budget over which the limit comes down from peak to continuous torque.
_FOLDBACK_SHARE = 0.25


def clamp(value: float, low: float, high: float) -> float:
    """Return value held within low..high (same unit); NaN passes, so check for it before."""
    return low if value < low else (high if value > high else value)


def slew(previous: float, target: float, step: float) -> float:
    """Return target, held within +-step of previous (same unit)."""
    return clamp(target, previous - step, previous + step)


def limit_speed(
    force: float, velocity: float, speed_limit: float, speed_band: float, damping: float
) -> float:
    """Return the force [N] with which the handle does not run away.

    Above speed_limit [m/s] the force in the direction of motion fades, to nothing speed_band [m/s]
    further up, and damping [Ns/m] acts on the excess speed.
    """
    excess = abs(velocity) - speed_limit
    if excess <= 0.0:
        return force
    sign = 1.0 if velocity > 0.0 else -1.0
    if force * sign > 0.0:
        force *= max(0.0, 1.0 - excess / speed_band)
    return force - sign * damping * excess


def soft_stop(
    force: float, position: float, low: float, high: float, zone: float, stiffness: float
) -> float:
    """Return the force [N] with the ends of travel in mind.

    low, high: ends of travel [m]; zone: length of the soft stop inside each end [m]; stiffness:
    spring that pushes inward [N/m]. Inside a zone an outward force fades with depth, to nothing at
    the end of travel, and the spring acts on the depth.
    """
    depth = position - (high - zone)
    if depth > 0.0:
        kept = max(0.0, 1.0 - depth / zone)
        return (force * kept if force > 0.0 else force) - stiffness * depth
    depth = (low + zone) - position
    if depth > 0.0:
        kept = max(0.0, 1.0 - depth / zone)
        return (force * kept if force < 0.0 else force) + stiffness * depth
    return force


def limit_torque(
    limits: TorqueLimits, heat: float, torque: float, dt: float
) -> tuple[float, float]:
    """Return the torque allowed now [Nm] and the heat after dt [s], in Nm^2 (I2t).

    Start with heat 0; dt must be positive. The heat never passes the square of the continuous
    torque, so the mean square over the time constant stays within the continuous rating. A torque
    that is not finite gives zero.
    """
    budget = limits.continuous * limits.continuous
    peak = limits.peak * limits.peak
    share = min(1.0, dt / limits.time_constant)
    reserve = max(0.0, budget - heat)
    folded = budget + (peak - budget) * min(1.0, reserve / (_FOLDBACK_SHARE * budget))
    # The last term is what would fill the budget within this very step.
    largest = math.sqrt(min(peak, folded, heat + reserve / share))
    allowed = clamp(torque, -largest, largest) if math.isfinite(torque) else 0.0
    return allowed, heat + (allowed * allowed - heat) * share
