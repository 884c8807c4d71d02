# SPDX-License-Identifier: Apache-2.0
"""The vertical law: its equations when settled, its bounds under anything at all."""

import math
from itertools import product

import pytest

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import modes
from screw_module_ros.control.friction import friction_force
from screw_module_ros.control.vertical import VerticalInput, initial_state, vertical_step
from screw_module_ros.control.vertical_settings import VerticalSettings

MODEL = thesis_friction()
SETTINGS = VerticalSettings().validated()
DT = 0.001
REST = VerticalInput(modes.IMPEDANCE, 0.10, 0.0, 0.0, 0.18, 0.0, True)


def run(inp, seconds=3.0, law=SETTINGS, state=None):
    """Output and state after an input has stood still for some time."""
    state = state or initial_state(law)
    output = None
    for _ in range(round(seconds / DT)):
        output = vertical_step(law, MODEL, state, inp, DT)
    return output, state


def moved(inp, seconds=0.4, law=SETTINGS):
    """Output and last input after an input has stood still and then moved at its velocity."""
    _, state = run(inp._replace(velocity=0.0), law=law)
    for _ in range(round(seconds / DT)):
        inp = inp._replace(position=inp.position + inp.velocity * DT)
        state.presliding.ratio = 1.0  # no mechanism answers: there is nothing to compare
        output = vertical_step(law, MODEL, state, inp, DT)
    return output, inp


def test_impedance_is_spring_and_gravity():
    output, _ = run(REST)
    assert output.impedance == pytest.approx(100.0 * 0.08)
    assert output.gravity == 10.0
    assert output.force == pytest.approx(18.0)
    assert (output.friction, output.feedback, output.saturated) == (0.0, 0.0, False)


@pytest.mark.parametrize("mode", modes.MODE_NAMES)
def test_what_feeds_the_force_back_is_known_to_need_a_force_sample(mode):
    """The gates of force sample and certificate ask `uses_force`: a mode must not pass by them."""
    at_rest = REST._replace(mode=mode, position=0.18)
    pushed, pulled = (run(at_rest._replace(force=force))[0].force for force in (3.0, -3.0))
    assert (pushed != pulled) == modes.uses_force(mode)


def test_gravity_set_anew_comes_at_its_rate_and_ends_exactly():
    inp = REST._replace(setpoint_position=math.nan)
    held, state = run(inp)
    assert held.force == SETTINGS.gravity
    law = SETTINGS._replace(gravity=50.0)
    for _ in range(2000):
        before = held.force
        held = vertical_step(law, MODEL, state, inp, DT)
        assert 0.0 <= held.force - before <= law.gravity_rate * DT + 1e-12
    assert held.gravity == 50.0


def test_a_constant_gravity_is_exact_from_the_first_step():
    law = SETTINGS._replace(fade_time=0.05, gravity=50.0)
    state = initial_state(law)
    for step in range(1, 60):
        output = vertical_step(law, MODEL, state, REST, DT)
        assert output.gravity == pytest.approx(50.0 * min(1.0, step * DT / 0.05), abs=1e-12)


@pytest.mark.parametrize("damping", [20.0, -25.0])
def test_damper_acts_on_both_velocities(damping):
    """A negative one assists (thesis 6.4.1)."""
    law = SETTINGS._replace(damping=damping)
    state = initial_state(law)
    inp = REST._replace(velocity=0.1, setpoint_velocity=0.05)
    for step in range(1, 1001):  # the set point moves as it says
        moved = inp._replace(setpoint_position=REST.position + 0.05 * step * DT)
        output = vertical_step(law, MODEL, state, moved, DT)
    assert output.impedance == pytest.approx(100.0 * 0.05 + damping * (0.05 - 0.1))


def test_friction_compensation_adds_nine_tenths_of_the_model():
    output, inp = moved(REST._replace(mode=modes.FRICTION_COMPENSATION, velocity=-0.05, force=-5.0))
    assert output.friction == pytest.approx(
        0.9 * friction_force(MODEL, inp.position, -0.05), rel=0.01
    )
    assert output.friction < 0.0


def test_friction_feed_forward_turns_round_with_the_way_not_with_the_speed():
    """A ramp over the velocity is negative damping at rest: a hand that holds still was shaken."""
    mode = modes.FRICTION_COMPENSATION
    inp = REST._replace(mode=mode, position=0.18, force=5.0)
    output, state = run(inp)
    assert output.friction == 0.0
    for velocity in (0.002, -0.002, 0.01):  # a noisy velocity, and no way
        output = vertical_step(SETTINGS, MODEL, state, inp._replace(velocity=velocity), DT)
        assert output.friction == 0.0
    small = 1e-6
    output = vertical_step(
        SETTINGS, MODEL, state, inp._replace(position=0.18 + small, velocity=small / DT), DT
    )
    assert output.friction == pytest.approx(0.9 * SETTINGS.friction_stiffness * small, rel=0.01)


def test_a_model_that_promises_too_much_is_doubted():
    """Nothing rubs here, so feeding friction forward drives; the law takes it back."""
    law = SETTINGS._replace(stiffness=0.0, gravity=0.0)
    inp = REST._replace(mode=modes.FRICTION_COMPENSATION, position=0.15, force=1.0)
    _, state = run(inp, law=law)
    mass, position, velocity, most = law.mass, 0.15, 0.05, 0.0
    for _ in range(1000):
        position += velocity * DT
        inp = inp._replace(position=position, velocity=velocity)
        output = vertical_step(law, MODEL, state, inp, DT)
        velocity += (output.force + inp.force) / mass * DT
        most = max(most, output.friction)
        if velocity > 0.3:
            velocity = 0.05
    assert most > 3.0
    assert output.friction < 1.5


def test_first_sample_is_no_way_travelled():
    output = vertical_step(
        SETTINGS, MODEL, initial_state(SETTINGS), REST._replace(mode=modes.COMBINED), DT
    )
    assert output.friction == 0.0


@pytest.mark.parametrize("mode", [modes.FORCE_FEEDBACK, modes.OBSERVER])
def test_another_cutoff_acts_at_once(mode):
    """Filters are tuned when the sample time changes; they must not miss a change of settings."""
    law = SETTINGS._replace(force_cutoff=100.0, observer_cutoff=30.0)
    inp = REST._replace(mode=mode, setpoint_position=math.nan)
    feedback = []
    for later in (SETTINGS, law):
        _, state = run(inp)
        output = vertical_step(later, MODEL, state, inp._replace(force=1.0), DT)
        feedback.append(output.feedback)
    assert feedback[1] > 1.5 * feedback[0] > 0.0


def test_force_feedback_is_equation_6_6():
    output, _ = run(REST._replace(mode=modes.FORCE_FEEDBACK, force=-6.0))
    assert output.feedback == pytest.approx(5.0 * (8.0 - 6.0))
    assert output.force == pytest.approx(10.0 + 8.0 + 10.0)


def test_combined_is_the_sum_of_its_parts():
    output, inp = moved(REST._replace(mode=modes.COMBINED, force=-7.0, velocity=0.05))
    spring = 100.0 * (0.18 - inp.position)
    assert output.friction == pytest.approx(
        0.9 * friction_force(MODEL, inp.position, 0.05), rel=0.01
    )
    assert output.feedback == pytest.approx(5.0 * (spring - 7.0))
    assert output.force == pytest.approx(10.0 + spring + output.friction + output.feedback)


@pytest.mark.parametrize(("target", "limit"), [(0.35, 65.0), (0.01, -45.0)])
def test_spring_and_damper_stay_within_the_handle_limits(target, limit):
    law = SETTINGS._replace(stiffness=5000.0)
    output, _ = run(REST._replace(position=0.18, setpoint_position=target), 12.0, law)
    assert output.saturated
    assert output.force == pytest.approx(limit + 10.0), "the weight comes on top"
    assert output.impedance == pytest.approx(limit)


def test_the_spring_starts_at_the_measured_position():
    output = vertical_step(
        SETTINGS, MODEL, initial_state(SETTINGS), REST._replace(setpoint_position=math.nan), DT
    )
    assert output.desired_position == REST.position
    held, _ = run(REST._replace(setpoint_position=math.nan))
    assert held.impedance == 0.0


def test_off_fades_to_zero_force_and_lets_the_set_point_go():
    _, state = run(REST)
    output, state = run(REST._replace(mode=modes.OFF), 2.0, state=state)
    assert output.force == 0.0
    assert output.desired_position == REST.position


def test_inactive_is_zero_at_once_and_enabling_begins_anew():
    _, state = run(REST)
    output = vertical_step(SETTINGS, MODEL, state, REST._replace(active=False), DT)
    assert output.force == 0.0
    output = vertical_step(SETTINGS, MODEL, state, REST, DT)
    assert 0.0 <= output.force < 0.1
    assert output.desired_position == pytest.approx(REST.position, abs=0.4 * DT + 1e-12)


def test_outward_force_ends_at_the_ends_of_travel():
    up, _ = run(REST._replace(position=0.36, setpoint_position=5.0), law=SETTINGS)
    assert up.force <= -2000.0 * 0.01
    down, _ = run(REST._replace(position=0.0, setpoint_position=-5.0), law=SETTINGS)
    assert down.force >= 2000.0 * 0.01


@pytest.mark.parametrize(
    ("position", "target", "largest"), [(0.36, 0.0, -45.0), (0.0, 0.36, 65.0), (0.355, 0.3, -45.0)]
)
def test_a_soft_stop_presses_no_harder_on_the_hand_than_the_limit(position, target, largest):
    """At rest the hand carries what the command has beyond the weight."""
    law = SETTINGS._replace(stiffness=1000.0)
    output, _ = run(REST._replace(position=position, setpoint_position=target), law=law)
    assert output.force - output.gravity == pytest.approx(largest)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *product(("position", "velocity", "force", "slot_force"), (math.nan, -math.inf, 1e300)),
        *product(("slot_weight",), (math.nan, -0.01, 1.01)),
    ],
)
def test_an_input_that_cannot_be_gives_zero(field, value):
    _, state = run(REST)
    output = vertical_step(SETTINGS, MODEL, state, REST._replace(**{field: value}), DT)
    assert output.force == 0.0
    output = vertical_step(SETTINGS, MODEL, state, REST, DT)
    assert abs(output.force) < 0.1, "the force must come back gradually"


@pytest.mark.parametrize("dt", [math.nan, 0.0, -0.001])
def test_a_time_step_that_cannot_be_gives_zero(dt):
    _, state = run(REST)
    assert vertical_step(SETTINGS, MODEL, state, REST, dt).force == 0.0


@pytest.mark.parametrize("first", modes.MODE_NAMES)
@pytest.mark.parametrize("second", modes.MODE_NAMES)
def test_a_switch_in_use_is_not_felt(first, second):
    """The thesis's spring 5 cm off its centre, moved by hand: less than 0.3 N per step.

    OBSERVER takes what no plant here answers for friction, up to 44 N: it has more to fade.
    """
    largest = 1.2 if modes.OBSERVER in (first, second) else 0.3
    inp = VerticalInput(first, 0.13, 0.05, -4.0, 0.18, 0.0, True)
    output, state = run(inp)
    for _ in range(1000):
        previous = output.force
        output = vertical_step(SETTINGS, MODEL, state, inp._replace(mode=second), DT)
        assert abs(output.force - previous) < largest


@pytest.mark.parametrize(
    ("change", "named"), [({"fade_time": 0.0}, "fade_time"), ({"travel_high": 0.01}, "travel_high")]
)
def test_settings_out_of_range_are_refused_by_name(change, named):
    with pytest.raises(ValueError, match=named):
        SETTINGS._replace(**change).validated()
