# SPDX-License-Identifier: Apache-2.0
"""Set point and slot in the loops: renewed or gone, refused when they cannot be, no jump."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from law_runs import PLANAR, UNKNOWN, VERTICAL, planar_outputs, plane_at, vertical_outputs

from screw_module_ros.control import vertical
from screw_module_ros.control.modes import IMPEDANCE, OFF
from screw_module_ros.control.slot import Reach, Slot, SlotLimits
from screw_module_ros.loop.inputs import Guide, SetpointInput

LINE = Slot(target_y=0.14)
REACH = Reach(-1.0, 1.0, -1.0, 1.0)
MS = 1_000_000
DT = 0.002


@pytest.fixture
def guide():
    return Guide(SlotLimits(), REACH)


@pytest.mark.parametrize("every", [1, 20])
def test_a_wall_goes_by_the_start_tick(guide, every):
    """Half of the way, 7 cm, at half of 1.4 s after the start at 100 ms: in step 400."""
    forces = []
    for step in range(1, 401):
        if step % every == 1 % every:
            guide.ask(LINE, 100 * MS, 2 * MS * step)
        forces.append(guide.guidance(0.0, 0.0, 0.0, 0.0, 2 * MS * step, DT).force_y)
    assert not any(forces[:49])
    assert forces[-1] == pytest.approx(100.0 * 0.07, rel=1e-6)


def test_a_slot_that_cannot_be_is_refused_and_none_is_left(guide):
    guide.ask(LINE, 0, MS)
    assert not guide.free
    with pytest.raises(ValueError, match="duration"):
        guide.ask(LINE._replace(duration=math.nan), 0, MS)
    assert guide.free
    assert guide.guidance(0.03, 0.0, 0.0, 0.0, 2 * MS, DT).weight == 0.0


def test_no_slot_ends_the_one_there_is(guide):
    guide.ask(LINE, 0, MS)
    guide.ask(None, 0, MS)
    assert guide.free


def test_a_slot_is_kept_within_reach():
    """Beyond the end its back wall would push the hand with all of its 45 N."""
    guide = Guide(SlotLimits(), Reach(0.0, 0.36))
    beyond = Slot(start_x=0.25, target_x=0.6, duration=0.1, back_stiffness=800.0, growth=0.0)
    for step in range(1, 500):
        guide.ask(beyond, 1, 2 * MS * step)
        found = guide.guidance(0.35, 0.0, 0.0, 0.0, 2 * MS * step, DT)
    assert found.weight == 1.0
    assert found.force_x == pytest.approx(800.0 * 0.01)


def test_slots_have_the_reach_of_set_points(enabled):
    law, plane = enabled.controller.settings, enabled.plane.controller.settings
    wide, deep = plane.half_width, plane.half_depth
    for _ in range(2):
        assert enabled.controller.guide.reach == Reach(law.travel_low, law.travel_high)
        assert enabled.plane.controller.guide.reach == Reach(-wide, wide, -deep, deep)
        enabled.plane.restart()


def slotted(inp, force_x, force_y, weight):
    return inp._replace(slot_x=force_x, slot_y=force_y, slot_weight=weight)


@given(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))
def test_the_plane_takes_the_slot_for_its_spring_and_gives_it_back_without_a_jump(x, y, gx, gy):
    weights = [0.0] * 300 + [k / 100 for k in range(100)] + [1.0] * 50
    weights += [1.0 - k / 100 for k in range(100)] + [0.0] * 20
    inp = plane_at(x, y, (gx, gy, 0.0, 0.0))
    outputs = planar_outputs([slotted(inp, 3.0 * w, -2.0 * w, w) for w in weights])
    forces = [(output.force_x, output.force_y) for output in outputs]
    # Fading 31 N in 0.2 s, and a set point that runs 0.6 m/s at 100 N/m, take so much a step.
    largest = 0.01 * 40.0 + 2.0 * 0.6 * DT * 100.0
    assert max(map(math.dist, [(0.0, 0.0), *forces], [*forces, forces[-1]])) <= largest
    for k in range(400, 450):
        assert forces[k] == pytest.approx((3.0, -2.0))
        assert (outputs[k].desired_x, outputs[k].desired_y) == pytest.approx((x, y), abs=1e-9)


def test_the_vertical_takes_the_slot_for_its_spring():
    weights = [min(1.0, step / 200) for step in range(1500)]
    outputs = vertical_outputs(
        vertical.VerticalInput(IMPEDANCE, 0.2, 0.0, 0.0, 0.3, 0.0, True, 5.0 * weight, weight)
        for weight in weights
    )
    assert outputs[-1].impedance == pytest.approx(5.0)
    assert outputs[-1].desired_position == pytest.approx(0.2)
    steps = [abs(b.force - a.force) for a, b in pairwise(outputs)]
    assert max(steps) <= VERTICAL.force_rate * 0.001 + 1e-9


@given(st.floats(allow_nan=True, allow_infinity=True), st.floats(allow_nan=True))
def test_a_slot_force_that_is_none_gives_no_torque(force, weight):
    inp = slotted(plane_at(0.0, 0.05, (0.0, 0.0, 0.0, 0.0)), force, 0.0, weight)
    (output,) = planar_outputs([inp])
    assert all(map(math.isfinite, output))
    assert math.hypot(output.force_x, output.force_y) <= PLANAR.force_limit + 1e-9
    if not (abs(force) <= 1e5 and 0.0 <= weight <= 1.0):
        assert (output.shoulder_torque, output.elbow_torque) == (0.0, 0.0)


# -- how long a set point counts that nobody repeats -----------------------------------------------


@pytest.mark.parametrize(
    ("age_ns", "acts", "position", "velocity"),
    [
        (200_000_000, True, (0.1, -0.2), (0.3, 0.4)),
        (200_000_001, True, (0.1, -0.2), (0.0, 0.0)),
        (1_000_000_000, False, (0.1, -0.2), (0.0, 0.0)),
        (1_000_000_001, False, UNKNOWN, (0.0, 0.0)),
        (100_000_000_000, True, (0.1, -0.2), (0.0, 0.0)),
    ],
)
def test_what_is_left_of_a_set_point(age_ns, acts, position, velocity):
    given, wanted = SetpointInput(axes=2), (*position, *velocity)
    assert given.at(1, True) == pytest.approx((*UNKNOWN, 0.0, 0.0), nan_ok=True)
    given.ask((0.1, -0.2), (0.3, 0.4), 1)
    assert given.at(1 + age_ns, acts) == pytest.approx(wanted, nan_ok=True)
    # What was forgotten does not come back with the torque.
    assert given.at(1 + age_ns, True) == pytest.approx(wanted, nan_ok=True)


@pytest.mark.parametrize("pause_s", [0.2, 1.1])
@pytest.mark.parametrize("disabled", [False, True])
def test_it_does_not_pull_to_where_a_game_was(enabled, disabled, pause_s, monkeypatch):
    """Its page was closed; the patient was strapped in again somewhere else."""
    controller, mode = enabled.controller, enabled.controller.mode
    controller.wanted.ask((enabled.home + 0.1,), (0.0,), enabled.now_ns)
    monkeypatch.setattr(controller.wanted, "ask", lambda *_: None)
    enabled.seconds(0.1)
    if disabled:
        assert enabled.disable() == ""
    else:
        controller.mode = OFF
    enabled.seconds(pause_s)
    controller.mode = mode
    assert enabled.enable() == ""
    enabled.seconds(0.8)
    is_at_it = abs(controller.output.desired_position - enabled.home - 0.1) < 0.01
    assert is_at_it == (pause_s < 1.0)
