# SPDX-License-Identifier: Apache-2.0
"""The patient: paths of the virtual hand, the kinds of arm, requests to change it."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.plant.fixture import stage_velocity
from screw_module_ros.plant.patient import (
    ArmSettings,
    HandPath,
    arm_force,
    changed_patient,
    hand_point,
    resting,
    resting_patient,
    spring_terms,
)

REACH = HandPath(
    start=0.1, target=0.3, begin=2.0, duration=1.5, amplitude=0.15, omega=0.8, tremor=0.0
)


def test_minimum_jerk_starts_and_ends_at_rest():
    assert hand_point(REACH, 2.0) == (0.1, 0.0)
    assert hand_point(REACH, 1.0) == (0.1, 0.0)
    middle, fastest = hand_point(REACH, 2.75)
    assert middle == pytest.approx(0.2)
    assert fastest == pytest.approx(1.875 * 0.2 / 1.5)
    position, velocity = hand_point(REACH, 3.5 - 1e-9)
    assert position == pytest.approx(0.3)
    assert velocity == pytest.approx(0.0, abs=1e-6)


def test_sine_follows_the_reach():
    quarter = 3.5 + math.pi / 2.0 / 0.8
    assert hand_point(REACH, quarter)[0] == pytest.approx(0.45)
    assert hand_point(REACH, quarter)[1] == pytest.approx(0.0, abs=1e-12)
    assert hand_point(REACH, 3.5)[1] == pytest.approx(0.12)


@given(st.floats(2.01, 20.0))
def test_velocity_is_the_derivative_of_position(time):
    path = REACH._replace(tremor=0.008)
    if abs(time - 3.5) < 1e-4:
        return  # the sine begins with a step of velocity
    slope = (hand_point(path, time + 1e-6)[0] - hand_point(path, time - 1e-6)[0]) / 2e-6
    assert hand_point(path, time)[1] == pytest.approx(slope, abs=1e-4)


def test_kinds(settings):
    arm = settings.arm
    active = arm_force(arm, 9.81)
    assert (active.mass, active.stiffness, active.damping) == (3.0, 300.0, 5.0)
    assert active.weight == 0.0
    assert arm_force(arm._replace(carried=0.5), 9.81).weight == pytest.approx(14.715)
    relaxed = arm_force(arm._replace(kind="relaxed"), 9.81)
    assert relaxed.stiffness == pytest.approx(30.0)
    weak = arm_force(arm._replace(kind="weak"), 9.81)
    assert spring_terms(weak, 0.5, 0.0, 0.1, 0.0) == (0.0, 0.0, 8.0)
    assert spring_terms(weak, 0.1, 0.0, 0.5, 0.0) == (0.0, 0.0, -8.0)
    assert spring_terms(weak, 0.11, 0.0, 0.1, 0.0) == (300.0, 5.0, 0.0)


def test_stage_brakes_in_time():
    position, velocity, fastest = 0.1, 0.0, 0.0
    for _ in range(60_000):
        velocity = stage_velocity(position, velocity, 0.15, 0.3, 2.0, 50e-6)
        position += velocity * 50e-6
        fastest = max(fastest, velocity)
        assert position <= 0.3 + 1e-9
    assert fastest == pytest.approx(0.15)
    assert position == pytest.approx(0.3, abs=1e-6)


@pytest.fixture
def patient(settings):
    return resting_patient(settings.arm, 0.0, 0.0, 0.18)


def test_an_axis_with_nothing_but_nan_goes_on_with_its_sine(patient):
    sine = ArmSettings(amplitude=(0.0, 0.0, 0.15), omega=(0.0, 0.0, 0.8))
    swinging = changed_patient(patient, sine, 1.0)
    aside = ArmSettings(
        target=(0.1, 0.1, math.nan),
        duration=1.0,
        amplitude=(0.0, 0.0, math.nan),
        omega=(0.0, 0.0, math.nan),
    )
    moved = changed_patient(swinging, aside, 2.3)
    assert moved.paths[2] == swinging.paths[2]
    assert moved.paths[0].target == 0.1


def test_nan_keeps_what_is(patient):
    changed = changed_patient(patient, ArmSettings(), 5.0)
    assert changed.arm == patient.arm
    assert [hand_point(path, 6.0)[0] for path in changed.paths] == [0.0, 0.0, 0.18]


def test_a_new_target_starts_where_the_hand_is(patient):
    swinging = changed_patient(
        patient,
        ArmSettings(amplitude=(0.0, 0.0, 0.15), omega=(0.0, 0.0, 0.8)),
        1.0,
    )
    now = 3.0
    before = hand_point(swinging.paths[2], now)[0]
    moved = changed_patient(swinging, ArmSettings(target=(0.1, math.nan, 0.25), duration=1.0), now)
    assert hand_point(moved.paths[2], now)[0] == pytest.approx(before)
    assert hand_point(moved.paths[2], now + 1.5) == (0.25, 0.0)
    assert hand_point(moved.paths[0], now + 1.5)[0] == pytest.approx(0.1)
    assert hand_point(moved.paths[1], now + 1.5)[0] == 0.0


def test_tremor_and_relaxed_change_the_path(patient):
    sine = ArmSettings(amplitude=(0.0, 0.0, 0.15), omega=(0.0, 0.0, 0.8))
    tremor = changed_patient(patient, sine._replace(kind="tremor"), 0.0)
    swing = [hand_point(tremor.paths[0], i / 100.0)[0] for i in range(100)]
    assert max(swing) == pytest.approx(0.008, rel=0.01)
    assert sum(a * b < 0.0 for a, b in zip(swing, swing[1:], strict=False)) in (9, 10)
    relaxed = changed_patient(patient, sine._replace(kind="relaxed"), 0.0)
    assert relaxed.paths[2] == resting(0.18)._replace(omega=0.8)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (ArmSettings(kind="angry"), "kind"),
        (ArmSettings(mass=-1.0), "mass"),
        (ArmSettings(stiffness=1e9), "stiffness"),
        (ArmSettings(damping=math.inf), "damping"),
        (ArmSettings(duration=math.nan), "duration"),
        (ArmSettings(target=(math.inf, 0.0, 0.0)), "target"),
        (ArmSettings(omega=(0.0, 0.0, -math.inf)), "omega"),
    ],
)
def test_impossible_changes_are_refused(patient, change, named):
    with pytest.raises(ValueError, match=named):
        changed_patient(patient, change, 0.0)
