# SPDX-License-Identifier: Apache-2.0
"""Force feedback in the plane: what it leaves of mass and friction, its limits, and its guard."""

import math

import pytest

from screw_module_ros.control.planar import STANDING, PlanarInput, initial_state, planar_step
from screw_module_ros.control.planar_settings import (
    DELAY,
    STUDIED_GAIN,
    PlanarSettings,
    least_damping,
)
from screw_module_ros.geometry import inverse, jacobian

DT = 0.002
MASS = 6.5
FED = PlanarSettings(force_gain=STUDIED_GAIN)
PLAIN = FED._replace(stiffness=0.0, damping=0.0)
NO_SETPOINT = (math.nan,) * 4
UNKNOWN = (math.nan, math.nan)


def at(x, y, velocity=(0.0, 0.0), force=UNKNOWN, setpoint=NO_SETPOINT):
    """Input with the handle at x, y [m], its velocity [m/s] and the patient's force [N]."""
    shoulder, elbow = inverse(x, y)
    x_s, x_e, y_s, y_e = jacobian(shoulder, elbow)
    determinant = x_s * y_e - x_e * y_s
    vx, vy = velocity
    speeds = (y_e * vx - x_e * vy) / determinant, (x_s * vy - y_s * vx) / determinant
    return PlanarInput(shoulder, elbow, *speeds, *setpoint, True, 0.0, 0.0, 0.0, *force)


def pressed(output, inp):
    """Force of the torques at the handle [N]."""
    x_s, x_e, y_s, y_e = jacobian(inp.shoulder, inp.elbow)
    determinant = x_s * y_e - x_e * y_s
    return (
        (y_e * output.shoulder_torque - y_s * output.elbow_torque) / determinant,
        (x_s * output.elbow_torque - x_e * output.shoulder_torque) / determinant,
    )


def pushed(force, seconds, law=PLAIN, friction=0.0, way=0.6):
    """Velocities along a way [rad] of a mass with ideal sensors, each tick.

    force: of the patient at a time [N]; friction: of the mass [N].
    """
    state, speed, shown = initial_state(law), 0.0, []
    east, north = math.cos(way), math.sin(way)
    for tick in range(round(seconds / DT)):
        push = force(tick * DT)
        inp = at(0.0, 0.0, (speed * east, speed * north), (push * east, push * north))
        fx, fy = pressed(planar_step(law, state, inp, DT), inp)
        driven = push + fx * east + fy * north
        stopping = driven + MASS * speed / DT
        speed += (driven - math.copysign(min(friction, abs(stopping)), stopping)) / MASS * DT
        shown.append(speed)
    return shown


@pytest.mark.parametrize("gain", [0.0, 4.0, 9.0])
def test_the_mass_that_the_hand_feels_is_divided(gain):
    """M / (1 + k) at frequencies far below the corner."""
    omega, force = 2.0, 0.2
    shown = pushed(lambda t: force * math.cos(omega * t), 12.0, PLAIN._replace(force_gain=gain))
    settled = shown[round(6.0 / DT) :]
    amplitude = 0.5 * (max(settled) - min(settled))
    assert force / (omega * amplitude) == pytest.approx(MASS / (1.0 + gain), rel=0.03)


def test_the_friction_that_the_hand_feels_is_divided():
    """A push below a tenth of the friction does not move the handle, one a little above does."""
    law, friction = PLAIN._replace(force_gain=9.0), 2.0
    assert pushed(lambda t: 0.18, 2.0, law, friction)[-1] == pytest.approx(0.0, abs=1e-9)
    assert pushed(lambda t: 0.22, 2.0, law, friction)[-1] > 0.02
    without = PLAIN._replace(force_gain=0.0)
    assert pushed(lambda t: 1.9, 2.0, without, friction)[-1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("aim", [(0.15, 0.0), (0.0, 0.2), (-0.12, -0.1)])
def test_the_limit_holds_at_a_hand_that_does_not_give_way(aim):
    """The hand answers with the force that presses on it: 45 N are reached and kept."""
    law = PLAIN._replace(stiffness=2000.0)
    state, force = initial_state(law), (0.0, 0.0)
    for _ in range(3000):
        inp = at(0.0, 0.0, force=force, setpoint=(*aim, 0.0, 0.0))
        force = tuple(-f for f in pressed(planar_step(law, state, inp, DT), inp))
        assert math.hypot(*force) <= law.force_limit + 0.3
    assert math.hypot(*force) == pytest.approx(law.force_limit, rel=1e-3)


@pytest.mark.parametrize(("speed", "most"), [(0.0, STANDING), (0.06, PLAIN.feedback_limit)])
def test_a_false_force_is_worth_no_more_than_the_feedbacks_limit(speed, most):
    """And little while the handle stands."""
    state = initial_state(PLAIN)
    for _ in range(1000):
        inp = at(0.0, 0.0, (0.0, speed), force=(100.0, -70.0))
        output = planar_step(PLAIN, state, inp, DT)
    assert math.hypot(state.x.fed, state.y.fed) == pytest.approx(most)
    assert math.hypot(*pressed(output, inp)) <= most + 7.0 * speed


def test_without_a_force_the_gain_fades_and_the_impedance_is_left():
    law, setpoint = FED, (0.05, 0.0, 0.0, 0.0)
    state, plain = initial_state(law), initial_state(law)
    known = at(0.0, 0.0, force=(3.0, 1.0), setpoint=setpoint)
    for _ in range(1000):
        planar_step(law, state, known, DT)
        planar_step(law, plain, known._replace(force_x=math.nan), DT)
    assert state.gain == law.force_gain
    assert plain.gain == 0.0
    before = planar_step(law, state, known, DT)
    for unknown in (at(0.0, 0.0, setpoint=setpoint),
                    at(0.0, 0.0, force=(math.inf, 0.0), setpoint=setpoint)):  # fmt: skip
        for _ in range(500):
            after = planar_step(law, state, unknown, DT)
            step = max(abs(after.shoulder_torque - before.shoulder_torque),
                       abs(after.elbow_torque - before.elbow_torque))  # fmt: skip
            assert step <= law.torque_rate * DT + 1e-9
            before = after
        assert state.gain == 0.0
        inp = at(0.0, 0.0, setpoint=setpoint)
        assert pressed(after, inp) == pytest.approx(pressed(planar_step(law, plain, inp, DT), inp))


def test_no_jump_at_enabling_with_a_hand_that_pushes():
    law, before = FED, (0.0, 0.0)
    state = initial_state(law)
    for _ in range(400):
        output = planar_step(law, state, at(0.05, 0.1, force=(20.0, -15.0)), DT)
        torques = output.shoulder_torque, output.elbow_torque
        # 20 N in half a second, a tenth of the limit of the rate
        assert max(abs(a - b) for a, b in zip(torques, before, strict=True)) < 0.25
        before = torques
    assert max(map(abs, before)) > 2.0


def test_a_robot_that_drives_an_oscillation_gets_a_damper_and_loses_gain():
    law, state = FED, initial_state(FED)
    shares, braked = [], 0.0
    for tick in range(1000):
        phase = 2.0 * math.pi * 12.0 * tick * DT
        inp = at(0.0, 0.0, (0.03 * math.cos(phase), 0.0), (-4.0 * math.cos(phase), 0.0))
        output = planar_step(law, state, inp, DT)
        shares.append(output.share)
        braked = output.force_x / output.vx if abs(output.vx) > 0.02 else braked
    assert shares[0] == 1.0 and shares[-1] == 0.0
    assert state.y.guard.share == 1.0, "the other axis keeps its gain"
    assert braked < -50.0


def test_a_hand_that_trembles_keeps_the_gain():
    law, state = FED, initial_state(FED)
    for tick in range(1000):
        phase = 2.0 * math.pi * 5.0 * tick * DT
        inp = at(0.0, 0.0, (0.1 * math.cos(phase), 0.0), (4.0 * math.cos(phase), 0.0))
        assert planar_step(law, state, inp, DT).share == 1.0


def test_chatter_that_no_velocity_shows_takes_gain_and_damper():
    """On a wall of 1e6 N/m, 60 Hz: a damper on a velocity that lags would keep it up."""
    law, state = FED, initial_state(FED)
    state.x.guard.passivity.need = 100.0
    for tick in range(300):
        force = (6.0 * math.sin(2.0 * math.pi * 60.0 * tick * DT), 0.0)
        velocity = (0.02 * (tick % 2), 0.0)
        output = planar_step(law, state, at(0.0, 0.0, velocity, force), DT)
        state.x.guard.passivity.need = 100.0
    assert output.share == 0.0
    assert abs(output.force_x) <= 0.02 * state.damping + 1e-9


def test_towards_an_edge_the_speed_limit_falls_with_the_way_left():
    law = PLAIN

    def braked(y, speed):
        state = initial_state(law)
        state.weight = 1.0
        return planar_step(law, state, at(0.0, y, (0.0, speed)), DT).force_y

    allowed = math.sqrt(2.0 * law.edge_braking * 0.1)
    near = law.half_depth - 0.1
    assert braked(near, 0.95 * allowed) == pytest.approx(0.0, abs=1e-9)
    assert braked(near, allowed + 0.1) == pytest.approx(-0.1 * law.speed_damping, rel=1e-6)
    assert braked(near, 2.0 * allowed) == pytest.approx(-law.force_limit)
    assert braked(near, -0.95 * law.speed_limit) == pytest.approx(0.0, abs=1e-9), "the way back"


def test_the_feedback_does_not_help_a_hand_over_the_edge():
    law = PLAIN
    state = initial_state(law)
    for _ in range(500):
        inp = at(0.0, law.half_depth, force=(0.0, 30.0))
        output = planar_step(law, state, inp, DT)
    assert state.y.fed > 5.0
    assert output.force_y < 0.0
    assert pressed(output, inp)[1] == pytest.approx(output.force_y)


def test_least_damping_is_for_what_the_gain_leaves():
    assert least_damping(PLAIN, 100.0, 0.0) == 0.0
    lag = 1.0 / (2.0 * math.pi * PLAIN.force_cutoff) + DELAY
    swings = 0.5 * math.sqrt(100.0 * PLAIN.mass / 10.0)
    assert least_damping(PLAIN, 100.0, 9.0) == pytest.approx(0.9 * (100.0 * lag + swings))


def test_an_obstacle_that_is_not_felt_is_not_pressed_with_all_of_the_gain():
    """A table's edge at the arm: the handle stands, no force shows, the spring pulls with 5 N."""
    state, setpoint = initial_state(FED), (0.05, 0.0, 0.0, 0.0)
    for _ in range(2000):
        inp = at(0.0, 0.0, force=(0.0, 0.0), setpoint=setpoint)
        output = planar_step(FED, state, inp, DT)
    assert math.hypot(*pressed(output, inp)) == pytest.approx(5.0 + STANDING, abs=0.1)


@pytest.mark.parametrize("stiffness", [50.0, 100.0, 200.0])
def test_a_released_handle_comes_to_rest_in_a_slot_without_a_damper(stiffness):
    state, place, speed, late = initial_state(FED), 0.03, 0.0, (0.0, 0.0)
    far = []
    for _ in range(4000):
        slot = -stiffness * place
        inp = at(place, 0.0, (speed, 0.0), (0.0, 0.0))._replace(slot_x=slot, slot_weight=1.0)
        driven, late = late[0], pressed(planar_step(FED, state, inp, DT), inp)
        friction = min(0.8, abs(driven + MASS * speed / DT))
        speed += (driven - math.copysign(friction, driven + MASS * speed / DT)) / MASS * DT
        place += speed * DT
        far.append(abs(place))
    assert max(far[-500:]) < 0.003
