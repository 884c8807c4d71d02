# SPDX-License-Identifier: Apache-2.0
"""Limits that every command passes: force, rate, speed, ends of travel, motor torque.

All limits are continuous, so that none can chatter. Each either reduces a force or pushes inward;
none drives the handle outward.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..settings import Setting

ANY_RATE = 1e6
"""`command_rate` without effect: no command changes as fast [N/s]."""
COLD = 0.0
"""Heat of a motor that has rested [Nm^2]."""
LONGEST_STEP = 0.02
"""A longer time step of a law counts as this one, so that a pause makes no large step [s]."""
# A sample beyond these cannot be real; a law then gives zero.
FARTHEST = 10.0  # [m], [rad]
FASTEST = 100.0  # [m/s], [rad/s]
STRONGEST = 1e5  # [N]
NUMBER = 1e9
"""An answer of a law or an arm that is larger, in its SI unit, or NaN, is no number."""
STOPPED = 0.2
"""Time constant with which what moved counts as what stands: there the help of a hand is bounded,
as an obstacle that the transducer does not feel may hold it [s]."""
DRIVING = 0.05
"""Largest recent speed from which this bound is gone [m/s]."""


class CommandLimits(NamedTuple):
    """Largest force commands, sums of impedance, weight, friction and feedback.

    The law limits the force on the hand: 65 N up and 45 N down of spring and damper (thesis 2.1.1).
    The command also carries 10 N of weight and overcomes 10 to 20 N of friction. The limits here
    catch faults, so controller and amplifier both have them, under the same names.

    Only the amplifier has command_rate. The controller's law changes its force by at most
    `force_rate`, 2000 N/s. Twice that passes every step of the law, also with half a period of
    jitter, and limits a foreign sender or a defective controller to 4 N a millisecond. A command of
    zero passes at once.
    """

    command_up: Annotated[
        float, Setting("largest command upward, weight and friction included", "N", 0.0, 150.0)
    ] = 95.0  # ours
    command_down: Annotated[
        float, Setting("largest command downward, friction included", "N", 0.0, 150.0)
    ] = 75.0  # ours
    command_rate: Annotated[
        float, Setting("fastest change of the command that is followed", "N/s", 10.0, ANY_RATE)
    ] = 4000.0  # ours


class TorqueLimits(NamedTuple):
    """Motor torque limits (thesis 3.1.6: 0.42 Nm continuous).

    The copper loss is proportional to the square of the torque. `heat` is that square through a
    first-order lag. The peak torque is allowed until the heat approaches that of the continuous
    torque; then the limit falls smoothly to the continuous torque. The default peak, twice the
    continuous torque, is our choice: the largest command of 95 N needs 0.29 Nm.
    """

    continuous: Annotated[float, Setting("continuous torque", "Nm", 1e-3, 100.0)] = (
        0.42  # thesis: continuous_torque
    )
    peak: Annotated[
        float, Setting("torque that is never exceeded", "Nm", 1e-3, 100.0)
    ] = 0.84  # ours: twice the continuous torque
    time_constant: Annotated[
        float, Setting("time constant of the motor's heating", "s", 0.5, 1000.0)
    ] = 5.0  # ours


# Share of the heat budget over which the limit comes down from peak to continuous torque.
_FOLDBACK_SHARE = 0.25


def clamp(value: float, low: float, high: float) -> float:
    """Return value clamped to low..high (same unit); NaN passes, so check for it before."""
    return low if value < low else (high if value > high else value)


def is_real(position: float, velocity: float, force: float) -> bool:
    """Return whether a sample can be real; comparisons with NaN are false.

    position [m], velocity [m/s] of an axis, or [rad], [rad/s] of a joint; force [N].
    """
    return abs(position) <= FARTHEST and abs(velocity) <= FASTEST and abs(force) <= STRONGEST


def slew(previous: float, target: float, step: float) -> float:
    """Return target, clamped to previous +-step (same unit)."""
    low, high = previous - step, previous + step
    return low if target < low else (high if target > high else target)


def limit_speed(
    force: float, velocity: float, speed_limit: float, speed_band: float, damping: float
) -> float:
    """Return the force [N] limited so that the handle does not run away.

    Above speed_limit [m/s] the force in the direction of motion fades; it is zero at speed_limit +
    speed_band [m/s]. damping [Ns/m] acts on the excess speed.
    """
    excess = abs(velocity) - speed_limit
    if excess <= 0.0:
        return force
    sign = 1.0 if velocity > 0.0 else -1.0
    if force * sign > 0.0:
        force *= max(0.0, 1.0 - excess / speed_band)
    return force - sign * damping * excess


def braking_speed(
    braking: float, reaction: float, position: float, velocity: float, low: float, high: float
) -> float:
    """Return the speed [m/s] from which a deceleration comes to rest at an end.

    braking: a [m/s^2]; reaction: T [s], in which the force turns round; low, high: the ends [m], of
    which the one ahead counts; way left to it d = v T + v^2 / (2 a), none beyond it. On the way
    back from an end it is the far one that is ahead.
    """
    left = max(0.0, high - position if velocity > 0.0 else position - low)
    lost = braking * reaction
    return max(0.0, math.sqrt(lost * lost + 2.0 * braking * left) - lost)


def soft_stop(
    force: float, position: float, low: float, high: float, zone: float, stiffness: float
) -> float:
    """Return the force [N] limited near the ends of travel.

    low, high: ends of travel [m]; zone: length of the soft stop inside each end [m]; stiffness:
    spring that pushes inward [N/m]. Inside a zone an outward force fades with depth and is zero at
    the end of travel; the spring acts on the depth.
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
    largest = largest_torque(limits, heat, dt)
    allowed = min(max(torque, -largest), largest) if math.isfinite(torque) else 0.0
    return allowed, heat + (allowed * allowed - heat) * min(1.0, dt / limits.time_constant)


def largest_torque(limits: TorqueLimits, heat: float, dt: float) -> float:
    """Return the largest torque of a motor with this heat [Nm^2] for the next dt [s], in Nm.

    It is the peak torque at first, and comes down to the continuous torque with the heat.
    """
    budget = limits.continuous * limits.continuous
    peak = limits.peak * limits.peak
    share = min(1.0, dt / limits.time_constant)
    reserve = max(0.0, budget - heat)
    folded = budget + (peak - budget) * min(1.0, reserve / (_FOLDBACK_SHARE * budget))
    # The last term is the torque that would use up the heat budget within this step.
    return math.sqrt(min(peak, folded, heat + reserve / share))
