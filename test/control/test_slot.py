# SPDX-License-Identifier: Apache-2.0
"""The slot: free in front of its wall, continuous, bounded, the same in every direction."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from screw_module_ros.compiled import compiled
from screw_module_ros.control.slot import (
    OPEN,
    SHORTEST,
    Slot,
    SlotInput,
    SlotLimits,
    half_width_at,
    in_slot,
    in_space,
    initial_state,
    length_of,
    slot_step,
    sound,
    wall_position,
)

DT = 0.002
LIMITS = SlotLimits()
LINE = Slot(target_y=0.14).validated()
ACROSS = Slot(target_x=0.14)

metres = st.floats(-0.3, 0.3)
speeds = st.floats(-1.0, 1.0)
slots = st.builds(
    Slot,
    metres, metres, metres, metres,
    st.floats(0.2, 5.0), st.floats(0.0, 400.0), st.floats(0.0, 400.0), st.floats(0.0, 30.0),
    st.floats(0.01, 0.05), st.floats(0.0, 0.01), st.floats(0.0, 50.0),
)  # fmt: skip
wild = st.floats(allow_nan=True, allow_infinity=True)


def at(x, y, slot=LINE, since=OPEN, velocity=(0.0, 0.0), present=True):
    return SlotInput(x, y, *velocity, present, slot, since)


def settled(inp, limits=LIMITS):
    """The output once everything has faded in, the movement's time standing still."""
    state = initial_state()
    for _ in range(round(2.5 * limits.fade_time / DT)):
        output, state = slot_step(limits, state, inp, DT)
    return output


def test_back_wall_follows_the_minimum_jerk_way():
    for share, expected in ((0.0, 0.0), (0.25, 0.103515625), (0.5, 0.5), (1.0, 1.0), (3.0, 1.0)):
        assert wall_position(LINE, share * LINE.duration) == pytest.approx(0.14 * expected)


WIDE, NARROW = LINE.half_width, LINE.end_half_width
HOLD = Slot(0.1, 0.1, 0.1, 0.1)
POINT = HOLD._replace(duration=0.1, half_width=0.0, end_half_width=0.0)
HEIGHT = Slot(start_x=0.18, target_x=0.32)
PULL = 100.0 * (0.05 - HOLD.half_width)


@pytest.mark.parametrize(
    ("inp", "force"),
    [
        (at(0.0, 0.02, since=0.7), (0.0, 100.0 * (0.07 - 0.02))),  # one that lags is pushed
        (at(0.0, -0.05), (0.0, 0.0)),  # an open slot has no back wall
        (at(0.03, 0.05), (-100.0 * (0.03 - WIDE), 0.0)),  # side walls, which come nearer
        (at(-0.03, 0.139, since=1.4), (100.0 * (0.03 - NARROW), 100.0 * 0.001)),
        (at(0.0, 0.16, since=2.0), (0.0, -100.0 * (0.02 - NARROW))),  # the front wall
        (at(0.0, 0.1, since=1.4), (0.0, 4.0)),  # it grows over time, up to its bound
        (at(0.0, 0.1, since=2.4), (0.0, 4.8)),
        (at(0.0, 0.1, since=3.4), (0.0, 5.6)),
        (at(0.0, 0.12, since=1000.0), (0.0, 0.02 * LIMITS.stiffness)),
        (at(0.1 + 0.03, 0.1 + 0.04, HOLD), (-0.6 * PULL, -0.8 * PULL)),  # round its point
        (at(0.13, 0.1, POINT, since=0.1), (-3.0, 0.0)),  # a tube grows over time too
        (at(0.13, 0.1, POINT, since=2.1), (-0.03 * (100.0 + 2.0 * POINT.growth), 0.0)),
        (at(0.13, 0.1, POINT, since=1000.0), (-0.03 * LIMITS.stiffness, 0.0)),
        (at(0.20, 0.0, HEIGHT, since=0.7), (100.0 * (0.25 - 0.20), 0.0)),  # in one dimension
    ],
)
def test_what_each_wall_gives(inp, force):
    output = settled(inp)
    assert (output.force_x, output.force_y) == pytest.approx(force)


def test_it_tells_where_the_hand_is():
    output = settled(at(0.0, 0.02, since=0.7))
    assert (output.wall, output.along, output.across) == pytest.approx((0.07, 0.02, 0.0))
    assert half_width_at(LINE, 0.7) == pytest.approx(0.5 * (WIDE + NARROW))


@given(slots, st.floats(0.0, 1.0), st.floats(-1.0, 1.0), speeds, speeds, st.floats(-1.0, 10.0))
def test_nothing_but_damping_between_back_wall_and_target(slot, ahead, aside, vx, vy, since):
    assume(length_of(slot) > 0.01)
    length = length_of(slot)
    ux, uy = (slot.target_x - slot.start_x) / length, (slot.target_y - slot.start_y) / length
    wall = wall_position(slot, since)
    # Rounding in the frame's rotation may put a hand that stands on a wall a hair behind it.
    along = wall + (length - wall) * ahead + 1e-9
    across = 0.999 * aside * half_width_at(slot, since)
    x = slot.start_x + along * ux - across * uy
    y = slot.start_y + along * uy + across * ux
    output = settled(at(x, y, slot, since, (vx, vy)), SlotLimits(force=65.0))
    assert (output.force_x, output.force_y) == pytest.approx(
        (-slot.damping * vx, -slot.damping * vy), abs=1e-6
    )


def turned(point, angle):
    """A point or vector, turned by an angle [rad]."""
    (a, b), cosine, sine = point, math.cos(angle), math.sin(angle)
    return a * cosine - b * sine, a * sine + b * cosine


@given(slots, metres, metres, speeds, speeds, st.floats(-1.0, 10.0), st.floats(-math.pi, math.pi))
def test_turning_everything_turns_the_force(slot, x, y, vx, vy, since, angle):
    assume(length_of(slot) > 0.01 or length_of(slot) == 0.0)
    place = turned((x, y), angle)
    other = Slot(*turned(slot[:2], angle), *turned(slot[2:4], angle), *slot[4:])
    plain = settled(at(x, y, slot, since, (vx, vy)))
    found = settled(at(*place, other, since, turned((vx, vy), angle)))
    wanted = turned((plain.force_x, plain.force_y), angle)
    assert (found.force_x, found.force_y) == pytest.approx(wanted, abs=1e-6)
    same_place = pytest.approx(in_slot(slot, x, y), abs=1e-9)
    assert in_slot(other, *place) == same_place or length_of(slot) == 0.0


ACTS = {
    "wait": {"present": True},
    "start": {},
    "late": {"since": 3.0},
    "reopen": {"since": OPEN},
    "leave": {"present": False},
    "other": {"since": OPEN, "present": True},
}
acts = st.lists(
    st.tuples(st.sampled_from(sorted(ACTS)), st.integers(1, 120)), min_size=1, max_size=12
)


def largest_step(state, output):
    """How far the force on a hand at rest may go in a tick [N]: by fades, and the wall's motion."""
    used, fade = state.slot, DT / LIMITS.fade_time
    grown = used.growth * max(state.since - used.duration, 0.0)
    tube = length_of(used) < SHORTEST
    grows = used.side_stiffness if tube else used.back_stiffness
    stiffest = min(max(grows + grown, used.side_stiffness), LIMITS.stiffness)
    wall = 2.0 * DT * 1.875 * max(length_of(used), 0.1) / used.duration
    narrow = 2.0 * DT * used.half_width / used.duration
    lead = math.hypot(output.along, output.across) if tube else max(0.0, output.wall - output.along)
    pressed = stiffest * (wall + narrow + fade * lead) + 2.0 * DT * used.growth * lead
    return fade * LIMITS.force + pressed


@given(acts, st.floats(-0.1, 0.25), st.floats(-0.1, 0.1), slots)
def test_whatever_is_asked_for_the_force_neither_jumps_nor_passes_its_bound(acts, x, y, other):
    state, force, inp = initial_state(), (0.0, 0.0), at(x, y)
    for act, steps in acts:
        inp = inp._replace(**ACTS[act], slot=other if act == "other" else inp.slot)
        if act == "start":
            inp = inp._replace(since=max(inp.since, 0.0))
        for _ in range(steps):
            inp = inp._replace(since=inp.since + DT if inp.since >= 0.0 else inp.since)
            output, state = slot_step(LIMITS, state, inp, DT)
            before, force = force, (output.force_x, output.force_y)
            assert math.dist(force, before) <= largest_step(state, output) + 1e-9
            assert math.hypot(*force) <= LIMITS.force + 1e-9


@given(st.builds(SlotInput, wild, wild, wild, wild, st.booleans(), slots, wild), wild)
def test_anything_at_all_gives_a_finite_bounded_force(inp, dt):
    output, state = slot_step(LIMITS, initial_state()._replace(weight=1.0), inp, dt)
    assert all(map(math.isfinite, output))
    assert math.hypot(output.force_x, output.force_y) <= LIMITS.force + 1e-9
    assert 0.0 <= state.weight <= 1.0


@given(st.lists(wild, min_size=11, max_size=11))
def test_a_slot_that_is_none_gives_no_force(values):
    slot = Slot(*values)
    assume(not sound(slot))
    output, _ = slot_step(LIMITS, initial_state(), at(0.0, 0.0, slot, 1.0), DT)
    assert output.force_x == output.force_y == output.weight == 0.0


def stepped(inputs):
    """Slot in use and its weight for each input, one a tick."""
    state, used = initial_state(), []
    for inp in inputs:
        output, state = slot_step(LIMITS, state, inp, DT)
        used.append((state.slot, output.weight))
    return used


def test_entering_and_leaving_takes_the_fade_time():
    inside = at(0.05, 0.0)
    used = stepped([inside] * 100 + [inside._replace(present=False)] * 100)
    assert [used[k][1] for k in (49, 99, 149, 199)] == pytest.approx([0.5, 1.0, 0.5, 0.0])


def test_another_slot_comes_only_when_the_last_has_gone():
    used = stepped([at(0.05, 0.05)] * 100 + [at(0.05, 0.05, ACROSS)] * 120)
    assert next(weight for slot, weight in used if slot == ACROSS) <= DT / LIMITS.fade_time
    assert used[100][0] == LINE


@given(st.tuples(metres, metres, metres), st.tuples(metres, metres, metres), st.floats(0.0, 1.4))
def test_both_walls_of_a_reach_in_space_are_on_its_line(start, target, since):
    plane, vertical = in_space(start, target, LINE)
    assert plane[:4] == (*start[:2], *target[:2])
    assert vertical[:4] == (start[2], 0.0, target[2], 0.0)
    assume(length_of(plane) > 0.01 and length_of(vertical) > 0.01)
    share = wall_position(plane, since) / length_of(plane)
    assert wall_position(vertical, since) == pytest.approx(share * length_of(vertical), abs=1e-12)
    assert (plane.duration, vertical.growth) == (LINE.duration, LINE.growth)
    height = settled(at(start[2], 0.0, vertical, since)).force_x
    assert height == pytest.approx(
        math.copysign(min(45.0, 100.0 * wall_position(vertical, since)), target[2] - start[2])
    )


@pytest.mark.parametrize(
    ("field", "value"),
    [("duration", 0.0), ("duration", math.inf), ("start_x", 10.1), ("back_stiffness", -1.0),
     ("end_half_width", 0.06)],
)  # fmt: skip
def test_what_is_no_slot_is_never_sound(field, value):
    assert sound(LINE)
    assert not sound(LINE._replace(**{field: value}))


def test_the_first_slot_fades_in_from_nothing():
    output, _ = slot_step(LIMITS, initial_state(), at(0.0, -0.05, LINE, since=1.0), DT)
    assert 0.0 < output.weight < 0.1
    assert 0.0 < math.hypot(output.force_x, output.force_y) < 0.01, "wall and slot fade in, both"


def test_a_half_width_that_grows_is_refused():
    with pytest.raises(ValueError, match="end_half_width"):
        Slot(half_width=0.01, end_half_width=0.02).validated()


def test_compiled_twin_agrees():
    fast, state, twin = compiled(slot_step), initial_state(), initial_state()
    for step in range(300):
        inp = at(0.01 * math.sin(step), 0.001 * step, since=DT * step, present=step % 97 != 0)
        expected, state = slot_step(LIMITS, state, inp, DT)
        found, twin = fast(LIMITS, twin, inp, DT)
        assert tuple(found) == pytest.approx(tuple(expected), abs=1e-12)
