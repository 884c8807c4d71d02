# SPDX-License-Identifier: Apache-2.0
"""The vertical module: energy, play, stops, lock pin, brake, and the force that is measured."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import settings as run_settings
from hypothesis import strategies as st

from screw_module_ros.compiled import compiled
from screw_module_ros.plant.module import HUMAN_ARM, LOCKED_ROTOR, STAGE, resting_state
from screw_module_ros.plant.patient import ArmForce, soft_grip
from screw_module_ros.plant.vertical import vertical_step


def many_steps(p, state, inputs, steps):
    for _ in range(steps):
        state = vertical_step(p, state, inputs)
    return state


run = compiled(many_steps)
quick_step = compiled(vertical_step)


def after(p, u, steps, height=0.2, **moving):
    """Return the state after steps from rest; moving: what else the start is."""
    return run(p, resting_state(p.module, height, u.upright)._replace(**moving), u, steps)


def along(p, u, steps, height=0.2, **moving):
    """Yield (before, after) of each step from rest; moving: what else the start is."""
    s = resting_state(p.module, height, u.upright)._replace(**moving)
    for _ in range(steps):
        before, s = s, quick_step(p, s, u)
        yield before, s


def handled(
    p, mass=3.0, stiffness=0.0, damping=0.0, weight=0.0, strength=math.inf, grip=None, **module
):
    """Return the rig with another arm, grip and module."""
    arm = ArmForce(mass, stiffness, damping, strength, weight)
    grip = soft_grip(*grip) if grip else p.grip
    return p._replace(arm=arm, grip=grip, module=p.module._replace(**module))


def energy(p, s, upright=1.0):
    """Kinetic, gravity, contact, support, end stops and bristles [J]."""
    m = p.module
    gap = s.handle - s.nut - s.support
    depth = max(abs(gap) - m.play / 2.0, 0.0)
    stop = max(-s.handle, s.handle - m.travel, 0.0)
    return (
        0.5 * m.turning_mass * s.nut_velocity**2
        + 0.5 * m.moving_mass * s.handle_velocity**2
        + 0.5 * m.screw_mass * s.support_velocity**2
        + 0.5 * m.support_stiffness * s.support**2
        + upright * m.moving_mass * m.gravity * s.handle
        + 0.5 * m.contact_stiffness * depth**2
        + 0.5 * m.stop_stiffness * stop**2
        + 0.5 * s.bristle**2 / p.friction.stiffness
    )


@run_settings(max_examples=25)
@given(
    height=st.floats(0.0, 0.36),
    nut_velocity=st.floats(-0.5, 0.5),
    handle_velocity=st.floats(-0.5, 0.5),
    gap=st.floats(-6e-5, 6e-5),
    upright=st.sampled_from([1.0, -1.0]),
    braked=st.booleans(),
    side_force=st.floats(0.0, 50.0),
    struck=st.floats(-0.1, 0.1),
    stiffness=st.sampled_from([1e5, 1e7, 1e12]),
    screw_mass=st.sampled_from([0.01, 0.6]),
)
def test_passive_module_never_gains_energy(
    vertical, still, height, nut_velocity, handle_velocity, gap, upright, braked, side_force,
    struck, stiffness, screw_mass,
):  # fmt: skip
    p = handled(vertical, support_stiffness=stiffness, screw_mass=screw_mass)
    u = still._replace(upright=upright, braked=braked, side_force=side_force)
    moving = {"nut_velocity": nut_velocity, "handle_velocity": handle_velocity,
              "support_velocity": struck}  # fmt: skip
    for before, s in along(p, u, 3000, height, handle=height + gap, **moving):
        assert energy(p, s, upright) <= energy(p, before, upright) + 1e-7


def test_friction_carries_the_handle_in_the_upper_half(vertical, still):
    s = after(vertical, still, 40_000, height=0.25)
    assert s.nut == pytest.approx(0.25, abs=1e-5)
    assert s.friction == pytest.approx(-10.04, abs=0.01)


def test_handle_sinks_where_friction_is_less_than_its_weight(vertical, still):
    assert after(vertical, still, 80_000, height=0.1, nut_velocity=-0.001).nut < 0.05


def test_lock_pin_holds_against_the_full_motor(vertical, still):
    s = after(vertical, still._replace(current=10.0, powered=True, locked=True), 20_000)
    assert (s.nut, s.nut_velocity) == (0.2, 0.0)
    m = vertical.module
    bent = m.moving_mass * m.gravity * (1.0 / m.support_stiffness + 1.0 / m.contact_stiffness)
    assert abs(s.handle - 0.2) <= 0.5 * m.play + bent + 1e-9
    assert s.torque == pytest.approx(1.6)


@pytest.mark.parametrize(("end", "way"), [(0.0, -1.0), (0.36, 1.0)])
def test_end_stop_throws_back_less_than_came(vertical, still, end, way):
    fast = {"nut_velocity": way * 0.4, "handle_velocity": way * 0.4}
    states = [s for _, s in along(vertical, still, 4000, height=end - way * 0.02, **fast)]
    assert 0.0 < max(way * (s.handle - end) for s in states) < 5e-3
    assert max(-way * s.nut_velocity for s in states) < 0.4


def test_full_motor_does_not_push_through_the_end_stop(vertical, still):
    s = after(vertical, still._replace(current=10.0, powered=True), 40_000, height=0.3)
    assert s.handle == pytest.approx(0.36, abs=4e-3)


def test_play_of_a_tenth_of_a_millimetre_between_encoder_and_handle(vertical, still):
    gaps = []
    s = resting_state(vertical.module, 0.2, 1.0)
    for target in (0.21, 0.2, 0.21):
        u = still._replace(fixture=STAGE, stage_speed=0.01, stage_target=target)
        s = run(vertical, s, u, 15_000)  # still on its way
        gaps.append(s.handle - s.nut)
        s = run(vertical, s, u, 15_000)
    assert gaps[0] - gaps[1] == pytest.approx(1e-4, abs=3e-6)
    assert gaps[2] == pytest.approx(gaps[0], abs=1e-6)


def test_patient_force_holds_the_reaction_of_the_arm_s_mass(vertical, still):
    p = handled(vertical)
    u = still._replace(fixture=HUMAN_ARM, current=4.0, powered=True)
    for before, s in along(p, u, 2000):
        acceleration = (s.handle_velocity - before.handle_velocity) / p.dt
        assert s.patient_force == pytest.approx(-3.0 * acceleration, abs=1e-9)
    assert s.handle_velocity > 0.1


def test_the_three_masses_obey_newton(vertical, still):
    u = still._replace(fixture=HUMAN_ARM, hand=0.3, current=2.0, powered=True)
    m = vertical.module._replace(rail_friction=0.0)
    p = vertical._replace(module=m)
    damping = 2.0 * m.support_damping_ratio * math.sqrt(m.support_stiffness * m.screw_mass)
    for before, s in along(p, u, 3000):
        assert (
            (s.nut_velocity - before.nut_velocity) / p.dt * m.turning_mass,
            (s.handle_velocity - before.handle_velocity) / p.dt * m.moving_mass,
            (s.support_velocity - before.support_velocity) / p.dt * m.screw_mass,
        ) == pytest.approx(
            (
                s.torque * p.turn_rate - s.friction + s.contact_force,
                s.patient_force - s.contact_force - m.moving_mass * 9.81,
                s.contact_force - m.support_stiffness * s.support - damping * s.support_velocity,
            ),
            abs=1e-6,
        )


def test_friction_on_the_handles_side_is_not_seen_at_the_nut(vertical, still):
    """With the screw locked the handle moves within the play, against its own friction alone."""
    p = handled(
        vertical, mass=0.0, strength=4.0,
        play=4e-3, rail_friction=3.0, film_damping=0.0, gravity=0.0,
    )  # fmt: skip
    u = still._replace(fixture=STAGE, locked=True, stage_speed=2e-3, stage_target=0.2015)
    s = after(p, u, 10_000)
    assert s.patient_force == pytest.approx(3.0, abs=0.01)
    assert s.friction == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_support_gives_way_under_the_handle_and_the_encoder_does_not_see_it(
    vertical, still, way
):
    p = handled(vertical, 1.0, 1e5, 500.0, support_stiffness=2e6, rail_friction=0.0)
    s = after(p, still._replace(fixture=HUMAN_ARM, locked=True, hand=0.2 + 0.002 * way), 20_000)
    assert s.nut == 0.2
    assert s.support == pytest.approx(s.contact_force / 2e6, rel=1e-3)
    stretch = s.handle - s.nut - s.support - 0.5 * way * p.module.play
    assert stretch == pytest.approx(s.contact_force / p.module.contact_stiffness, rel=1e-3)


def test_a_push_with_the_pin_in_measures_support_and_contact_in_series(vertical, still):
    """As docs/hardware.md has it: 50 and 100 N at the handle, with its weight and friction."""
    p = handled(vertical, 1.0, 1e5, 500.0)
    pushed = [
        after(p, still._replace(fixture=HUMAN_ARM, locked=True, hand=0.2 + force / 1e5), 20_000)
        for force in (50.0, 100.0)
    ]
    less, more = ((s.patient_force, s.handle) for s in pushed)
    series = 1.0 / (1.0 / p.module.support_stiffness + 1.0 / p.module.contact_stiffness)
    assert [s.nut for s in pushed] == [0.2, 0.2]
    assert (more[0] - less[0]) / (more[1] - less[1]) == pytest.approx(series, rel=0.01)


def test_a_stiff_support_is_none(vertical, still):
    """The contact is then one of nut and handle alone, and 100 times more changes nothing."""
    u = still._replace(fixture=HUMAN_ARM, hand=0.3, current=2.0, powered=True)
    p, stiffer = (handled(vertical, 3.0, 300.0, 5.0, support_stiffness=k) for k in (1e12, 1e14))
    m = p.module
    for (before, s), (_, same) in zip(along(p, u, 4000), along(stiffer, u, 4000), strict=True):
        assert (s.nut, s.handle) == pytest.approx((same.nut, same.handle), abs=1e-9)
        gap, closing = s.handle - s.nut, s.handle_velocity - s.nut_velocity
        side = math.copysign(1.0, gap) if abs(gap) > 0.5 * m.play else 0.0
        share = min(abs(before.handle - before.nut - side * 0.5 * m.play) / m.contact_depth, 1.0)
        firm = m.contact_stiffness * (gap - 0.5 * side * m.play)
        firm += share * m.contact_damping * closing
        if abs(abs(gap) - 0.5 * m.play) > 1e-6:  # not in the substep in which the contact opens
            expected = abs(side) * firm + m.film_damping * closing
            assert s.contact_force == pytest.approx(expected, rel=1e-3, abs=1e-2)
    assert s.handle - 0.2 > 0.05


def test_a_struck_screw_rings_at_650_hertz_with_its_damping_ratio(vertical, still):
    """The nut stands in the middle of the play, without grease, so that nothing holds the screw."""
    m = vertical.module._replace(film_damping=0.0, gravity=0.0)
    p = vertical._replace(module=m, dt=1e-6)
    struck = {"handle": 0.2, "support": 0.0, "support_velocity": 0.05}
    states = [s for _, s in along(p, still._replace(locked=True), 8000, **struck)]
    peaks = [
        (number, s.support)
        for number, (last, s, following) in enumerate(
            zip(states, states[1:], states[2:], strict=False)
        )
        if last.support < s.support > following.support
    ]
    assert all(s.contact_force == 0.0 for s in states)
    apart = (peaks[-1][0] - peaks[0][0]) / (len(peaks) - 1) * p.dt
    assert 1.0 / apart == pytest.approx(math.sqrt(1e7 / 0.6) / (2.0 * math.pi), rel=5e-3)
    assert 1.0 / apart == pytest.approx(650.0, rel=5e-3)
    decrement = math.log(peaks[0][1] / peaks[-1][1]) / (len(peaks) - 1)
    # Backward Euler adds half a substep's angle, 0.002.
    ratio = decrement / math.hypot(2.0 * math.pi, decrement)
    assert ratio == pytest.approx(m.support_damping_ratio, abs=0.003)


def test_the_transducer_filters_the_force(vertical, still):
    p, shown = vertical._replace(force_lag=1.0 / (2.0 * math.pi * 100.0)), 0.0
    for _, s in along(p, still._replace(fixture=HUMAN_ARM, hand=0.3), 200):
        shown += (s.patient_force - shown) * p.dt / (p.force_lag + p.dt)
        assert s.filtered_force == pytest.approx(shown, abs=1e-9)
    assert s.filtered_force != s.patient_force


def test_the_transducer_has_its_hysteresis(vertical, still):
    """The value shown lags the force by half the width of the loop, upward and downward."""
    p, u = vertical._replace(hysteresis=0.05), still._replace(fixture=HUMAN_ARM, locked=True)
    s = resting_state(p.module, 0.2, 1.0)
    for way in (1.0, -1.0):
        for k in range(10_000):  # slowly, so that the force does not overshoot
            s = run(p, s, u._replace(hand=0.2 + 2e-6 * k * way), 20)
        assert s.shown_force - s.filtered_force == pytest.approx(-0.05 * way, abs=5e-3)
        before = s
        s = run(p, s, u._replace(hand=0.2 + (2e-6 * k - 2e-4) * way), 100_000)
        assert s.filtered_force - before.filtered_force == pytest.approx(-0.06 * way, abs=0.01)
        assert s.shown_force == before.shown_force, "within the loop nothing moves"


def test_a_soft_grip_stretches_as_spring_and_arm_in_series(vertical, still):
    p = handled(vertical, 3.0, 300.0, 5.0, grip=(6000.0, 30.0, 0.4))
    s = after(p, still._replace(fixture=HUMAN_ARM, locked=True, hand=0.21), 100_000)
    assert [s.patient_force] * 3 == pytest.approx(
        [
            300.0 * (0.21 - s.arm),
            6000.0 * (s.arm - s.handle),
            (0.21 - s.handle) / (1 / 300.0 + 1 / 6000.0),
        ],
        rel=1e-3,
    )


def test_an_arm_behind_a_soft_grip_swings_at_its_own_frequency(vertical, still):
    """The handle is held by the locked screw: one mass between two springs."""
    p = handled(vertical, 3.0, 300.0, grip=(6000.0, 0.0, 0.4))
    u = still._replace(fixture=HUMAN_ARM, locked=True, hand=0.2)
    crossings = [
        number for number, (before, s) in enumerate(along(p, u, 20_000, arm=0.205))
        if (s.arm > 0.2) != (before.arm > 0.2)
    ]  # fmt: skip
    half = (crossings[-1] - crossings[0]) * p.dt / (len(crossings) - 1)
    assert math.pi / half == pytest.approx(math.sqrt(6300.0 / 3.0), rel=0.01)


def test_a_grip_that_is_hard_is_the_rigid_hand(vertical, still):
    u = still._replace(fixture=HUMAN_ARM, hand=0.3)
    rigid = after(handled(vertical, 3.0, 300.0, 5.0), u, 4000)
    hard = after(handled(vertical, 3.0, 300.0, 5.0, grip=(2e5, 200.0, 1e-3)), u, 4000)
    assert hard.handle == pytest.approx(rigid.handle, abs=5e-4)
    assert rigid.handle > 0.201


def hanging(p, mass=2.04, weight=20.0, grip=None, **module):
    """Return the rig with an arm that only hangs: neither stiffness nor damping."""
    return handled(p, mass, weight=weight, grip=grip, **module)


GRIPS = pytest.mark.parametrize("grip", [None, (6000.0, 60.0, 0.4)], ids=["rigid", "soft"])
UPRIGHT = pytest.mark.parametrize("upright", [1.0, -1.0], ids=["upright", "upside down"])


@GRIPS
@UPRIGHT
@pytest.mark.parametrize("weight", [5.0, 20.0])
def test_what_hangs_on_the_handle_is_what_the_transducer_shows(
    vertical, still, upright, weight, grip
):
    u = still._replace(fixture=HUMAN_ARM, locked=True, upright=upright)
    s = after(hanging(vertical, weight=weight, grip=grip), u, 40_000)
    assert s.patient_force == pytest.approx(-weight * upright, abs=0.01)
    assert s.shown_force == pytest.approx(-weight * upright, abs=0.01)


@GRIPS
@UPRIGHT
def test_a_hanging_arm_is_held_by_its_own_spring_too(vertical, still, upright, grip):
    """At rest spring and handle share the weight, at the stretch of both."""
    p = handled(vertical, 2.04, 300.0, 5.0, weight=20.0, grip=grip)
    u = still._replace(fixture=HUMAN_ARM, locked=True, upright=upright, hand=0.22)
    s = after(p, u, 60_000)
    assert s.patient_force == pytest.approx(300.0 * (0.22 - s.arm) - 20.0 * upright, abs=0.01)


@UPRIGHT
def test_a_weak_arm_s_limit_is_not_that_of_its_weight(vertical, still, upright):
    u = still._replace(fixture=HUMAN_ARM, locked=True, upright=upright, hand=0.3)
    p = handled(vertical, 2.04, 300.0, 5.0, weight=20.0, strength=8.0)
    assert after(p, u, 40_000).patient_force == pytest.approx(8.0 - 20.0 * upright, abs=0.01)


@GRIPS
@UPRIGHT
def test_a_hanging_arm_falls_with_what_friction_leaves_of_the_weights(
    vertical, still, upright, grip
):
    """Newton for nut, handle and arm as one mass; what the hand feels is the arm's share."""
    p = hanging(vertical, grip=grip)
    module, mass = p.module, p.arm.mass + (p.grip.mass if grip else 0.0)
    moving = module.turning_mass + module.moving_mass + mass
    weight = 20.0 + module.moving_mass * module.gravity
    way = [s for _, s in along(p, still._replace(fixture=HUMAN_ARM, upright=upright), 8000)][1000:]
    time = len(way) * p.dt
    fall = -upright * (way[-1].handle_velocity - way[0].handle_velocity) / time
    friction = upright * sum(s.friction for s in way) / len(way)  # against a fall: negative
    assert fall == pytest.approx((weight + friction - module.rail_friction) / moving, rel=0.02)
    assert fall > 0.5
    felt = -upright * sum(s.patient_force for s in way) / len(way)
    assert felt == pytest.approx(20.0 - mass * fall, abs=0.1)


def test_a_fall_from_a_free_handle_begins_with_the_weight_of_both_over_their_mass(vertical, still):
    """Within the play the guide alone holds them: no nut, no film, no friction of the screw."""
    p = hanging(vertical, film_damping=0.0, play=4e-3)
    start = {"handle": 0.2 + 1.9e-3}
    s = after(p, still._replace(fixture=HUMAN_ARM), 200, **start)
    pull = 20.0 + (p.module.moving_mass * p.module.gravity) - p.module.rail_friction
    assert -s.handle_velocity == pytest.approx(
        pull / (2.04 + p.module.moving_mass) * 200 * p.dt, rel=0.01
    )


def test_a_shorted_motor_lets_a_hanging_arm_sink(vertical, still):
    """At a constant speed, at which brake and friction bear the weights."""
    p = hanging(vertical)
    u = still._replace(fixture=HUMAN_ARM, braked=True)
    s = after(p, u, 20_000)
    brake = p.module.brake_damping * p.turn_rate**2 * s.nut_velocity
    weight = 20.0 + p.module.moving_mass * p.module.gravity
    rail = p.module.rail_friction
    assert -brake == pytest.approx(weight + s.friction - rail, abs=0.2)
    assert -0.03 < s.nut_velocity < -0.01


def test_shorted_motor_brakes(vertical, still):
    moving = {"height": 0.1, "nut_velocity": 0.3, "handle_velocity": 0.3}
    coasting = after(vertical, still, 200, **moving)
    braked = after(vertical, still._replace(braked=True), 200, **moving)
    assert braked.nut_velocity < 0.5 * coasting.nut_velocity
    assert braked.torque < 0.0 == coasting.torque


def test_current_dies_without_power(vertical, still):
    on = still._replace(current=5.0, powered=True)
    s = after(vertical, on, 100)
    assert s.current == pytest.approx(5.0, abs=1e-6)
    assert run(vertical, s, on._replace(powered=False), 40).current == pytest.approx(0.0, abs=1e-4)


def test_locked_rotor_twists_the_transducer_and_leaves_the_handle(vertical, still):
    s = after(vertical, still._replace(fixture=LOCKED_ROTOR, current=2.0, powered=True), 4000)
    start = resting_state(vertical.module, 0.2, 1.0)
    assert 1e4 * s.rotor_angle == pytest.approx(0.32, rel=1e-6)
    assert (s.nut, s.handle) == (start.nut, start.handle)


def test_side_force_raises_friction(vertical, still):
    f, u = vertical.friction, still._replace(fixture=STAGE, stage_speed=0.02, stage_target=0.3)
    pushed = after(vertical, u._replace(side_force=30.0), 10_000).friction
    expected = f.load_gain * vertical.module.grip_height * 30.0
    expected /= 1.0 - f.load_gain * vertical.module.handle_offset  # the stage pushes harder too
    assert pushed - after(vertical, u, 10_000).friction == pytest.approx(expected, rel=0.01)
