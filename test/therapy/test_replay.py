# SPDX-License-Identifier: Apache-2.0
"""A replay reproduces the session bit for bit, or reports gaps and differences."""

from __future__ import annotations

import random

import pytest
from simulated_patient import HEALTHY, Simulation

from screw_module_ros.therapy.cli import csv_text
from screw_module_ros.therapy.gaps import gaps_of
from screw_module_ros.therapy.hand import HandSample
from screw_module_ros.therapy.measures import COLUMNS
from screw_module_ros.therapy.protocol_file import load_protocol
from screw_module_ros.therapy.recorded import Act
from screw_module_ros.therapy.replay import replay
from screw_module_ros.therapy.session import Session, State
from screw_module_ros.therapy.support import BlockSupport, Fade

CLOCK = load_protocol("clock_adaptive")
SHORT = CLOCK._replace(
    blocks=tuple(
        CLOCK.blocks[index]._replace(
            circuits=1, targets=CLOCK.blocks[index].targets._replace(count=2)
        )
        for index in (0, 1)
    )
)


@pytest.fixture(scope="module")
def recorded():
    """Samples, acts and results of a session that was paused, also by the robot, and resumed."""
    session = Session(SHORT)
    simulation = Simulation(session, HEALTHY, 3)
    samples = simulation.run(5.0)
    acts = [Act(0, State.RUNNING, "")]
    session.pause("the therapist paused it")
    acts.append(Act(samples[-1].sequence, State.PAUSED, session.reason))
    for _ in range(3):
        samples.append(simulation.sample())
        session.take(samples[-1])
        simulation.step()
        simulation.step()
    session.resume()
    acts.append(Act(samples[-1].sequence, State.RUNNING, ""))
    samples += simulation.run(4.0)
    stopped = simulation.sample()._replace(stop="the plane's torque is off")
    session.take(stopped)
    samples.append(stopped)
    acts.append(Act(stopped.sequence, State.PAUSED, session.reason))
    simulation.step()
    simulation.step()
    session.resume()
    acts.append(Act(stopped.sequence, State.RUNNING, ""))
    samples += simulation.run()
    assert session.state == State.FINISHED
    acts.append(Act(samples[-1].sequence, State.FINISHED, ""))
    return samples, acts, session.results


def test_equal_bit_for_bit(recorded):
    found = replay(SHORT, *recorded)
    assert found.problems == []
    assert found.gaps == ()
    assert found.verdict == f"equal: 8 trials from {found.samples} samples, bit for bit"


def test_a_lost_sample_is_named_with_its_place(recorded):
    samples, acts, results = recorded
    inside = next(
        index for index, sample in enumerate(samples) if sample.sequence == results[4]["first"]
    ) + 20
    found = replay(SHORT, samples[:inside] + samples[inside + 3 :], acts, results)
    (gap,) = found.gaps
    assert gap == (samples[inside - 1].sequence, 3)
    assert found.problems[0] == (
        f"3 samples missing after tick {samples[inside - 1].sequence}, in trial 5"
    )
    assert any(problem.startswith("trial 5: samples") for problem in found.problems)
    assert "3 samples missing" in found.verdict


def test_a_changed_number_is_found(recorded):
    samples, acts, results = recorded
    tampered = [dict(row) for row in results]
    tampered[2]["path_error"] *= 1.0 + 1e-15
    found = replay(SHORT, samples, acts, tampered)
    (problem,) = found.problems
    assert problem.startswith("trial 3: path_error")
    assert found.verdict == "NOT equal: 1 problems, no sample missing in the recording"


def test_samples_that_only_the_session_missed_are_told(recorded):
    """The verdict said that no sample is missing, below six hundred differing figures."""
    samples, acts, results = recorded
    late = [dict(row) for row in results]
    late[4]["missing"] += 7
    found = replay(SHORT, samples, acts, late)
    assert found.problems[0] == "trial 5: 7 recorded samples did not reach the session"
    assert found.verdict == (
        "NOT equal: 2 problems, no sample missing in the recording, "
        "but 7 recorded samples did not reach the session"
    )


def test_results_that_one_side_lacks(recorded):
    samples, acts, results = recorded
    assert replay(SHORT, samples, acts, results[1:]).problems == [
        "trial 1: replayed, but its result was not recorded"
    ]
    cut = replay(SHORT, samples[:-400], acts, results)
    assert "trial 8: recorded, but the replay does not complete it" in cut.problems


def test_abort_and_no_start(recorded):
    samples, acts, results = recorded
    ended = [acts[0], Act(samples[900].sequence, State.ABORTED, "the therapist ended it")]
    done = [row for row in results if row["last"] <= samples[900].sequence]
    assert done and replay(SHORT, samples, ended, done).problems == []
    with pytest.raises(ValueError, match="start is not recorded"):
        replay(SHORT, samples, acts[1:2], results)


def test_a_pause_too_short_to_be_told_began_the_trial_anew():
    """Pause and resume between two messages: only the later start of `running` shows them."""
    session = Session(SHORT)
    simulation = Simulation(session, HEALTHY, 4)
    samples = simulation.run(3.7)
    acts = [Act(0, State.RUNNING, ""), Act(samples[-1].sequence, State.RUNNING, "")]
    before = session.trial
    session.pause("the therapist paused it")
    session.resume()
    assert session.trial is not before
    samples += simulation.run()
    results = session.results
    assert replay(SHORT, samples, acts, results).problems == []


FADE = Fade(to=0.0, step=0.25, after=0.6, back=0.3)


def fading(by_hand_after=None):
    """Play a session whose support fades; by hand after so many samples."""
    protocol = SHORT._replace(blocks=tuple(
        block._replace(circuits=3, support=BlockSupport(share=1.0, fade=FADE))
        for block in SHORT.blocks
    ))  # fmt: skip
    session = Session(protocol, weight=12.0)
    simulation = Simulation(session, HEALTHY, 3)
    samples, by_hand = [], []
    if by_hand_after:
        samples = simulation.run(by_hand_after / 200)
        session.carried.set_by_hand(9.0)
        by_hand.append((samples[-1].sequence, 9.0))
    samples += simulation.run()
    assert session.state == State.FINISHED
    acts = [Act(0, State.RUNNING, ""), Act(samples[-1].sequence, State.FINISHED, "")]
    return protocol, samples, acts, session, by_hand


@pytest.mark.parametrize("by_hand_after", [None, 2000])
def test_a_fade_is_computed_again_bit_for_bit(by_hand_after):
    protocol, samples, acts, session, by_hand = fading(by_hand_after)
    told = []
    again = Session(protocol, weight=12.0)
    for sample in samples:
        if by_hand and sample.sequence == by_hand[0][0] + 1:
            again.carried.set_by_hand(9.0)
        outcome = again.take(sample)
        if outcome.change is not None:
            told.append(outcome.change.row(outcome.result["block"]))
    assert told and again.changes == session.changes
    found = replay(protocol, samples, acts, session.results, told, 12.0, by_hand)
    assert found.problems == []
    other = replay(protocol, samples, acts, session.results, told, 13.0, by_hand)
    assert any("support" in problem for problem in other.problems)
    reasons = [row["reason"] for row in told]
    assert ("support by hand from now on" in reasons) is bool(by_hand)
    assert reasons[0].startswith("support 100% to 75% of the weight, as 4 of 4 were reached")


def test_csv_keeps_every_bit(recorded):
    results = recorded[2]
    header, *lines = csv_text(COLUMNS, results).splitlines()
    assert header.split(",") == list(COLUMNS)
    assert len(lines) == len(results)
    at = COLUMNS.index("path_error")
    assert [float(line.split(",")[at]) for line in lines] == [row["path_error"] for row in results]
    assert lines[0].split(",")[COLUMNS.index("independence")] == "", "no circle, no number"


def at(*numbers):
    return [HandSample(number % 2**32, 0, *[0.0] * 9) for number in numbers]


@pytest.mark.parametrize("step", [1, 5, 10])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.1, 0.3])
def test_each_sample_that_is_missing_is_counted(step, share):
    """In older bags the numbers are those of the encoder's ticks, of which some were shown."""
    chance = random.Random(f"{step} {share}")
    samples = at(*range(2**32 - 1_000, 2**32 + 5_000, step))
    kept = samples[:2] + [s for s in samples[2:-1] if chance.random() >= share] + samples[-1:]
    assert sum(gap.missing for gap in gaps_of(kept)) == len(samples) - len(kept)


def test_every_second_one_is_missing():
    """From the first sample to the last without exception that is no gap but another step.

    `session verify` knows the due one and finds it.
    """
    assert gaps_of(at(*range(0, 100, 2))) == ()
    assert sum(gap.missing for gap in gaps_of(at(*range(0, 100, 2), 99))) == 49


def test_a_repeated_or_older_number_is_no_gap():
    assert gaps_of([]) == gaps_of(at(7)) == gaps_of(at(7, 7, 7)) == ()
    assert gaps_of(at(7, 8, 8, 9, 5, 6)) == ()


def test_gaps_say_after_which_sample_and_how_many():
    assert gaps_of(at(0, 5, 20, 25, 30)) == ((5, 2),)
    assert gaps_of(at(2**32 - 10, 2**32 - 5, 2**32, 2**32 + 5, 2**32 + 15)) == ((5, 1),)
