# SPDX-License-Identifier: Apache-2.0
"""The slot: assistance as needed along the line to a target (krebs2003).

::

          side wall                          X: along the line from start to target
    ------------------------__________       Y: across, to the left of X
    back wall ->   hand      target   | front wall
    ------------------------~~~~~~~~~~
          side wall

The back wall moves along the minimum-jerk reach to the target and pushes a hand that lags. The side
walls keep the hand near the line; their distance shrinks linearly. In front of the back wall only
damping acts. After the duration of the movement the back wall stiffens slowly up to its bound.
Before the start of the movement the slot is open: it has no back wall. The front wall holds a hand
that overshoots; it is our addition, because the published slot ends at the target.

For a single axis, start_y = target_y and everything across is zero. A slot without length is a
tube: its side wall holds the hand near the point, and stiffens as a back wall does. A reach in
space uses one slot in the plane and one on the vertical with the same start tick; their back walls
together move on the line in space.

Nothing jumps: the force fades in and out over `fade_time`, and so does the back wall. A new slot
starts only after the old one has faded out. The force is bounded.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..settings import Setting, validated
from .limits import FARTHEST, LONGEST_STEP, clamp, is_real, slew
from .minimum_jerk import way

SHORTEST = 1e-3  # [m]; a slot shorter than this has no direction
OPEN = -1.0
"""Value of the time since the start [s] for a movement that has not started."""


class SlotLimits(NamedTuple):
    """Limits of every slot.

    The force is what the thesis requires at the handle in the plane (appendix D); the rest is ours.
    """

    force: Annotated[
        float, Setting("largest force of a slot", "N", 0.0, 65.0)
    ] = 45.0  # thesis: d_static_force
    stiffness: Annotated[
        float, Setting("stiffest wall of a slot", "N/m", 0.0, 2000.0)
    ] = 800.0  # ours
    damping: Annotated[
        float, Setting("largest damping of a slot", "Ns/m", 0.0, 100.0)
    ] = 30.0  # ours
    fade_time: Annotated[
        float, Setting("time in which a slot and its back wall fade in and out", "s", 0.05, 5.0)
    ] = 0.2  # ours


class Slot(NamedTuple):
    """One slot.

    The default duration and damping are those of the clock game of this family of robots. The
    stiffness is MANUS's usual 100 N/m (thesis 6.1). Widths and growth are ours.
    """

    start_x: Annotated[float, Setting("start", "m", -1.0, 1.0)] = 0.0  # ours
    start_y: Annotated[float, Setting("start", "m", -1.0, 1.0)] = 0.0  # ours
    target_x: Annotated[float, Setting("target", "m", -1.0, 1.0)] = 0.0  # ours
    target_y: Annotated[float, Setting("target", "m", -1.0, 1.0)] = 0.0  # ours
    duration: Annotated[
        float, Setting("duration of the reach", "s", 0.1, 30.0)
    ] = 1.4  # public program: imtclock
    back_stiffness: Annotated[
        float, Setting("spring of the back wall", "N/m", 0.0, 2000.0)
    ] = 100.0  # thesis: usual_spring
    side_stiffness: Annotated[
        float, Setting("spring of side walls and front wall", "N/m", 0.0, 2000.0)
    ] = 100.0  # ours: as back_stiffness
    damping: Annotated[
        float, Setting("damper in the whole slot", "Ns/m", 0.0, 100.0)
    ] = 5.0  # public program: imtclock
    half_width: Annotated[
        float, Setting("distance from the line to a side wall at the start", "m", 0.0, 0.5)
    ] = 0.01  # ours: the hit radius
    end_half_width: Annotated[
        float, Setting("distance to a side wall at the end, and to the front wall", "m", 0.0, 0.5)
    ] = 0.002  # ours
    growth: Annotated[
        float, Setting("rate at which back wall or tube stiffens over time", "N/m/s", 0.0, 500.0)
    ] = 20.0  # ours

    def validated(self) -> Slot:
        """Return self when every field is in its range and the half width does not grow.

        Raises ValueError naming the field, its value and the range.
        """
        validated(self)
        if self.end_half_width > self.half_width:
            raise ValueError(
                f"Slot: end_half_width = {self.end_half_width!r} m: must not be more than "
                f"half_width = {self.half_width:g} m"
            )
        return self


class Reach(NamedTuple):
    """Where slots may start and lead, from low to high on both axes [m]; one axis is x alone."""

    low_x: float
    high_x: float
    low_y: float = 0.0
    high_y: float = 0.0


class SlotInput(NamedTuple):
    """Inputs of one step.

    x, y [m], vx, vy [m/s]: hand; present: `slot` is wanted; since: time since the start of the
    movement [s], negative while the slot is open.
    """

    x: float
    y: float
    vx: float
    vy: float
    present: bool
    slot: Slot
    since: float


class SlotOutput(NamedTuple):
    """Force and the quantities behind it.

    force_x, force_y: on the hand, faded and bounded [N]; weight: 0 to 1, the share of spring and
    damper that the slot replaces; along, across: hand in X and Y [m]; wall: back wall in X [m].
    """

    force_x: float
    force_y: float
    weight: float
    along: float
    across: float
    wall: float


class SlotState(NamedTuple):
    """Memory of the law: slot in use, its time since the start [s], both weights, 0 to 1."""

    slot: Slot
    since: float
    weight: float
    wall_weight: float


def initial_state() -> SlotState:
    """Return the state without a slot."""
    return SlotState(Slot(), OPEN, 0.0, 0.0)


def slot_step(
    limits: SlotLimits, state: SlotState, inp: SlotInput, dt: float
) -> tuple[SlotOutput, SlotState]:
    """Return the slot's force and the next state, dt [s] after the last step.

    A measurement that is not finite or not plausible, or an invalid slot, gives zero force at once;
    the caller decides what to do.
    """
    if not _real(inp, dt) or (inp.present and not sound(inp.slot)):
        return SlotOutput(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), SlotState(state.slot, OPEN, 0.0, 0.0)
    dt = min(dt, LONGEST_STEP)
    now = _moved_on(limits, state, inp, dt)
    slot = now.slot
    along, across = in_slot(slot, inp.x, inp.y)
    wall = wall_position(slot, now.since)
    pull_x, pull_y = _walls(limits, now, inp, along, across, wall)
    damping = min(slot.damping, limits.damping)
    force_x, force_y = pull_x - damping * inp.vx, pull_y - damping * inp.vy
    size = math.hypot(force_x, force_y)
    kept = now.weight * (limits.force / size if size > limits.force else 1.0)
    return SlotOutput(force_x * kept, force_y * kept, now.weight, along, across, wall), now


def in_space(
    start: tuple[float, float, float], target: tuple[float, float, float], like: Slot
) -> tuple[Slot, Slot]:
    """Return the slots in the plane and on the vertical for a reach in space.

    start, target: x, y, z [m]; like: a slot with all other values. With the same time since the
    start, both back walls move as one wall on the line in space.
    """
    rest = like[4:]
    return (
        Slot(start[0], start[1], target[0], target[1], *rest),
        Slot(start[2], 0.0, target[2], 0.0, *rest),
    )


def kept_within(slot: Slot, reach: Reach) -> Slot:
    """Return the slot with start and target moved to the nearest place within reach."""
    return slot._replace(
        start_x=clamp(slot.start_x, reach.low_x, reach.high_x),
        start_y=clamp(slot.start_y, reach.low_y, reach.high_y),
        target_x=clamp(slot.target_x, reach.low_x, reach.high_x),
        target_y=clamp(slot.target_y, reach.low_y, reach.high_y),
    )


def length_of(slot: Slot) -> float:
    """Return the distance from start to target [m]."""
    return math.hypot(slot.target_x - slot.start_x, slot.target_y - slot.start_y)


def wall_position(slot: Slot, since: float) -> float:
    """Return the back wall's X [m], `since` [s] after the start; zero while the slot is open."""
    return length_of(slot) * way(since / slot.duration)


def half_width_at(slot: Slot, since: float) -> float:
    """Return the distance from the line to a side wall [m], `since` [s] after the start."""
    share = clamp(since / slot.duration, 0.0, 1.0)
    return slot.half_width + (slot.end_half_width - slot.half_width) * share


def in_slot(slot: Slot, x: float, y: float) -> tuple[float, float]:
    """Return a point's X and Y in the slot [m]; without a direction, X is along x."""
    length = length_of(slot)
    dx, dy = x - slot.start_x, y - slot.start_y
    if length < SHORTEST:
        return dx, dy
    ux, uy = (slot.target_x - slot.start_x) / length, (slot.target_y - slot.start_y) / length
    return dx * ux + dy * uy, dy * ux - dx * uy


def sound(slot: Slot) -> bool:
    """Return whether a slot is usable; comparisons with NaN are false."""
    return (
        abs(slot.start_x) <= FARTHEST
        and abs(slot.start_y) <= FARTHEST
        and abs(slot.target_x) <= FARTHEST
        and abs(slot.target_y) <= FARTHEST
        and 0.0 < slot.duration < math.inf
        and 0.0 <= slot.back_stiffness < math.inf
        and 0.0 <= slot.side_stiffness < math.inf
        and 0.0 <= slot.damping < math.inf
        and 0.0 <= slot.end_half_width <= slot.half_width < math.inf
        and 0.0 <= slot.growth < math.inf
    )


def _real(inp: SlotInput, dt: float) -> bool:
    """Return whether a measurement can be real; comparisons with NaN are false."""
    since = not inp.present or abs(inp.since) < math.inf
    return is_real(inp.x, inp.vx, 0.0) and is_real(inp.y, inp.vy, 0.0) and since and dt > 0.0


def _moved_on(limits: SlotLimits, state: SlotState, inp: SlotInput, dt: float) -> SlotState:
    """Return the state dt [s] later: the slot in use fades out before another one comes."""
    step = dt / limits.fade_time
    if state.weight == 0.0:
        if not inp.present:
            return SlotState(state.slot, OPEN, 0.0, 0.0)
        slot, weight, wall_weight, target = inp.slot, 0.0, 0.0, 1.0
        since = inp.since if inp.since >= 0.0 else OPEN
    else:
        slot, weight, wall_weight = state.slot, state.weight, state.wall_weight
        reopened = state.since >= 0.0 and inp.since < 0.0
        stays = inp.present and inp.slot == state.slot and not reopened
        since = _time_on(state.since, inp.since if stays else state.since + dt, dt)
        target = 1.0 if stays else 0.0
    wall_target = 1.0 if since >= 0.0 else 0.0
    return SlotState(slot, since, slew(weight, target, step), slew(wall_weight, wall_target, step))


def _time_on(before: float, since: float, dt: float) -> float:
    """Return the time since the start [s]; it never decreases and catches up at double speed."""
    if since < 0.0:
        return OPEN
    begun = max(before, 0.0)
    return clamp(since, begun, begun + 2.0 * dt)


def _walls(
    limits: SlotLimits, now: SlotState, inp: SlotInput, along: float, across: float, wall: float
) -> tuple[float, float]:
    """Return the force of all walls along x and y [N]."""
    slot = now.slot
    grown = slot.growth * max(0.0, now.since - slot.duration)
    side = min(slot.side_stiffness, limits.stiffness)
    half = half_width_at(slot, now.since)
    length = length_of(slot)
    if length < SHORTEST:
        distance = math.hypot(along, across)
        if distance <= half:
            return 0.0, 0.0
        stiff = min(slot.side_stiffness + grown, limits.stiffness)
        pull = -stiff * (distance - half) / distance
        return pull * along, pull * across
    stiff = min(slot.back_stiffness + grown, limits.stiffness)
    back = now.wall_weight * stiff * max(0.0, wall - along)
    push = back - side * max(0.0, along - length - slot.end_half_width)
    hold = -side * (across - clamp(across, -half, half))
    ux, uy = (slot.target_x - slot.start_x) / length, (slot.target_y - slot.start_y) / length
    return push * ux - hold * uy, push * uy + hold * ux
