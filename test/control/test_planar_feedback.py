# SPDX-License-Identifier: Apache-2.0
"""Force feedback in the plane: what it leaves of mass and friction, its limits, and its guard."""

import math
from itertools import pairwise

import pytest
from law_runs import PLANE_DT as DT
from law_runs import handle_force, initial_plane, planar_outputs, planar_step, plane_at

from screw_module_ros.control.planar_settings import (
    DELAY,
    STUDIED_GAIN,
    PlanarSettings,
    least_damping,
)
from screw_module_ros.control.plane_envelope import STANDING

MASS = 6.5
FED = PlanarSettings(force_gain=STUDIED_GAIN)
PLAIN = FED._replace(stiffness=0.0, damping=0.0)
EAST, NORTH = math.cos(0.6), math.sin(0.6)


def accelerated(speed, driven, friction=0.0):
    """Speed of the mass a tick later under a force and friction [N]."""
    stopping = driven + MASS * speed / DT
    return speed + (driven - math.copysign(min(friction, abs(stopping)), stopping)) / MASS * DT


def pushed(force, seconds, law=PLAIN, friction=0.0):
    """Velocities along a way of a mass with ideal sensors, each tick.

    force: of the patient at a time [N]; friction: of the mass [N].
    """
    state, speeds = initial_plane(law), [0.0]
    for tick in range(round(seconds / DT)):
        push, speed = force(tick * DT), speeds[-1]
        inp = plane_at(0.0, 0.0, velocity=(speed * EAST, speed * NORTH),
                       force=(push * EAST, push * NORTH))  # fmt: skip
        fx, fy = handle_force(planar_step(law, state, inp, DT), inp)
        speeds.append(accelerated(speed, push + fx * EAST + fy * NORTH, friction))
    return speeds


@pytest.mark.parametrize("gain", [0.0, 4.0, 9.0])
def test_the_mass_that_the_hand_feels_is_divided(gain):
    """M / (1 + k) at frequencies far below the corner."""
    omega, force = 2.0, 0.2
    shown = pushed(lambda t: force * math.cos(omega * t), 12.0, PLAIN._replace(force_gain=gain))
    settled = shown[round(6.0 / DT) :]
    amplitude = 0.5 * (max(settled) - min(settled))
    assert force / (omega * amplitude) == pytest.approx(MASS / (1.0 + gain), rel=0.03)


@pytest.mark.parametrize(
    ("gain", "push", "moves"), [(9.0, 0.18, False), (9.0, 0.22, True), (0.0, 1.9, False)]
)
def test_the_friction_that_the_hand_feels_is_divided(gain, push, moves):
    """A push below a tenth of the friction does not move the handle, one a little above does."""
    speed = pushed(lambda t: push, 2.0, PLAIN._replace(force_gain=gain), friction=2.0)[-1]
    assert speed > 0.02 if moves else speed == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("aim", [(0.15, 0.0), (0.0, 0.2), (-0.12, -0.1)])
def test_the_limit_holds_at_a_hand_that_does_not_give_way(aim):
    """The hand answers with the force that presses on it: 45 N are reached and kept."""
    law = PLAIN._replace(stiffness=2000.0)
    state, force = initial_plane(law), (0.0, 0.0)
    for _ in range(3000):
        inp = plane_at(0.0, 0.0, (*aim, 0.0, 0.0), force=force)
        force = tuple(-f for f in handle_force(planar_step(law, state, inp, DT), inp))
        assert math.hypot(*force) <= law.force_limit + 0.3
    assert math.hypot(*force) == pytest.approx(law.force_limit, rel=1e-3)


@pytest.mark.parametrize(("speed", "most"), [(0.0, STANDING), (0.06, PLAIN.feedback_limit)])
def test_a_false_force_is_worth_no_more_than_the_feedbacks_limit(speed, most):
    """And little while the handle stands."""
    state = initial_plane(PLAIN)
    inp = plane_at(0.0, 0.0, velocity=(0.0, speed), force=(100.0, -70.0))
    *_, output = planar_outputs([inp] * 1000, PLAIN, state)
    assert math.hypot(state.helped_x, state.helped_y) == pytest.approx(most)
    assert math.hypot(*handle_force(output, inp)) <= most + 7.0 * speed


@pytest.mark.parametrize("unknown", [(math.nan, math.nan), (math.inf, 0.0)])
def test_without_a_force_the_gain_fades_and_the_impedance_is_left(unknown):
    state, plain = initial_plane(FED), initial_plane(FED)
    known = plane_at(0.0, 0.0, (0.05, 0.0, 0.0, 0.0), force=(3.0, 1.0))
    *_, before = planar_outputs([known] * 1000, FED, state)
    assert state.law.gain == FED.force_gain
    lost = known._replace(force_x=unknown[0], force_y=unknown[1])
    outputs = planar_outputs([lost] * 500, FED, state)
    for one, other in pairwise([before, *outputs]):
        assert abs(other.shoulder_torque - one.shoulder_torque) <= FED.torque_rate * DT + 1e-9
        assert abs(other.elbow_torque - one.elbow_torque) <= FED.torque_rate * DT + 1e-9
    never_known = planar_outputs([known._replace(force_x=math.nan)] * 1500, FED, plain)
    assert (state.law.gain, plain.law.gain) == (0.0, 0.0)
    assert handle_force(outputs[-1], lost) == pytest.approx(handle_force(never_known[-1], lost))


def test_no_jump_at_enabling_with_a_hand_that_pushes():
    outputs = planar_outputs([plane_at(0.05, 0.1, force=(20.0, -15.0))] * 400, FED)
    for torques in ([each.shoulder_torque for each in outputs],
                    [each.elbow_torque for each in outputs]):  # fmt: skip
        # 20 N in half a second, a tenth of the limit of the rate
        assert max(abs(b - a) for a, b in pairwise([0.0, *torques])) < 0.25
    assert max(abs(outputs[-1].shoulder_torque), abs(outputs[-1].elbow_torque)) > 2.0


def shaken(frequency, speed, force, state):
    """Outputs for a handle that swings along x for two seconds: speed [m/s], force [N]."""
    swing = [math.cos(2.0 * math.pi * frequency * tick * DT) for tick in range(1000)]
    inputs = [plane_at(0.0, 0.0, velocity=(speed * s, 0.0), force=(force * s, 0.0)) for s in swing]
    return planar_outputs(inputs, FED, state)


def test_a_robot_that_drives_an_oscillation_gets_a_damper_and_loses_gain():
    state = initial_plane(FED)
    outputs = shaken(12.0, 0.03, -4.0, state)
    braked = [output.force_x / output.vx for output in outputs if abs(output.vx) > 0.02]
    assert outputs[0].share == 1.0 and outputs[-1].share == 0.0
    assert state.y.guard.share == 1.0, "the other axis keeps its gain"
    assert braked[-1] < -50.0


def test_a_hand_that_trembles_keeps_the_gain():
    assert {output.share for output in shaken(5.0, 0.1, 4.0, initial_plane(FED))} == {1.0}


def test_chatter_that_no_velocity_shows_takes_gain_and_damper():
    """On a wall of 1e6 N/m, 60 Hz: a damper on a velocity that lags would keep it up."""
    state = initial_plane(FED)
    for tick in range(300):
        state.x.guard.passivity.need = 100.0
        force = (6.0 * math.sin(2.0 * math.pi * 60.0 * tick * DT), 0.0)
        inp = plane_at(0.0, 0.0, velocity=(0.02 * (tick % 2), 0.0), force=force)
        output = planar_step(FED, state, inp, DT)
    assert output.share == 0.0
    assert abs(output.force_x) <= 0.02 * state.damping + 1e-9


def test_the_feedback_does_not_help_a_hand_over_the_edge():
    state, inp = initial_plane(PLAIN), plane_at(0.0, PLAIN.half_depth, force=(0.0, 30.0))
    *_, output = planar_outputs([inp] * 500, PLAIN, state)
    assert state.helped_y > 5.0
    assert output.force_y < 0.0
    assert handle_force(output, inp)[1] == pytest.approx(output.force_y)


def test_least_damping_is_for_what_the_gain_leaves():
    assert least_damping(PLAIN, 100.0, 0.0) == 0.0
    lag = 1.0 / (2.0 * math.pi * PLAIN.force_cutoff) + DELAY
    swings = 0.5 * math.sqrt(100.0 * PLAIN.mass / 10.0)
    assert least_damping(PLAIN, 100.0, 9.0) == pytest.approx(0.9 * (100.0 * lag + swings))


def test_an_obstacle_that_is_not_felt_is_not_pressed_with_all_of_the_gain():
    """A table's edge at the arm: the handle stands, no force shows, the spring pulls with 5 N."""
    inp = plane_at(0.0, 0.0, (0.05, 0.0, 0.0, 0.0), force=(0.0, 0.0))
    *_, output = planar_outputs([inp] * 2000, FED)
    assert math.hypot(*handle_force(output, inp)) == pytest.approx(5.0 + STANDING, abs=0.1)


@pytest.mark.parametrize("stiffness", [50.0, 100.0, 200.0])
def test_a_released_handle_comes_to_rest_in_a_slot_without_a_damper(stiffness):
    state, place, speed, late, far = initial_plane(FED), 0.03, 0.0, (0.0, 0.0), []
    for _ in range(4000):
        inp = plane_at(place, 0.0, velocity=(speed, 0.0), force=(0.0, 0.0))
        inp = inp._replace(slot_x=-stiffness * place, slot_weight=1.0)
        driven, late = late[0], handle_force(planar_step(FED, state, inp, DT), inp)
        speed = accelerated(speed, driven, 0.8)
        place += speed * DT
        far.append(abs(place))
    assert max(far[-500:]) < 0.003
