# SPDX-License-Identifier: Apache-2.0
"""The support of the arm: bounds, rates, what is no number, and when the hand counts as off."""

from __future__ import annotations

import math
from dataclasses import astuple
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from law_runs import DT, VERTICAL, initial_state, vertical_outputs

from screw_module_ros.compiled import compiled, packed
from screw_module_ros.control.envelope import LEAVE
from screw_module_ros.control.modes import FORCE_FEEDBACK, IMPEDANCE, OFF
from screw_module_ros.control.support import (
    SupportInput,
    SupportSettings,
    SupportState,
    largest_support,
    support_step,
)
from screw_module_ros.control.vertical import VerticalInput

P = SupportSettings()
CARRIED = SupportInput(20.0, 25.0, True, 0.0, -20.0, 0.0)
"""A hand that hangs still on the handle, for which 20 N are asked."""
AT_REST = VerticalInput(FORCE_FEEDBACK, 0.18, 0.0, 0.0, 0.18, 0.0, True)
ANY = st.floats(allow_nan=True, allow_infinity=True)


def forces(inputs, state=None):
    """Return the force of each step [N]."""
    state = state or SupportState()
    return [support_step(P, state, inp, DT) for inp in inputs]


def carrying(wish=20.0):
    """Return the memory of a support that is all there."""
    return SupportState(force=wish)


@pytest.mark.parametrize(
    ("feeds_back", "brakes", "largest"),
    [(True, True, 25.0), (True, False, 8.0), (False, True, 0.0), (False, False, 0.0)],
)
def test_mode_and_drive_bound_it(feeds_back, brakes, largest):
    assert largest_support(P, feeds_back, brakes) == largest


@pytest.mark.parametrize(
    ("wish", "largest", "reached"),
    [(12.0, 25.0, 12.0), (99.0, 25.0, 25.0), (-99.0, 25.0, -20.0), (20.0, 8.0, 8.0),
     (-20.0, 8.0, -8.0), (math.inf, 25.0, 25.0)],
)  # fmt: skip
def test_it_comes_at_its_rate_up_to_its_bound(wish, largest, reached):
    made = forces([CARRIED._replace(wish=wish, largest=largest)] * 3000)
    assert made[-1] == pytest.approx(reached)
    assert made[199] == pytest.approx(math.copysign(2.0, reached), rel=1e-6)
    assert max(abs(b - a) for a, b in pairwise(made)) <= P.rate * DT * (1.0 + 1e-9)


@pytest.mark.parametrize("gone", [{"wish": math.nan}, {"largest": 0.0}])
def test_it_goes_slowly_when_nobody_asks_or_the_mode_refuses(gone):
    made = forces([CARRIED._replace(**gone)] * 4100, carrying())
    assert made[999] == pytest.approx(15.0) and made[-1] == 0.0


def test_without_torque_it_is_gone_at_once_and_comes_back_from_nothing():
    state = carrying()
    state.hand_off = True
    assert forces([CARRIED._replace(acts=False)], state) == [0.0]
    assert astuple(state) == astuple(SupportState())
    assert forces([CARRIED] * 100, state)[-1] == pytest.approx(1.0)


INPUTS = st.tuples(ANY, st.sampled_from([0.0, 8.0, 25.0]), st.booleans(), ANY, ANY, ANY)


@given(inputs=st.lists(INPUTS, max_size=30), dt=st.sampled_from([DT, 0.0, math.nan, 9.0]))
def test_whatever_comes_it_is_a_number_within_its_bounds(inputs, dt):
    state = SupportState()
    for one in inputs:
        force = support_step(P, state, SupportInput(*one), dt)
        assert -P.down <= state.force <= P.up
        assert abs(force - state.force) <= P.off_damping_force


def leaves(wish, gained, force=0.0, side=0.0, seconds=0.02):
    """Yield inputs: a hand that leaves a handle, which then gains speed [m/s] along the support."""
    yield CARRIED._replace(wish=wish, force=-wish)
    for tick in range(round(seconds / DT)):
        velocity = math.copysign(gained * tick * DT / seconds, wish)
        yield CARRIED._replace(wish=wish, velocity=velocity, force=force, side=side)


@pytest.mark.parametrize("wish", [20.0, -20.0, 8.0, -8.0])
def test_a_handle_that_flies_is_caught(wish):
    state = carrying(wish)
    made = forces(leaves(wish, 0.2), state)
    assert state.hand_off
    assert abs(state.force) < abs(wish), "it falls"
    assert made[-1] == pytest.approx(state.force - math.copysign(80.0 * 0.19, wish))
    flies = CARRIED._replace(wish=wish, velocity=math.copysign(1.0, wish), force=0.0)
    made = forces([flies] * 60, state)
    assert state.force == 0.0 and made[-1] == -math.copysign(20.0, wish)


@pytest.mark.parametrize(
    ("wish", "inputs"),
    [
        (20.0, leaves(20.0, 0.07)),  # it hardly gains speed
        (7.9, leaves(7.9, 0.2)),  # little support
        (20.0, leaves(20.0, 0.2, force=1.1)),  # a hand presses
        (20.0, leaves(20.0, 0.2, side=1.1)),  # it presses sideways
        (20.0, leaves(20.0, 0.2, force=math.nan)),  # nobody knows
        (20.0, leaves(-20.0, 0.2)),  # it goes against the support
        (20.0, [CARRIED._replace(velocity=0.7, force=0.0)] * 300),  # a quick hand, even for 0.3 s
    ],
)
def test_a_hand_on_the_handle_is_not_taken_for_one_that_left(wish, inputs):
    state = carrying(wish)
    forces([one._replace(wish=wish) for one in inputs], state)
    assert not state.hand_off and state.force == wish


def test_it_returns_when_the_hand_presses_for_a_while():
    state = carrying()
    forces([*leaves(20.0, 0.2), *[CARRIED._replace(force=0.0)] * 100], state)
    assert state.force == 0.0 and state.hand_off
    forces([CARRIED._replace(force=-3.0)] * 45, state)
    forces([CARRIED._replace(force=-1.9)], state)
    forces([CARRIED._replace(force=-3.0)] * 45, state)
    assert state.hand_off, "not for 0.05 s yet"
    made = forces([CARRIED._replace(side=4.0)] * 600, state)
    assert not state.hand_off and made[-1] == 20.0
    assert max(b - a for a, b in pairwise(made)) == pytest.approx(P.back_rate * DT)


def test_a_hand_that_only_rests_is_no_missing_one_for_who_asks_next():
    state = SupportState(hand_off=True)
    resting = CARRIED._replace(force=0.0)
    forces([resting] * 1000, state)
    assert state.hand_off, "somebody still asks"
    flying = resting._replace(wish=math.nan, velocity=0.3)
    assert forces([flying], state)[0] < 0.0 and state.hand_off, "the damper is still needed"
    forces([flying._replace(velocity=0.0)], state)
    assert not state.hand_off
    assert forces([resting] * 2000, state)[-1] == 20.0


def test_the_compiled_step_is_the_plain_one():
    inputs = [*leaves(20.0, 0.2), *[CARRIED] * 300, CARRIED._replace(acts=False), CARRIED]
    kept, plain, step = packed(carrying()), carrying(), compiled(support_step)
    for inp in inputs:
        assert step(P, kept[0], inp, DT) == support_step(P, plain, inp, DT)
    assert tuple(kept[0].item() if hasattr(kept[0], "item") else kept[0]) == astuple(plain)


# In the envelope ---------------------------------------------------------------------------


def pressed(inputs, settings=VERTICAL, state=None):
    """Return what presses on the hand in each step [N]."""
    return [output.impedance for output in vertical_outputs(inputs, settings, state)]


def test_it_presses_with_all_of_its_weight_while_the_law_still_fades_in():
    assert pressed([AT_REST._replace(support=5.0)])[0] == pytest.approx(5.0)


def test_a_slot_does_not_replace_it():
    slotted = AT_REST._replace(slot_force=3.0, slot_weight=1.0, support=12.0)
    assert pressed([slotted] * 1000)[-1] == pytest.approx(15.0)


@pytest.mark.parametrize(("target", "support", "most"), [(0.36, 25.0, 65.0), (0.0, -20.0, -45.0)])
def test_with_the_law_it_keeps_to_the_limits_of_the_endpoint(target, support, most):
    stiff = VERTICAL._replace(stiffness=800.0)
    far = AT_REST._replace(setpoint_position=target, support=support)
    made = pressed([far] * 2000, stiff)
    assert made[-1] == most and max(map(abs, made)) <= abs(most)
    assert pressed([AT_REST._replace(support=support)] * 2000, stiff)[-1] == support


@pytest.mark.parametrize("mode", [OFF, LEAVE, IMPEDANCE])
def test_it_stays_through_other_modes_with_the_modules_weight(mode):
    """Whoever asks takes it away slowly; as long as there is some, the weight is carried."""
    state = initial_state()
    vertical_outputs([AT_REST._replace(support=20.0)] * 1500, state=state)
    held = vertical_outputs([AT_REST._replace(mode=mode, support=20.0)] * 1500, state=state)
    assert all(output.impedance == pytest.approx(20.0) for output in held)
    assert all(output.gravity == pytest.approx(VERTICAL.gravity) for output in held)
    gone = vertical_outputs([AT_REST._replace(mode=OFF)] * 1000, state=state)
    assert gone[-1].force == 0.0


@pytest.mark.parametrize("odd", [math.nan, math.inf, 1e300])
def test_a_support_that_is_no_number_gives_no_force(odd):
    assert vertical_outputs([AT_REST._replace(support=odd)])[0].force == 0.0
