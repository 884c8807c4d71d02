# SPDX-License-Identifier: Apache-2.0
"""Sessions with simulated patients: order, pause, abort and adaptation."""

import math
from statistics import mean

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_patient import FEEBLE, HEALTHY, Simulation

from screw_module_ros.therapy.hand import HandSample
from screw_module_ros.therapy.line import NO_SLOT
from screw_module_ros.therapy.protocol_file import load_protocol
from screw_module_ros.therapy.session import Session, State

pytestmark = pytest.mark.long

CLOCK = load_protocol("clock_adaptive")
STEADY = HEALTHY._replace(bow=0.003)


def part(protocol, *blocks, circuits=None, targets=None, give_up=6.0):
    """The protocol with some of its blocks, each with a number of circuits and of targets."""
    kept = [protocol.blocks[index] for index in blocks]
    if circuits:
        kept = [block._replace(circuits=circuits) for block in kept]
    if targets:
        kept = [block._replace(targets=block.targets._replace(count=targets)) for block in kept]
    rules = protocol.rules._replace(give_up=give_up)
    return protocol._replace(blocks=tuple(kept), rules=rules)


def played(person, protocol=None, seed=1):
    """The person holds the arm himself, so that weighing finds none of it."""
    session = Session(protocol or part(CLOCK, 0), weight=0.0)
    samples = Simulation(session, person, seed).run()
    return session, samples


@pytest.mark.parametrize("name", ["evaluation", "lift"])
def test_a_circle_is_drawn_round_its_centre_in_the_plane_and_in_space(name):
    """314 cm² would be the whole circle: a hand that is drawn along a chord cuts the corners."""
    session, _ = played(STEADY, part(load_protocol(name), 1, circuits=1))
    (circle,) = session.results
    assert 0.018 < circle["work_area"] < 0.032
    assert circle["independence"] > 0.8


def test_same_samples_same_numbers_bit_for_bit():
    protocol = part(CLOCK, 0, 1, circuits=1, targets=2)
    (one, samples), (other, again) = (played(FEEBLE, protocol) for _ in range(2))
    assert samples == again
    assert repr(one.results) == repr(other.results)


def test_a_steady_patient_settles_at_soft_walls_and_short_time():
    session, _ = played(STEADY, part(CLOCK, 1, circuits=11))
    assert session.state == State.FINISHED
    assert len(session.changes) == 7
    assert session.assistance.duration == CLOCK.adaptation.shortest
    assert session.assistance.side_stiffness < 70.0
    last = [change.after.side_stiffness for change in session.changes[-3:]]
    assert max(last) - min(last) < 0.05 * (CLOCK.adaptation.stiffest - CLOCK.adaptation.softest)


def test_a_weak_patient_settles_at_a_longer_time_and_is_brought_to_the_target():
    protocol = part(CLOCK, 1, circuits=3, targets=3, give_up=CLOCK.rules.give_up)
    weak, _ = played(FEEBLE, protocol)
    steady, _ = played(STEADY, protocol)
    assert weak.assistance.duration > 1.8 * steady.assistance.duration
    assert mean(r["reached"] for r in weak.results) > 0.9
    share = [mean(r["robot_share"] for r in s.results) for s in (weak, steady)]
    assert share[0] > 2.0 * share[1], "the robot does more of the work"


def test_a_weak_patient_is_given_more_and_more_time():
    """A patient who is always late lags each time, also behind a wall at the target."""
    session, _ = played(FEEBLE, part(CLOCK, 1, circuits=10, targets=1, give_up=12.0))
    times = [change.after.duration for change in session.changes]
    assert times == sorted(times)
    assert times[-1] > 2.0


def test_a_crooked_hand_gets_stiffer_walls_and_a_straighter_path():
    crooked = HEALTHY._replace(bow=0.02)
    session, _ = played(crooked, part(CLOCK, 1, circuits=8))
    assert session.assistance.side_stiffness > 200.0
    strays = []
    for stiffness in (25.0, 300.0):
        guidance = CLOCK.guidance._replace(side_stiffness=stiffness)
        fixed = part(CLOCK, 1, circuits=1)._replace(guidance=guidance, adaptation=None)
        session, _ = played(crooked, fixed)
        assert not session.changes
        strays.append(mean(math.sqrt(r["pm3"]) for r in session.results))
    assert strays[1] < 0.9 * strays[0]


def test_elevator_and_space():
    for name in ("elevator", "reach_3d"):
        protocol = part(load_protocol(name), 1, circuits=1)
        session, _ = played(HEALTHY, protocol)
        assert session.state == State.FINISHED, session.reason
        assert all(result["reached"] for result in session.results)
        (change,) = session.changes
        # The column has no side walls: no accuracy could be shown, and none is claimed.
        has_sides = name != "elevator"
        assert ("side walls" in change.reason) is has_sides
        assert (change.before.side_stiffness != change.after.side_stiffness) is has_sides
        assert change.before.duration != change.after.duration
    evaluation = load_protocol("evaluation")
    assert played(HEALTHY, part(evaluation, 0, circuits=1))[0].state == State.FINISHED


@pytest.mark.parametrize(("pull", "begins"), [(5.0, True), (10.0, True), (12.0, False)])
def test_a_pull_to_the_body_keeps_no_session_from_its_beginning(pull, begins):
    """With 5 N no movement was begun, as the hand hung 11 mm from the start, for ever."""
    session = Session(part(CLOCK, 0, circuits=1, targets=1))
    simulation = Simulation(session, HEALTHY, 1)
    simulation.pull = (0.0, -pull, 0.0)
    simulation.run(40.0)
    assert (len(session.results) > 0) is begins
    assert ("from the start of trial 1 after 20 s" in session.reason) is not begins


def rest(session, sample):
    """Let the hand rest where the sample is, until a trial waits for it."""
    for number in range(200):
        session.take(sample._replace(time_ns=sample.time_ns + number * 5_000_000))


@pytest.mark.parametrize(("name", "place"), [
    ("clock_adaptive", (0.0, 0.0, 0.25)), ("elevator", (0.06, -0.04, 0.18)),
])  # fmt: skip
def test_what_a_protocol_does_not_use_is_held_where_the_hand_is(name, place):
    """The vertical spring pulled up to a set point of long ago, all session."""
    session = Session(load_protocol(name))
    sample = Simulation(session, HEALTHY, 1).sample()
    here = sample._replace(x=place[0], y=place[1], z=place[2])
    session.take(here)
    assert session.wish.hold is None, "what pulled it before lets it go first"
    rest(session, here)
    hold = session.wish.hold
    assert hold == (place, name == "clock_adaptive", 800.0)
    session.take(sample._replace(x=0.01, z=0.2))
    assert session.wish.hold == hold, "it stays where it began"
    session.pause("the arm pulls hard")
    assert session.wish == NO_SLOT
    session.resume()
    rest(session, here._replace(z=0.21) if hold.vertical else here._replace(x=0.02))
    x, _, z = session.wish.hold.point
    assert (z if hold.vertical else x) == (0.21 if hold.vertical else 0.02), "held anew"
    session.abort("the therapist ended it")
    assert session.wish == NO_SLOT


@pytest.mark.parametrize("gone", [{"others": False}, {"z": math.nan}])
def test_an_axis_without_torque_or_home_is_not_held(gone):
    """Else it would jump back to where it was held as soon as the torque comes."""
    session = Session(CLOCK)
    sample = Simulation(session, HEALTHY, 1).sample()
    rest(session, sample)
    assert session.wish.hold is not None
    session.take(sample._replace(**gone))
    assert session.state == State.RUNNING and session.wish.hold is None
    session.take(sample._replace(z=0.1))
    assert session.wish.hold.point[2] == 0.1


def test_in_space_every_axis_is_guided():
    session = Session(load_protocol("reach_3d"))
    session.take(Simulation(session, HEALTHY, 1).sample())
    assert session.wish.hold is None and session.wish.vertical is not None


def test_stop_pauses_and_takes_the_slot_away_until_resumed():
    session = Session(part(CLOCK, 1, circuits=1))
    simulation = Simulation(session, HEALTHY, 1)
    simulation.run(4.0)
    done = len(session.results)
    assert done > 0 and session.wish != NO_SLOT
    session.take(simulation.sample()._replace(stop="the vertical drive is off"))
    assert (session.state, session.reason) == (State.PAUSED, "the vertical drive is off")
    assert session.wish == NO_SLOT
    before = session.trial
    session.take(simulation.sample())
    assert session.trial is before and session.state == State.PAUSED
    session.resume()
    assert session.state == State.RUNNING and session.reason == ""
    simulation.run()
    assert session.state == State.FINISHED
    assert [r["trial"] for r in session.results] == list(range(1, 17))


def test_a_session_that_starts_counts_nothing_until_it_begins():
    session = Session(CLOCK, "waiting for the recording")
    simulation = Simulation(session, HEALTHY, 1)
    session.take(simulation.sample())
    session.resume()
    assert (session.state, session.reason) == (State.STARTING, "waiting for the recording")
    assert session.wish == NO_SLOT and session.trial.wish == NO_SLOT
    session.begin()
    assert (session.state, session.reason) == (State.RUNNING, "")
    session.take(simulation.sample())
    assert session.wish != NO_SLOT


@pytest.mark.parametrize("act", ["pause", "abort"])
def test_what_ends_a_start_holds_when_the_recording_begins(act):
    session = Session(CLOCK, "waiting for the recording")
    getattr(session, act)("the therapist did it")
    session.begin()
    assert session.state == {"pause": State.PAUSED, "abort": State.ABORTED}[act]
    assert session.reason == "the therapist did it"


def test_abort_ends_it_for_good():
    session = Session(CLOCK)
    simulation = Simulation(session, HEALTHY, 1)
    simulation.run(3.0)
    session.abort("the therapist ended it")
    assert session.state == State.ABORTED and session.wish == NO_SLOT
    session.resume()
    session.pause("late")
    session.take(simulation.sample())
    assert (session.state, session.reason) == (State.ABORTED, "the therapist ended it")


def test_a_hand_that_cannot_be_brought_to_the_start_pauses():
    session = Session(CLOCK)
    simulation = Simulation(session, HEALTHY, 1)
    for second in range(21 * 200):
        session.take(simulation.sample()._replace(time_ns=second * 5_000_000, y=0.1))
        if session.state == State.PAUSED:
            break
    assert "100 mm from the start" in session.reason


def test_adaptation_begins_anew_in_each_block_but_keeps_what_it_gave():
    protocol = part(CLOCK, 1, 0, 1, circuits=1)
    session, _ = played(STEADY, protocol)
    assert [change.circuit for change in session.changes] == [1, 1]
    assert session.changes[1].before == session.changes[0].after
    third = [r for r in session.results if r["block"] == 3]
    assert {r["slot_duration"] for r in third} == {session.changes[0].after.duration}
    free = [r for r in session.results if r["block"] == 2]
    assert {(r["slot_duration"], r["side_stiffness"]) for r in free} == {(1.4, 0.0)}


numbers = st.floats(allow_nan=True, allow_infinity=True, width=32)
places = st.floats(-0.2, 0.2)
acts = st.sampled_from(("pause", "resume", "", "", "", "", "", "", ""))
moments = st.tuples(
    st.integers(0, 40), acts, st.tuples(*[st.one_of(places, numbers)] * 9), st.integers(1, 200)
)


@settings(max_examples=60)
@given(st.sampled_from(("clock_adaptive", "evaluation", "reach_3d")), st.lists(moments, max_size=8))
def test_whatever_is_measured_a_session_goes_on_or_pauses(name, moments):
    """No sample raises an error, and all requested slots are valid."""
    session = Session(load_protocol(name))
    count = 0
    for gap, act, values, repeats in moments:
        if act == "pause":
            session.pause("asked for")
        else:
            session.resume()
        for _ in range(repeats):
            count += 1 + gap
            session.take(HandSample(5 * count, 5_000_000 * count, *values))
            for slot in (session.wish.plane, session.wish.vertical):
                assert slot is None or slot.validated()
    assert all(result["samples"] > 0 for result in session.results)


def test_a_position_that_is_not_known_pauses():
    session = Session(CLOCK)
    session.take(HandSample(0, 0, math.nan, *(0.0,) * 8))
    assert (session.state, session.wish) == (State.PAUSED, NO_SLOT)
    assert session.reason == "where the hand is, or its speed, is not known"
