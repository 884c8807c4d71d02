# SPDX-License-Identifier: Apache-2.0
"""The patient: paths of the virtual hand, the kinds of arm, requests to change it."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.plant.fixture import stage_velocity
from screw_module_ros.plant.patient import (
    KINDS,
    STRONGEST,
    TRAITS,
    ArmSettings,
    HandPath,
    HumanArm,
    another_patient,
    arm_force,
    changed_patient,
    hand_point,
    held_up,
    resting,
    resting_patient,
    spring_terms,
)
from screw_module_ros.plant.settings import arm_of, patients
from screw_module_ros.settings import fields, problem

REACH = HandPath(
    start=0.1, target=0.3, begin=2.0, duration=1.5, amplitude=0.15, omega=0.8, tremor=0.0
)


@pytest.mark.parametrize(
    ("time", "position", "velocity"),
    [
        (1.0, 0.1, 0.0),
        (2.0, 0.1, 0.0),
        (2.75, 0.2, 1.875 * 0.2 / 1.5),
        (3.5 - 1e-9, 0.3, 0.0),
        (3.5, 0.3, 0.12),
        (3.5 + math.pi / 2.0 / 0.8, 0.45, 0.0),
    ],
    ids=["before", "begin", "middle", "end", "sine", "its quarter"],
)
def test_minimum_jerk_and_then_a_sine(time, position, velocity):
    assert hand_point(REACH, time) == pytest.approx((position, velocity), abs=1e-8)


@given(st.floats(2.01, 20.0))
def test_velocity_is_the_derivative_of_position(time):
    path = REACH._replace(tremor=0.008)
    if abs(time - 3.5) < 1e-4:
        return  # the sine begins with a step of velocity
    slope = (hand_point(path, time + 1e-6)[0] - hand_point(path, time - 1e-6)[0]) / 2e-6
    assert hand_point(path, time)[1] == pytest.approx(slope, abs=1e-4)


@pytest.mark.parametrize(
    ("change", "force"),
    [
        ({}, (3.0, 300.0, 5.0, STRONGEST, 0.0, 1.0)),
        (KINDS["relaxed"], (3.0, 30.0, 5.0, STRONGEST, 0.0, 1.0)),
        ({"weight": 12.0, "carried": 0.25}, (3.0, 300.0, 5.0, STRONGEST, 9.0, 1.0)),
        ({"carried": 0.0, **KINDS["relaxed"]}, (3.0, 30.0, 5.0, STRONGEST, 20.0, 1.0)),
        ({"carried": 0.0, **KINDS["weak"]}, (3.0, 300.0, 5.0, 8.0, 20.0, 1.0)),
        ({"strength": 30.0, "extension": 0.6}, (3.0, 300.0, 5.0, 30.0, 0.0, 0.6)),
    ],
)
def test_traits_and_what_hangs_on_the_handle(settings, change, force):
    assert arm_force(settings.arm._replace(**change)) == pytest.approx(force)


def test_a_study_s_arm_is_the_shipped_one_which_the_patient_holds_up(settings):
    """Runs from before the weight stay comparable."""
    arm = settings.arm
    assert (arm.weight, arm.carried) == (20.0, 1.0)
    assert held_up(arm.mass, arm.stiffness, arm.damping) == arm_force(arm)


@pytest.mark.parametrize(
    ("hand", "at", "terms"),
    [
        (0.5, 0.1, (0.0, 0.0, 8.0)),
        (0.1, 0.5, (0.0, 0.0, -8.0)),
        (0.11, 0.1, (300.0, 5.0, 0.0)),
    ],
)
def test_a_weak_arm_pulls_with_all_it_has(settings, hand, at, terms):
    weak = arm_force(settings.arm._replace(strength=8.0))
    assert spring_terms(weak, hand, 0.0, at, 0.0) == terms


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


SINE = ArmSettings(amplitude=(0.0, 0.0, 0.15), omega=(0.0, 0.0, 0.8))


def test_an_axis_with_nothing_but_nan_goes_on_with_its_sine(patient):
    swinging = changed_patient(patient, SINE, 1.0)
    kept = (0.0, 0.0, math.nan)
    aside = ArmSettings(target=(0.1, 0.1, math.nan), duration=1.0, amplitude=kept, omega=kept)
    moved = changed_patient(swinging, aside, 2.3)
    assert moved.paths[2] == swinging.paths[2]
    assert moved.paths[0].target == 0.1


def test_nan_keeps_what_is(patient):
    changed = changed_patient(patient, ArmSettings(), 5.0)
    assert changed.arm == patient.arm
    assert [hand_point(path, 6.0)[0] for path in changed.paths] == [0.0, 0.0, 0.18]


def test_a_new_target_starts_where_the_hand_is(patient):
    swinging = changed_patient(patient, SINE, 1.0)
    target = ArmSettings(target=(0.1, math.nan, 0.25), duration=1.0)
    x, y, z = changed_patient(swinging, target, 3.0).paths
    assert hand_point(z, 3.0)[0] == pytest.approx(hand_point(swinging.paths[2], 3.0)[0])
    assert hand_point(z, 4.5) == (0.25, 0.0)
    assert hand_point(x, 4.5)[0] == pytest.approx(0.1)
    assert hand_point(y, 4.5)[0] == 0.0


def test_a_tired_arm_is_weaker_and_a_stretched_one_weaker_still(settings):
    weak = arm_force(settings.arm._replace(strength=8.0))
    assert spring_terms(weak, 0.1, 0.0, 0.5, 0.0, 0.5, 0.6) == (0.0, 0.0, -4.0)
    assert spring_terms(weak, 0.5, 0.0, 0.1, 0.0, 0.5, 0.6) == (0.0, 0.0, pytest.approx(2.4))


def test_a_hand_at_rest_sets_out_after_the_reaction_and_one_under_way_at_once(settings):
    slow = resting_patient(settings.arm._replace(reaction=0.4), 0.0, 0.0, 0.18)
    there = ArmSettings(target=(0.1, 0.0, 0.18), duration=1.0)
    out = changed_patient(slow, there, 5.0)
    assert out.paths[0].begin == pytest.approx(5.4)
    waiting = changed_patient(out, there._replace(target=(0.05, 0.0, 0.18)), 5.2)
    assert (waiting.paths[0].begin, waiting.paths[0].target) == (pytest.approx(5.4), 0.05)
    back = changed_patient(out, there._replace(target=(0.0, 0.0, 0.18)), 5.9)
    assert back.paths[0].begin == 5.9
    step = changed_patient(slow, there._replace(duration=0.0), 5.0).paths[0]
    assert hand_point(step, 5.2) == (0.0, 0.0)
    assert hand_point(step, 5.5) == (0.1, 0.0)


@pytest.mark.parametrize(
    ("hand", "effort"),
    [((0.0, 0.0, 0.18), 0.9), ((0.05, 0.0, 0.18), 0.95), ((0.3, 0.0, 0.18), 1.0), ((), 1.0)],
    ids=["it was easy", "he missed by 5 cm", "by far", "he does not look"],
)
def test_a_slacking_patient_forgets_where_he_missed_little(settings, hand, effort):
    slack = resting_patient(settings.arm._replace(slack=0.1, regret=1.0), 0.0, 0.0, 0.18)
    there = ArmSettings(target=(0.1, 0.0, 0.18), duration=1.0)
    moving = changed_patient(slack, there, 5.0, hand)
    assert moving.effort == pytest.approx(effort)
    assert changed_patient(moving, there, 9.0, hand).effort == moving.effort, "nowhere else"
    under_way = changed_patient(moving, there._replace(target=(0.0, 0.0, 0.18)), 5.5, hand)
    assert under_way.effort == moving.effort
    assert another_patient(moving, settings.arm, ArmSettings()).effort == 1.0


def test_tremor_and_relaxed_change_the_path(patient):
    tremor = changed_patient(patient, SINE._replace(kind="tremor"), 0.0)
    swing = [hand_point(tremor.paths[0], i / 100.0)[0] for i in range(100)]
    assert max(swing) == pytest.approx(0.008, rel=0.01)
    assert sum(a * b < 0.0 for a, b in zip(swing, swing[1:], strict=False)) in (9, 10)
    relaxed = changed_patient(patient, SINE._replace(kind="relaxed"), 0.0)
    assert relaxed.paths[2] == resting(0.18)._replace(omega=0.8)
    shaking = changed_patient(patient, ArmSettings(traits=("tremor", "tremor_rate"),
                                                   values=(0.004, 8.0)), 0.0).paths[0]  # fmt: skip
    assert hand_point(shaking, 1.0 / 32.0)[0] == pytest.approx(0.004)


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_is_a_name_for_some_traits_and_the_others_stay(patient, kind):
    own = changed_patient(patient, ArmSettings(traits=("tone", "carried"), values=(9.0, 0.3)), 0.0)
    changed = changed_patient(own, ArmSettings(kind=kind), 0.0)
    assert changed.arm == own.arm._replace(**KINDS[kind])
    again = changed_patient(changed, ArmSettings(kind="active"), 0.0)
    assert again.arm == own.arm, "what one kind sets, another takes away"


def test_traits_are_set_by_name_and_the_others_stay(patient):
    one = changed_patient(patient, ArmSettings(traits=("carried",), values=(0.0,)), 0.0)
    assert one.arm == patient.arm._replace(carried=0.0)
    names = ("carried", "weight")
    two = changed_patient(one, ArmSettings(traits=names, values=(0.5, 12.0)), 0.0)
    assert two.arm == patient.arm._replace(weight=12.0, carried=0.5)


@pytest.mark.parametrize(
    ("traits", "values", "said"),
    [
        (("wieght",), (5.0,), "'wieght' is unknown; there are weight from 0 to 60 N, carried"),
        (("mass",), (5.0,), "'mass' is unknown"),
        (("weight",), (math.nan,), "weight = nan: a finite number"),
        (("weight",), (-1.0,), "weight = -1.0 N: below the smallest allowed, 0 N"),
        (("carried",), (1.5,), "carried = 1.5: above the largest allowed, 1"),
        (("weight", "carried"), (5.0,), "2 names, values: 1 numbers"),
        ((), (5.0,), "0 names, values: 1 numbers"),
        (("weight", "weight"), (5.0, 6.0), "name each once"),
    ],
)
def test_odd_traits_are_refused_in_one_sentence(patient, traits, values, said):
    with pytest.raises(ValueError, match=said):
        changed_patient(patient, ArmSettings(traits=traits, values=values), 0.0)


@pytest.mark.parametrize("name", patients())
def test_a_patient_is_a_name_for_all_of_an_arm_and_the_hand_goes_on_its_way(patient, name):
    """What a plain request holds beside the name, zeros, does not count."""
    asked = ArmSettings("", 0.0, 0.0, 0.0, (0.0,) * 3, patient=name)
    changed = another_patient(patient, arm_of(name), asked)
    assert changed.arm == patients()[name]
    for path, before in zip(changed.paths, patient.paths, strict=True):
        assert path._replace(tremor=0.0) == before._replace(tremor=0.0)
    assert changed.paths[0].tremor == patients()[name].tremor


@pytest.mark.parametrize(("name", "traits", "values", "weight"), [
    ("healthy", (), (), 0.0),
    ("weak", ("weight", "carried"), (15.0, 0.5), 7.5),
    ("flaccid", ("weight",), (9.0,), 9.0),
    ("flaccid", ("carried",), (1.0,), 0.0),
])  # fmt: skip
def test_what_hangs_on_the_handle_of_a_patient_with_other_traits(
    patient, name, traits, values, weight
):
    asked = ArmSettings(patient=name, traits=traits, values=values)
    arm = another_patient(patient, arm_of(name), asked).arm
    assert arm_force(arm).weight == pytest.approx(weight)


def test_an_unknown_patient_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match="'lazy': one of healthy, weak, tremor, .* is wanted"):
        arm_of("lazy")


def test_every_patient_is_within_the_ranges_of_an_arm():
    for arm in patients().values():
        for name, field in fields(HumanArm).items():
            assert problem(field, getattr(arm, name)) == ""


def test_every_trait_has_a_range_and_a_text():
    for field in TRAITS.values():
        assert field.kind is float and field.setting.text
        assert -math.inf < field.setting.low < field.setting.high < math.inf


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
