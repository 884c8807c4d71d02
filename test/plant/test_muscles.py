# SPDX-License-Identifier: Apache-2.0
"""Tone, lifting, synergy and fatigue, alone and in the plant's step."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.plant.muscles import RESTED, muscles_step, pull
from screw_module_ros.plant.settings import patients
from screw_module_ros.plant.world import ArmSettings, World

DT = 1e-3


def stepped(arm, seconds, force=(0.0, 0.0, 0.0), away=0.0, start=RESTED):
    """Return the muscles after a time under a constant force [N] and speed [m/s]."""
    s = start
    for _ in range(round(seconds / DT)):
        s = muscles_step(arm, 1.0, s, *force, away, DT)
    return s


@pytest.fixture
def arm(settings):
    return settings.arm


@pytest.mark.parametrize(
    ("away", "tone"), [(-0.4, 0.0), (0.0, 0.0), (0.1, 0.0), (0.2, 10.0), (0.4, 30.0)]
)
def test_tone_grows_with_the_speed_at_which_flexors_are_stretched(arm, away, tone):
    stiff = arm._replace(tone=100.0, tone_speed=0.1)
    pulled, _, _ = pull(stiff, 1.0, stepped(stiff, 1.0, away=away), 0.0)
    assert pulled == pytest.approx(-tone)
    pulled, _, _ = pull(stiff, 1.0, stepped(stiff, 0.05, away=away), 0.0)
    assert pulled == pytest.approx(-tone * (1.0 - math.exp(-1.0)), rel=0.02)


@pytest.mark.parametrize(
    ("carried", "support", "lift"),
    [(1.0, 0.0, 20.0), (1.0, 8.0, 12.0), (1.0, 30.0, 0.0), (0.5, 10.0, 10.0), (0.5, 16.0, 4.0),
     (0.0, 20.0, 0.0), (1.0, -8.0, 20.0)],
)  # fmt: skip
def test_he_lifts_less_by_what_the_handle_bears_beyond_what_hangs_on_it(
    arm, carried, support, lift
):
    relying = arm._replace(weight=20.0, carried=carried, relies=1.0, synergy=0.5)
    s = stepped(relying, 5.0, force=(0.0, 0.0, -support))
    away, load, _ = pull(relying, 1.0, s, 0.2)
    assert arm.weight * (1.0 - carried) + load == pytest.approx(20.0 - lift, abs=0.01)
    assert away == pytest.approx(-0.5 * lift, abs=0.01)


@pytest.mark.parametrize(("y", "share"), [(-0.3, 0.0), (-0.1, 0.25), (0.0, 0.5), (0.3, 1.0)])
def test_a_synergy_pulls_the_more_the_farther_out(arm, y, share):
    away, _, _ = pull(arm._replace(synergy=0.5), 1.0, RESTED, y)
    assert away == pytest.approx(-10.0 * share)


def test_full_effort_tires_towards_the_published_balance(arm):
    """Active and tired muscle: F active = R tired, with nothing at rest (xia2008)."""
    tiring = arm._replace(strength=8.0, fatigue=0.0182, recovery=0.00168)
    s = stepped(tiring, 600.0, force=(8.0, 0.0, 0.0))
    assert s.tired == pytest.approx(0.0182 / (0.0182 + 0.00168), abs=0.01)
    assert s.active + s.tired == pytest.approx(1.0, abs=0.01)


def test_rest_recovers_fifteen_times_as_fast_as_work(arm):
    """Tired muscle falls by R x 15 where he rests (looft2018)."""
    tiring = arm._replace(strength=8.0, fatigue=0.0182, recovery=0.00168, weight=0.0)
    tired = RESTED._replace(tired=0.8)
    s = stepped(tiring, 120.0, start=tired)
    assert s.tired == pytest.approx(0.8 * math.exp(-15.0 * 0.00168 * 120.0), rel=0.01)
    _, _, vigour = pull(tiring, 1.0, tired, 0.0)
    assert vigour == pytest.approx(0.2)


forces = st.floats(-200.0, 200.0)


@given(st.sampled_from(sorted(patients())), st.lists(st.tuples(
    forces, forces, forces, st.floats(-2.0, 2.0)), max_size=30))  # fmt: skip
def test_muscles_stay_within_their_shares(name, steps):
    arm, s = patients()[name], RESTED
    for *force, away in steps:
        for _ in range(100):
            s = muscles_step(arm, 1.0, s, *force, away, DT)
        assert 0.0 <= s.tired <= 1.0 and 0.0 <= s.active <= 1.0 - s.tired + 1e-9
        pulled, load, _ = pull(arm, 1.0, s, 0.1)
        assert 0.0 <= load <= arm.weight * arm.carried and pulled <= 0.0


def test_a_patient_without_these_traits_adds_nothing():
    """Runs from before they were there stay what they were, bit for bit."""
    for name in ("healthy", "weak", "tremor", "flaccid"):
        arm = patients()[name]
        s = stepped(arm, 0.5, force=(30.0, -20.0, -15.0), away=1.0)
        assert s == RESTED and pull(arm, 1.0, s, 0.1) == (0.0, 0.0, 1.0)


def pulled_away(settings, name, speed):
    """Return how hard a relaxed arm resists [N], pulled from the body at a speed, as it passes 0.

    The pin holds the height; motors pull the handle from y = -0.1 m by a spring and a damper.
    """
    world = World(settings._replace(start=settings.start._replace(y=-0.1, locked=True)))
    world.set_arm(ArmSettings(patient=name, traits=("tension",), values=(0.1,)))
    world.planar_powered = True, True
    robot, forces, before = settings.planar, [], -0.1
    for tick in range(round(0.2 / speed / DT)):
        truth = world.truth()
        (shoulder, elbow), (x, y) = truth.joint_position, truth.planar_position
        fx = -4000.0 * x
        fy = 4000.0 * (-0.1 + speed * tick * DT - y) + 400.0 * (speed - (y - before) / DT)
        before = y
        world.planar_command = (
            robot.upper_arm * (fy * math.cos(shoulder) - fx * math.sin(shoulder)),
            robot.forearm * (fy * math.cos(elbow) - fx * math.sin(elbow)),
        )
        world.advance(DT)
        if abs(y) < 0.02:
            forces.append(-world.truth().planar_force[1])
    return sum(forces) / len(forces)


def test_a_spastic_arm_resists_a_fast_pull_more_than_twice_as_hard(settings):
    slow, fast = (pulled_away(settings, "spastic", speed) for speed in (0.1, 0.4))
    assert fast > 2.0 * slow > 0.0
    assert fast - slow == pytest.approx(100.0 * 0.3 + 20.0 * 0.3, rel=0.25)
    healthy = [pulled_away(settings, "healthy", speed) for speed in (0.1, 0.4)]
    assert healthy[1] - healthy[0] == pytest.approx(80.0 * 0.3, rel=0.25), "his damper alone"


@pytest.mark.parametrize(
    ("name", "hanging"), [("flaccid", 20.0), ("severe", 10.0), ("spastic", 0.0)]
)
def test_a_patient_hangs_on_the_transducer_with_what_he_does_not_carry(settings, name, hanging):
    world, found = World(settings, 3), []
    for grip in ("free", "human_arm"):
        world.set_fixture(grip, locked=True)
        world.set_arm(ArmSettings(patient=name))
        world.set_arm(ArmSettings(target=(math.nan, math.nan, world.truth().handle_position)))
        world.advance(4.0)
        forces = []
        for _ in range(500):
            world.advance(DT)
            forces.append(world.wrench()[2])
        found.append(sum(forces) / len(forces))
    assert found[0] - found[1] == pytest.approx(hanging, abs=0.3)


def test_a_severe_patient_moves_the_same_bit_for_bit_whatever_the_steps(settings):
    seen = []
    for chunk, count in ((1e-3, 800), (0.4, 2)):
        world = World(settings, 2)
        world.set_arm(ArmSettings(patient="severe"))
        world.set_arm(ArmSettings(target=(0.1, 0.1, 0.2), duration=0.5))
        world.planar_powered = True, True
        world.planar_command = 3.0, -2.0
        for _ in range(count):
            world.advance(chunk)
        seen.append(world.truth())
    assert seen[0] == seen[1]


def test_another_patient_is_rested(settings):
    world = World(settings)
    world.set_arm(ArmSettings(patient="tiring", traits=("fatigue",), values=(1.0,)))
    world.set_fixture("human_arm", locked=True)
    there = ArmSettings(target=(math.nan, math.nan, 0.35), duration=0.1)
    world.set_arm(there)
    world.advance(4.0)
    tired = world.truth().patient_force
    world.set_arm(ArmSettings(patient="tiring"))
    world.set_arm(there)
    world.advance(0.3)
    assert tired < 0.5 * world.truth().patient_force
