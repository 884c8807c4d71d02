# SPDX-License-Identifier: Apache-2.0
"""The rig as devices meet it: counts, time, power, fixtures, truth."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import settings as run_settings
from hypothesis import strategies as st

from screw_module_ros.plant.patient import KINDS
from screw_module_ros.plant.world import ArmSettings, Truth, World

SINE = ArmSettings(
    target=(0.1, 0.05, 0.2), duration=0.2, amplitude=(0.0, 0.0, 0.1), omega=(0.0, 0.0, 2.0)
)


def numbers(value):
    for part in value:
        if isinstance(part, tuple | list):
            yield from numbers(part)
        elif isinstance(part, float):
            yield part


def test_truth_mirrors_the_message():
    message = Path(__file__).parents[2] / "msg_defs" / "msg" / "SimTruth.msg"
    names = re.findall(r"^[\w/\[\]]+ +(\w+)", message.read_text(), re.M)
    assert [name for name in names if name not in ("header", "slipped")] == list(Truth._fields)


def test_counts_are_quantised_and_offset(settings):
    start = settings.start._replace(encoder_offset=1000, shoulder_offset=-5, elbow_offset=7)
    plain, moved = World(settings), World(settings._replace(start=start))
    truth, (shoulder, elbow) = plain.truth(), plain.planar_counts
    assert plain.encoder_count == math.floor(truth.nut_position / 9.525e-7)
    assert (shoulder, elbow) == tuple(math.floor(q / 9.587e-5) for q in truth.joint_position)
    assert moved.encoder_count == plain.encoder_count + 1000
    assert moved.planar_counts == (shoulder - 5, elbow + 7)


def test_encoder_follows_the_nut_by_single_counts(settings):
    world, counts = World(settings), []
    world.set_fixture("stage", speed=0.002)
    world.advance(0.1)  # through the play
    for _ in range(3000):
        world.advance(1e-4)
        counts.append(world.encoder_count)
    assert {b - a for a, b in zip(counts, counts[1:], strict=False)} == {0, 1}


def ran(settings, seed, chunk, count, compile=True):
    """Move hand and motors; return the true values and the wrenches on the way."""
    world, wrenches = World(settings, seed, compile), []
    world.set_arm(SINE)
    world.vertical_powered, world.planar_powered = True, (True, True)
    world.vertical_command, world.planar_command = 2.0, (2.0, -1.0)
    for _ in range(count):
        world.advance(chunk)
        wrenches.append(world.wrench())
    return world.truth(), wrenches


def test_chunks_of_time_do_not_matter(settings):
    expected, _ = ran(settings, 4, 0.3, 1)
    assert ran(settings, 4, 1e-3, 300)[0] == ran(settings, 4, 1e-4, 3000)[0] == expected


def test_same_seed_same_run_and_another_is_another_transducer(settings):
    first, other = (ran(settings, seed, 1e-3, 50) for seed in (3, 4))
    assert ran(settings, 3, 1e-3, 50) == first
    assert first[0] == other[0]
    assert first[1] != other[1]


def test_plain_and_compiled_worlds_agree(settings):
    one, other = (list(numbers(ran(settings, 2, 1e-3, 40, how))) for how in (True, False))
    assert one == pytest.approx(other, rel=1e-6, abs=1e-9)


def test_wrench_asked_twice_is_one_sample(settings):
    world = World(settings)
    world.advance(1e-3)
    first = world.wrench()
    assert world.wrench() == first
    world.advance(1e-3)
    assert world.wrench() != first


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("command", ["vertical_command", "planar_command"])
def test_impossible_commands_are_refused(settings, bad, command):
    world = World(settings)
    setattr(world, command, bad if command == "vertical_command" else (0.0, bad))
    with pytest.raises(ValueError, match=command):
        world.advance(1e-3)


@pytest.mark.parametrize("dt", [math.nan, math.inf, -1e-3])
def test_time_runs_forward(settings, dt):
    with pytest.raises(ValueError, match="dt"):
        World(settings).advance(dt)


def test_drives_without_power_coast_and_shorted_ones_brake(settings):
    world = World(settings)
    world.vertical_command, world.planar_command = 5.0, (5.0, 5.0)
    world.advance(0.05)
    assert (world.vertical_torque, world.planar_torque) == (0.0, (0.0, 0.0))
    world.vertical_powered, world.planar_powered = True, (True, False)
    world.advance(0.05)
    assert world.vertical_torque > 0.7
    assert world.planar_torque == pytest.approx((5.0, 0.0), rel=1e-6, abs=0.0)
    world.vertical_powered, world.planar_powered = False, (False, False)
    world.vertical_braked, world.planar_braked = True, (True, True)
    world.advance(0.002)
    truth = world.truth()
    torques = (world.vertical_torque, *world.planar_torque)
    for torque, velocity in zip(torques, (truth.nut_velocity, *truth.joint_velocity), strict=True):
        assert torque * velocity < 0.0


@pytest.mark.parametrize("weight", [5.0, 11.0, 20.0, 24.0])
@pytest.mark.parametrize("kind", KINDS)
def test_the_transducer_shows_the_weight_of_a_resting_arm(settings, weight, kind):
    """Beyond its zero, which a free handle shows; the pin holds the handle."""
    world = World(settings, 3)
    world.set_arm(ArmSettings(kind, target=(math.nan, math.nan, 0.25), damping=80.0))
    world.set_fixture("free", locked=True)
    zero = mean_force(world)
    world.set_fixture("human_arm", locked=True)
    world.set_arm(ArmSettings(traits=("weight", "carried"), values=(weight, 0.0)))
    assert mean_force(world) - zero == pytest.approx(-weight, abs=0.3)
    world.set_arm(ArmSettings(traits=("carried",), values=(0.4,)))
    assert mean_force(world) - zero == pytest.approx(-0.6 * weight, abs=0.3)


def mean_force(world):
    """Return the mean of the vertical force that the transducer shows over a second [N]."""
    world.advance(1.0)
    forces = []
    for _ in range(1000):
        world.advance(1e-3)
        forces.append(world.wrench()[2])
    return sum(forces) / len(forces)


@pytest.mark.parametrize(
    ("weight", "braked", "fallen", "fastest"),
    [(10.0, False, 0.074, 0.33), (20.0, False, 0.168, 0.60), (20.0, True, 0.008, 0.017)],
)
def test_what_a_hanging_arm_does_without_torque(settings, weight, braked, fallen, fastest):
    """The figures of docs/hazards.md: fallen in 0.5 s [m], fastest [m/s]; shorted, it brakes."""
    arm = settings.arm._replace(mass=2.04, stiffness=30.0, damping=10.0, weight=weight, carried=0.0)
    world, speeds = World(settings._replace(arm=arm)), []
    world.vertical_braked = braked
    for _ in range(1500):
        world.advance(1e-3)
        speeds.append(-world.truth().handle_velocity)
        if len(speeds) == 500:
            assert 0.25 - world.truth().handle_position == pytest.approx(fallen, rel=0.05)
    assert max(speeds) == pytest.approx(fastest, rel=0.05)


@pytest.mark.parametrize(
    ("weight", "mass", "stiffness", "damping", "least", "most"),
    [
        (10.0, 2.04, 30.0, 10.0, 140.0, 175.0),
        (20.0, 2.04, 30.0, 10.0, 230.0, 305.0),
        (20.0, 3.0, 30.0, 10.0, 360.0, 400.0),
        (20.0, 2.04, 0.0, 0.0, 390.0, 440.0),
    ],
)
def test_how_hard_a_fallen_arm_meets_the_stop(
    settings, weight, mass, stiffness, damping, least, most
):
    """The blows of docs/hardware.md [N]: the arm's mass decides, and what still holds it."""
    arm = settings.arm._replace(
        mass=mass, stiffness=stiffness, damping=damping, weight=weight, carried=0.0
    )
    world, blow = World(settings._replace(arm=arm)), 0.0
    for _ in range(6000):
        world.advance(0.25e-3)
        blow = max(blow, abs(world.truth().patient_force))
    assert least <= blow <= most


def test_friction_does_not_carry_the_empty_handle_at_each_height(settings):
    fell = []
    for n in range(12):
        start = settings.start._replace(position=0.02 + 0.03 * n)
        arm = settings.arm._replace(mass=0.05, stiffness=0.0, damping=0.0, weight=0.0)
        world = World(settings._replace(arm=arm, start=start))
        before = world.truth().handle_position
        world.advance(1.0)
        fell.append(before - world.truth().handle_position > 0.01)
    assert any(fell)
    assert not all(fell)


def test_handle_is_carried_to_where_the_fixture_starts(settings):
    world = World(settings)
    world.set_fixture("free", position=0.3)
    way = [world.truth()]
    while way[-1].fixture != "free" and len(way) < 2000:
        world.advance(1e-3)
        way.append(world.truth())
    places = [each.handle_position for each in way]
    assert way[-1].fixture == "free"
    assert places[-1] == pytest.approx(0.3, abs=1e-5)
    assert max(abs(b - a) for a, b in zip(places, places[1:], strict=False)) <= 1e-4 + 1e-12


def test_the_plane_bends_between_its_encoders_and_the_handle(settings):
    """A hand pulls while friction holds the joints: the truth is the handle's, the counts stay."""
    firm = settings.planar._replace(friction=10.0, bristle_stiffness=1e6)
    world = World(settings._replace(planar=firm))
    before, counts = world.truth(), world.planar_counts
    world.set_arm(ArmSettings(stiffness=300.0, target=(0.03, 0.0, 0.25), duration=0.5))
    world.advance(3.0)
    truth = world.truth()
    moved = [b - a for a, b in zip(before.planar_position, truth.planar_position, strict=True)]
    assert truth.planar_force == pytest.approx((9.0, 0.0), abs=0.05)
    assert moved == pytest.approx([9.0 / 2e5, 0.0], abs=0.1 * 9.0 / 2e5)
    assert world.planar_counts == counts


def test_placed_patient_holds_still(settings):
    world = World(settings)
    world.set_fixture("human_arm", position=0.31)
    world.advance(3.0)
    truth = world.truth()
    assert truth.fixture == "human_arm"
    assert truth.handle_position == pytest.approx(0.31, abs=1e-3)
    assert truth.hand_target == pytest.approx(0.31)


def test_stage_runs_to_the_end_and_stays(settings):
    world = World(settings)
    world.set_fixture("stage", speed=0.15)
    world.advance(0.3)
    assert world.truth().handle_velocity == pytest.approx(0.15)
    world.advance(3.0)
    assert world.truth().handle_position == pytest.approx(0.36, abs=1e-6)
    world.set_fixture("stage", speed=-0.15)
    world.advance(4.0)
    assert world.truth().handle_position == pytest.approx(0.0, abs=1e-6)
    world.set_fixture("stage")
    world.advance(0.1)
    assert world.truth().handle_velocity == 0.0


def test_place_is_immediate(settings):
    world = World(settings)
    world.place(0.05)
    assert world.truth().nut_position == 0.05
    with pytest.raises(ValueError, match="position"):
        world.place(0.5)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"name": "hand"}, "fixture"),
        ({"name": "stage", "speed": 5.0}, "speed"),
        ({"name": "stage", "speed": math.nan}, "speed"),
        ({"name": "free", "position": 0.5}, "position"),
        ({"name": "stage", "locked": True}, "unlock"),
        ({"position": 0.2, "locked": True}, "unlock"),
        ({"name": "locked_rotor", "position": 0.2}, "rotor"),
    ],
)
def test_impossible_fixtures_are_refused_and_change_nothing(settings, change, named):
    world = World(settings)
    before = world.truth()
    with pytest.raises(ValueError, match=named):
        world.set_fixture(**change)
    assert world.truth() == before


ACTIONS = st.one_of(
    st.tuples(st.just("command"), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
    st.tuples(st.just("power"), st.booleans(), st.booleans()),
    st.tuples(
        st.just("fixture"),
        st.sampled_from(["human_arm", "free", "stage", "locked_rotor"]),
        st.floats(-1.0, 1.0),
    ),
    st.tuples(st.just("pin"), st.booleans(), st.booleans()),
    st.tuples(
        st.just("arm"), st.sampled_from(["active", "relaxed", "tremor", "weak"]),
        st.floats(-0.5, 0.5),
    ),
)  # fmt: skip


def act(world, kind, one, other):
    if kind == "command":
        world.vertical_command, world.planar_command = one, (other, one)
    elif kind == "power":
        world.vertical_powered, world.planar_powered = one, (one, other)
        world.vertical_braked, world.planar_braked = other, (other, not other)
    elif kind == "fixture":
        world.set_fixture(one, speed=other)
    elif kind == "pin":
        stage = world.truth().fixture == "stage"
        world.set_fixture("free" if stage else "", locked=one, upside_down=other)
    else:
        world.set_arm(ArmSettings(kind=one, target=(other, -other, other), duration=0.1))


@run_settings(max_examples=40)
@given(st.lists(st.tuples(ACTIONS, st.floats(0.0, 0.4)), min_size=1, max_size=12))
def test_state_stays_finite_and_in_its_room(settings, steps):
    world = World(settings)
    for action, time in steps:
        act(world, *action)
        world.advance(time)
        truth = world.truth()
        assert all(map(math.isfinite, numbers((*truth, *world.wrench()))))
        assert -0.05 < truth.handle_position < 0.41
        assert abs(truth.handle_position - truth.nut_position) < 1e-3
        assert abs(truth.nut_velocity) < 50.0
        assert math.hypot(truth.planar_position[0], truth.planar_position[1] - 0.60) < 0.93
