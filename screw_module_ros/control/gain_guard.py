# SPDX-License-Identifier: Apache-2.0
"""Guard of the force gains: a damper, a higher corner, less gain while the robot drives a hand.

No force gain is stable against every load on the handle (colgatehogan1988; the thesis leaves it
open, 6.1, 6.4.3). Two elements watch for the oscillation. Both act in proportion, and both are over
when their cause is over; the corner is remembered for some seconds.

*Passivity* (`Passivity`). Above `RAPID_HZ` the robot shows the hand the resistance

    R = <e v> / <v^2>     [Ns/m]

beside the impedance asked for: e = pressed + force, that of spring and dampers and the patient's, v
the velocity of the nut, both rapid, < > a mean over `WINDOW`. A hand that trembles drives the
robot: R is positive. A robot that drives an oscillation gives power to what holds the handle: R is
negative (passivity observer: hannaford2002). A set point that moves the hand gives power too, but
by `pressed`, which e leaves out. What is missing to `PASSIVE` is `need`. The law puts a damper of
this size into that, so the need does not fall when it acts, but with the time constant `KEPT` once
its cause is over. The damper acts through a high pass: one for all speeds would brake a hand in
motion. Its corner is the caller's, or half of the oscillation's own frequency, sqrt(<a^2> / <v^2>).

Beyond `BEGIN` the force gain falls as well, and is gone at `END`.

*Chatter* (`Chatter`). On a soft contact a heavy arm oscillates at 90 to 140 Hz. There the nut moves
by less than one count, and no velocity shows it. The rms of the force above a corner counts alone,
when it lasts longer than a knock in the play of the screw. It takes the damper as well, which lags
by half a period there.

*Corner* (`raise_corner`). Below its corner w a leaky gain shows a negative resistance that falls as
1 / w (`leaky_gain`). A soft grip wants a higher corner than a heavy hand with a long delay bears:
such a hand would chatter. So what R is below 0 raises the corner at once, as far as the loop's
delay bears it, and it comes back slowly. Rapid force takes it back first, before any gain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ..filters import Highpass, clear_highpass, rapid, tune_highpass

RAPID_HZ = 3.0  # twice first order, of force and velocity alike: equal phases
WINDOW = 0.06  # [s] of the means
PASSIVE = 2.0  # [Ns/m] resistance that the handle shall show at least
MOST_NEED = 150.0  # [Ns/m]
KEPT = 1.0  # [s] time constant with which a need falls
BEGIN, END = 20.0, 100.0  # [Ns/m] need from which the gain falls, at which it is gone
SLOW, QUICK = 20.0, 35.0  # [rad/s] a hand's own motion; from where all of an oscillation counts
OF_FREQUENCY = 0.5  # corner of the damper's high pass, of the oscillation's frequency
LOWEST, HIGHEST = 18.0, 200.0  # [rad/s] of that corner
LEAST_SHARE = 1e-3  # least share of the gain: its filter stays finite
STILL = 1e-9  # [m^2/s^2] added to <v^2>: a nut that does not move shows no resistance

CHATTER_HZ = 40.0  # corner of its high pass; on a wall of 1e6 N/m the plane oscillates at 60 Hz
CHATTER_WINDOW = 0.05  # [s] of the mean square
CLIPPED = 3.0  # limits that one knock counts at most: it is no chatter, however hard
GROWTH = 10.0  # [1/s] of the excess at twice the limit
BORNE = 0.5  # excess from which the gain falls; at 1 more it is gone
RETURN = 3.0  # [s] in which the gain comes back: a wall stays

PER_NEED = 5.0  # [Ns/m] need that raises the corner by one corner as set
TURNED = 3.0  # [rad] that k w of a raised corner may turn in its delay: a rigid hand of 3 kg
MOST_RAISED = 3.5  # corners as set that its contact bears without any delay
FORGOTTEN = 15.0  # [s] in which what the corner has done is forgotten


@dataclass(slots=True)
class Chatter:
    """Memory of the chatter: high pass of the force, mean square of its output [N^2], `excess`,
    which grows while the rms is above the limit and falls below it, and the share that it leaves,
    0 to 1."""

    fast: Highpass = field(default_factory=Highpass)
    mean_square: float = 0.0
    excess: float = 0.0
    share: float = 1.0


@dataclass(slots=True)
class Passivity:
    """Memory of the passivity element.

    error, velocity: high passes; last: rapid velocity of the last sample [m/s]; means of the power
    from patient to robot [W] and of the squares of error [N^2], velocity [m^2/s^2] and acceleration
    [m^2/s^4]; slow: velocity below the damper's corner [m/s]; lacks: what is missing now, need: the
    same while it is kept [Ns/m].
    """

    error: Highpass = field(default_factory=Highpass)
    velocity: Highpass = field(default_factory=Highpass)
    last: float = 0.0
    power: float = 0.0
    error_square: float = 0.0
    velocity_square: float = 0.0
    acceleration_square: float = 0.0
    slow: float = 0.0
    lacks: float = 0.0
    need: float = 0.0


@dataclass(slots=True)
class GainGuard:
    """Both elements, and what they leave.

    share: of the force gains, 0 to 1; corner: of a leaky gain, in corners as set, 1 at least;
    allowed: share of its largest raise that was not rough lately, 0 to 1.
    """

    passivity: Passivity = field(default_factory=Passivity)
    chatter: Chatter = field(default_factory=Chatter)
    share: float = 1.0
    corner: float = 1.0
    allowed: float = 1.0


def tune_guard(guard: GainGuard, dt: float) -> None:
    """Prepare the filters for a sample time dt [s]."""
    tune_highpass(guard.passivity.error, RAPID_HZ, dt)
    tune_highpass(guard.passivity.velocity, RAPID_HZ, dt)
    tune_highpass(guard.chatter.fast, CHATTER_HZ, dt)


def guard_step(
    guard: GainGuard, force: float, error: float, velocity: float, least: float, limit: float,
    dt: float, damper: float = 0.0,
) -> None:  # fmt: skip
    """Judge a sample, dt [s] after the last one.

    force: of the patient on the robot; error: the same with the impedance's force [N]; velocity: of
    the nut, without a lag behind them [m/s]; least: rms of the rapid error below which no
    resistance counts, limit: rms of the force beyond which chatter counts [N]; damper: corner of
    its high pass [rad/s], 0: half of the oscillation's frequency.
    """
    element = guard.passivity
    bound = CLIPPED * least + 2.0 * math.sqrt(element.error_square)  # of one knock
    fast = min(max(rapid(element.error, error), -bound), bound)
    speed = rapid(element.velocity, velocity)
    acceleration, element.last = (speed - element.last) / dt, speed
    weight = min(1.0, dt / WINDOW)
    element.power += weight * (fast * speed - element.power)
    element.error_square += weight * (fast * fast - element.error_square)
    element.velocity_square += weight * (speed * speed - element.velocity_square)
    changes = acceleration * acceleration - element.acceleration_square
    element.acceleration_square += weight * changes
    motion = element.velocity_square + STILL
    frequency = math.sqrt(element.acceleration_square / motion)
    element.need *= math.exp(-dt / KEPT)
    seen = math.sqrt(element.error_square) / least - 1.0
    element.lacks = 0.0
    if seen > 0.0:
        missing = min(max(PASSIVE - element.power / motion, 0.0), MOST_NEED)
        missing *= min(max((frequency - SLOW) / (QUICK - SLOW), 0.0), 1.0)
        element.lacks = min(1.0, seen) * missing
        element.need = max(element.need, element.lacks)
    corner = damper if damper > 0.0 else min(max(OF_FREQUENCY * frequency, LOWEST), HIGHEST)
    element.slow += min(1.0, corner * dt) * (velocity - element.slow)
    by_need = min(max((END - element.need) / (END - BEGIN), 0.0), 1.0)
    guard.share = by_need * chatter_step(guard.chatter, force, limit, dt)


def raise_corner(guard: GainGuard, most: float, rough: float, dt: float) -> None:
    """Raise the corner of a leaky gain with what is missing now, after `guard_step`.

    most: largest raise, in corners as set (`largest_raise`); rough: rms of the rapid force from
    which the corner comes down again [N]; dt: time of the sample [s].
    """
    passed = dt / FORGOTTEN
    guard.allowed = min(1.0, guard.allowed + passed)
    kept = (guard.corner - 1.0) * (1.0 - passed)
    raised = min(max(guard.passivity.lacks / PER_NEED, kept), guard.allowed * (most - 1.0))
    beyond = math.sqrt(guard.chatter.mean_square) / rough - 1.0
    if beyond > 0.0:
        raised *= math.exp(-dt * GROWTH * beyond)
        guard.allowed = min(guard.allowed, raised / max(most - 1.0, STILL))
    guard.corner = 1.0 + raised


def largest_raise(gain: float, cutoff: float, delay: float, dt: float) -> float:
    """Return how far the corner of a leaky gain may be raised, 1 or more, in corners as set.

    gain: k; cutoff: w [Hz]; delay: of the loop, dt: of a sample [s]. A gain k behind a low pass at
    w crosses 1 at k w at most. The loop turns by that times its delay and half a sample, for which
    a command is held in the mean.
    """
    turned = gain * 2.0 * math.pi * cutoff * (delay + 0.5 * dt)
    return min(max(TURNED / max(turned, STILL), 1.0), MOST_RAISED)


def damper_force(guard: GainGuard, velocity: float, weight: float, most: float) -> float:
    """Return the force that the damper takes from the spring's [N].

    velocity: of the nut [m/s]; weight: of the parts that the guard watches over, 0 to 1; most:
    largest damper [Ns/m]. The high pass passes 1 / (1 + OF_FREQUENCY^2) of the oscillation in
    phase with its velocity; the damper is larger by as much. Chatter is what no velocity shows: no
    damper meets it, so it leaves as much of the damper as of the gain.
    """
    element = guard.passivity
    size = min((1.0 + OF_FREQUENCY * OF_FREQUENCY) * element.need, most)
    return weight * guard.chatter.share * size * (velocity - element.slow)


def chatter_step(chatter: Chatter, force: float, limit: float, dt: float) -> float:
    """Return the share of the gain that chatter leaves, 0 to 1.

    force: one sample [N], dt [s] after the last one; limit: rms above the corner [N].
    """
    fast = min(max(rapid(chatter.fast, force), -CLIPPED * limit), CLIPPED * limit)
    chatter.mean_square += min(1.0, dt / CHATTER_WINDOW) * (fast * fast - chatter.mean_square)
    over = math.sqrt(chatter.mean_square) / limit - 1.0
    change = GROWTH * over if over > 0.0 else -1.0 / RETURN
    chatter.excess = min(max(chatter.excess + dt * change, 0.0), BORNE + 1.0)
    chatter.share = min(1.0, 1.0 + BORNE - chatter.excess)
    return chatter.share


def leaky_gain(
    fed: float, error: float, share: float, gain: float, cutoff: float, dt: float
) -> float:
    """Return the feedback of a force error [N], dt [s] after `fed` [N].

    A gain k behind a low pass at w is the leaky integral k w / (s + w). To an oscillation it shows
    the resistance -M k w W^2 / ((w + k w)^2 + W^2) at a frequency W. The guard's share makes it
    leak faster and leaves k w: the gain falls at all frequencies, and so does that negative
    resistance. Less of k alone would raise it first. A larger w makes it smaller below (1 + k) w,
    and k w larger.

    error: mean over the sample, as a bilinear low pass [N]; share: 0 to 1; gain: k; cutoff: w [Hz].
    """
    share = max(share, LEAST_SHARE)
    kept = math.exp(-2.0 * math.pi * cutoff / share * dt)
    return kept * fed + (1.0 - kept) * share * gain * error


def forget_chatter(chatter: Chatter) -> None:
    """Forget the oscillation: the whole share is back."""
    clear_highpass(chatter.fast)
    chatter.mean_square, chatter.excess, chatter.share = 0.0, 0.0, 1.0


def forget(guard: GainGuard) -> None:
    """Forget all oscillations: the whole share is back."""
    element = guard.passivity
    clear_highpass(element.error)
    clear_highpass(element.velocity)
    element.last = element.power = element.error_square = element.velocity_square = 0.0
    element.acceleration_square = element.slow = element.lacks = element.need = 0.0
    forget_chatter(guard.chatter)
    guard.share = guard.corner = guard.allowed = 1.0


def guarded(share: float) -> str:
    """Return the operator's message for a remaining share of the force gain, 0 to 1."""
    return (
        f"chatter guard: the robot drives what holds the handle, {100.0 * share:.0f} % of feedback "
        "or friction model are left, a damper is in their place; hold the handle otherwise, or "
        "lower the gain"
    )
