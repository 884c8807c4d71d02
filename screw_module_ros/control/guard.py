# SPDX-License-Identifier: Apache-2.0
"""Guard of the force gains: takes them away when the handle oscillates (thesis 6.4.3, 7.1).

No force gain is stable against every load on the handle. The guard has one share, by which the law
multiplies its force gains, and two detectors.

*Chatter* (`guard_step`): an oscillation faster than a hand can move. The rms of the handle force
above `CHATTER_HZ` exceeds the limit for `LASTING`, which is longer than the jolt of a reversal.

*Outflow* (`outflow_step`): an oscillation that the robot feeds, also at 2 to 6 Hz, where hands
tremble. The direction of the power tells the two apart. A hand that trembles drives the robot,
which takes power from it; a robot that drives an oscillation gives power to what holds the handle
(passivity observer: Hannaford and Ryu 2002). A spring alone takes no mean power, so the share of
the power that counts has a threshold, and motion slower than `OUTFLOW_HZ` is left out. A robot that
pushes a hand once gives power too: only a force that has turned several times counts.

Either one trips the guard. Its share falls to zero within `FALL`, and the law puts a damper in
place of the gains. The share returns within `RETURN`, but only up to a ceiling, a part of the share
at which the oscillation began. The ceiling rises again with the time constant `FORGET`. So a
contact that is unstable at full gain does not oscillate every few seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ..filters import Highpass, clear_highpass, rapid, tune_highpass
from .limits import clamp

CHATTER_HZ = 6.0  # twice first order: of 5 Hz of tremor 41 % pass, of 3 Hz 20 %
WINDOW = 0.05  # [s] of the mean square, exponential
LASTING = 0.2  # [s] for which the force must oscillate, or the robot feed the oscillation
CLIPPED = 3.0  # of the limit: one jolt is no chatter, however hard
QUIET = 0.5  # of the limit: below it the oscillation is over
FALL = 0.1  # [s]
RETURN = 3.0  # [s]
FORGET = 60.0  # [s]
KEPT_SHARE = 0.4  # of the share at which the oscillation began

OUTFLOW_HZ = 2.0  # twice first order, of force and velocity alike: equal phases
POWER_WINDOW = 0.1  # [s] of the means, twice exponential: passes 7 % of the power's ripple at 3 Hz
LOST_SHARE = 0.06  # -mean(F v) / (rms F rms v) from which the robot counts as the source
TURNED = 2.5  # recent reversals of the force that make an oscillation
TURN_FORGET = 1.0  # [s] time constant with which reversals are forgotten
NOTABLE = 0.25  # of the least force: a smaller one of the other sign is no reversal
STEADY = 0.9  # least ratio of the force's mean square to its slower mean: below, it dies away


@dataclass(slots=True)
class Mean:
    """Mean over `POWER_WINDOW`, and the mean of that mean."""

    once: float = 0.0
    twice: float = 0.0


@dataclass(slots=True)
class Guard:
    """The guard's memory; the defaults are a guard that has seen nothing.

    share: of the force gains that remains, 0 to 1; ceiling: largest share to which it may return;
    tripped: the handle oscillates now. Chatter: `chatter`, high pass of the force; mean_square: of
    its output [N^2]; above: time over the limit, weighted by the excess [s]. Outflow: `force` and
    `velocity`, high passes; means of the squares [N^2], [m^2/s^2] and of the power from patient to
    robot [W]; side: of the rapid force, 1 or -1; turns: recent changes of the side, older ones
    count less; fed: time for which the robot has been the source, weighted by the excess [s].
    """

    share: float = 1.0
    ceiling: float = 1.0
    tripped: bool = False
    chatter: Highpass = field(default_factory=Highpass)
    mean_square: float = 0.0
    above: float = 0.0
    force: Highpass = field(default_factory=Highpass)
    velocity: Highpass = field(default_factory=Highpass)
    force_square: Mean = field(default_factory=Mean)
    velocity_square: Mean = field(default_factory=Mean)
    power: Mean = field(default_factory=Mean)
    side: float = 1.0
    turns: float = 0.0
    fed: float = 0.0


def tune_guard(guard: Guard, dt: float) -> None:
    """Prepare the filters for a sample time dt [s]."""
    tune_highpass(guard.chatter, CHATTER_HZ, dt)
    tune_highpass(guard.force, OUTFLOW_HZ, dt)
    tune_highpass(guard.velocity, OUTFLOW_HZ, dt)


def guard_step(guard: Guard, force: float, limit: float, dt: float) -> None:
    """Process a sample of the handle force [N], dt [s] after the last one.

    limit: rms of the rapid force [N], infinite where no force gain acts.
    """
    fast = clamp(rapid(guard.chatter, force), -CLIPPED * limit, CLIPPED * limit)
    guard.mean_square += (fast * fast - guard.mean_square) * min(1.0, dt / WINDOW)
    rms = math.sqrt(guard.mean_square)
    # A stronger oscillation trips the guard sooner, because an instability must not grow.
    guard.above = guard.above + dt * rms / limit if rms > limit else 0.0
    was, fed = guard.tripped, guard.fed > LASTING
    if was:
        guard.tripped = fed or rms > QUIET * limit or guard.share > 0.0
    else:
        guard.tripped = fed or guard.above > LASTING
    guard.ceiling = clamp(guard.ceiling + dt / FORGET, 0.0, 1.0)
    if guard.tripped and not was:
        guard.ceiling = KEPT_SHARE * guard.share
    if guard.tripped:
        share = guard.share - dt / FALL
    else:
        share = min(guard.share + dt / RETURN, guard.ceiling)
    guard.share = clamp(share, 0.0, 1.0)


def outflow_step(guard: Guard, force: float, velocity: float, least: float, dt: float) -> None:
    """Note for how long the robot has fed an oscillation, dt [s] after the last sample.

    force: of the patient on the robot [N] and velocity of the nut [m/s], without a lag between
    them; least: rms of the rapid force below which nothing counts [N].
    """
    fast, speed = rapid(guard.force, force), rapid(guard.velocity, velocity)
    weight = min(1.0, dt / POWER_WINDOW)
    _average(guard.force_square, fast * fast, weight)
    _average(guard.velocity_square, speed * speed, weight)
    _average(guard.power, fast * speed, weight)
    guard.turns *= 1.0 - min(1.0, dt / TURN_FORGET)
    if fast * guard.side < -NOTABLE * least:
        guard.side = -guard.side
        guard.turns += 1.0
    rms = math.sqrt(guard.force_square.twice)
    power = guard.power.twice
    source = power < -LOST_SHARE * rms * math.sqrt(guard.velocity_square.twice)
    lives = guard.force_square.once > STEADY * guard.force_square.twice
    if rms <= least or power >= 0.0 or guard.turns < TURNED:
        guard.fed = 0.0
    elif source and lives:  # else it keeps its value: the power ripples
        guard.fed += dt * rms / least


def forget_chatter(guard: Guard) -> None:
    """Forget all oscillations: the whole share is back."""
    clear_highpass(guard.chatter)
    guard.share, guard.ceiling, guard.tripped = 1.0, 1.0, False
    guard.mean_square, guard.above = 0.0, 0.0


def forget_outflow(guard: Guard) -> None:
    """Forget what the robot fed; the share and the detection of chatter go on."""
    clear_highpass(guard.force)
    clear_highpass(guard.velocity)
    for mean in (guard.force_square, guard.velocity_square, guard.power):
        mean.once = 0.0
        mean.twice = 0.0
    guard.side, guard.turns, guard.fed = 1.0, 0.0, 0.0


def damper_share(guard: Guard) -> float:
    """Return the weight of the damper: 1 while the share is zero, 0 when it is at the ceiling."""
    if guard.share >= guard.ceiling:
        return 0.0
    return 1.0 - guard.share / guard.ceiling


def guarded(share: float) -> str:
    """Return the operator's message for a remaining share of the force gain, 0 to 1."""
    return (
        f"chatter guard: the handle force shakes, {100.0 * share:.0f} % of feedback and friction "
        "model are left, a damper is in their place; hold the handle otherwise, or lower the gain"
    )


def _average(mean: Mean, value: float, weight: float) -> None:
    """Take one more value into both means; weight: of the value."""
    mean.once += weight * (value - mean.once)
    mean.twice += weight * (mean.once - mean.twice)
