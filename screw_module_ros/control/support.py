# SPDX-License-Identifier: Apache-2.0
"""Weight support: the force S that carries the patient's arm, and its end when the hand leaves.

::

    wish [N] --> within what mode and drive allow --> rate --> S --> - damper while the hand is off

S is up positive and belongs to what presses on the hand (`VerticalInput.support`): a law that feeds
the handle's force back delivers it as it does a spring. It is not part of the module's own weight,
which no hand carries.

A handle that a carried hand leaves would fly: the arm weighs up to 20 N (thesis 2.1.1), the module
has 5.5 kg (5.3.3), and its friction is compensated. The hand is off when it presses on no axis,
while the handle gains speed along S. A hand in quick motion presses with nothing for moments too,
but the handle then goes as the hand does, and gains little in that time. Then S falls, and a damper
stops the handle until a hand holds it again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

from ..settings import Setting
from .limits import LONGEST_STEP, clamp, slew


class SupportSettings(NamedTuple):
    """Bounds and rates of the weight support, and when the hand counts as off."""

    up: Annotated[
        float, Setting("largest support upward, with a drive that brakes when its torque goes off",
                       "N", 0.0, 25.0)
    ] = 25.0  # ours
    down: Annotated[
        float, Setting("largest load downward, with such a drive", "N", 0.0, 20.0)
    ] = 20.0  # ours
    coasting: Annotated[
        float, Setting("largest support or load with a drive that coasts then: the arm falls",
                       "N", 0.0, 25.0)
    ] = 8.0  # ours
    rate: Annotated[
        float, Setting("rate at which the support follows what is asked", "N/s", 0.1, 50.0)
    ] = 10.0  # ours
    fade_rate: Annotated[
        float, Setting("rate at which it goes when nobody asks any more, or the mode feeds no "
                       "force back", "N/s", 0.1, 50.0)
    ] = 5.0  # ours
    off_from: Annotated[
        float, Setting("support or load from which a hand that leaves ends it", "N", 0.0, 25.0)
    ] = 8.0  # ours
    off_force: Annotated[
        float, Setting("force on every axis below which no hand may hold the handle", "N", 0.1, 5.0)
    ] = 1.0  # ours
    off_gain: Annotated[
        float, Setting("speed that the handle gains along the support meanwhile until the hand "
                       "counts as off", "m/s", 0.005, 1.0)
    ] = 0.08  # ours
    off_rate: Annotated[
        float, Setting("rate at which the support goes when the hand is off", "N/s", 10.0, 2000.0)
    ] = 500.0  # ours
    off_damping: Annotated[
        float, Setting("damper while the hand is off", "Ns/m", 0.0, 200.0)
    ] = 80.0  # ours
    off_damping_force: Annotated[
        float, Setting("largest force of that damper", "N", 0.0, 45.0)
    ] = 20.0  # ours
    back_force: Annotated[
        float, Setting("force on an axis with which the hand is back", "N", 0.5, 30.0)
    ] = 2.0  # ours
    back_time: Annotated[
        float, Setting("time for which it must press so", "s", 0.0, 5.0)
    ] = 0.05  # ours
    back_rate: Annotated[
        float, Setting("rate at which the support then returns", "N/s", 0.1, 100.0)
    ] = 50.0  # ours


@dataclass(slots=True)
class SupportState:
    """Memory of the support.

    force: S in use [N]; slowest: least speed of the handle along S since the hand presses on no
    axis [m/s], infinite while it does; hand_off: the hand has left; held: time for which it presses
    again, kept until S is back [s].
    """

    force: float = 0.0
    slowest: float = math.inf
    hand_off: bool = False
    held: float = 0.0


class SupportInput(NamedTuple):
    """Inputs of one step.

    wish: support asked for, NaN = nobody asks [N]; largest: that mode and drive allow, up or down
    [N]; acts: torque passes and the law feels the hand; velocity: of the nut [m/s]; force: patient
    on robot along z, side: the larger of the two in the plane [N].
    """

    wish: float
    largest: float
    acts: bool
    velocity: float
    force: float
    side: float


def largest_support(p: SupportSettings, feeds_back: bool, brakes: bool) -> float:
    """Return the largest support [N]: none without the force fed back, little on a coasting drive.

    Friction of 10 N makes it worthless in a mode without feedback. A drive that coasts when its
    torque goes off lets the arm fall.
    """
    if not feeds_back:
        return 0.0
    return p.up if brakes else min(p.up, p.coasting)


def support_step(p: SupportSettings, s: SupportState, u: SupportInput, dt: float) -> float:
    """Return the force on the hand [N] dt [s] after the last step; `SupportState.force` is S.

    S never steps, but for one to zero when the torque goes. An input that is no number moves
    nothing towards it: a wish then counts as none, a force as a hand.
    """
    if not u.acts or not dt > 0.0:
        s.force, s.slowest, s.hand_off, s.held = 0.0, math.inf, False, 0.0
        return 0.0
    dt = min(dt, LONGEST_STEP)
    asked = u.wish == u.wish and u.largest > 0.0
    wanted = clamp(u.wish, -min(p.down, u.largest), u.largest) if asked else 0.0
    rate = p.rate if asked else p.fade_rate
    _watch(p, s, u, dt)
    if s.hand_off:
        wanted, rate = 0.0, p.off_rate
    elif s.held > 0.0 and asked and abs(s.force) < abs(wanted):
        rate = p.back_rate
    else:
        s.held = 0.0
    s.force = slew(s.force, wanted, rate * dt)
    if not s.hand_off:
        return s.force
    if not asked and s.force == 0.0 and abs(u.velocity) < p.off_gain:
        s.hand_off = False  # else who asks next would find a hand missing that only rests
    return s.force - clamp(
        p.off_damping * u.velocity, -p.off_damping_force, p.off_damping_force
    )


def _watch(p: SupportSettings, s: SupportState, u: SupportInput, dt: float) -> None:
    """Find whether the hand is off the handle, or back."""
    if s.hand_off:
        presses = abs(u.force) > p.back_force or u.side > p.back_force
        s.held = s.held + dt if presses else 0.0
        s.hand_off = s.held < p.back_time
        s.slowest = math.inf
        return
    along = u.velocity if s.force > 0.0 else -u.velocity
    light = abs(u.force) < p.off_force and u.side < p.off_force and abs(s.force) >= p.off_from
    s.slowest = min(s.slowest, along) if light else math.inf
    s.hand_off = along - s.slowest > p.off_gain
