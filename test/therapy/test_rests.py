# SPDX-License-Identifier: Apache-2.0
"""Rests of a session: after so many trials, by time of the samples, computed again from the bag."""

from __future__ import annotations

import math

import pytest
from simulated_patient import HEALTHY, Simulation

from screw_module_ros.settings import SettingError
from screw_module_ros.therapy.adaptation import Assistance
from screw_module_ros.therapy.protocol import Rest
from screw_module_ros.therapy.protocol_file import as_yaml, load_protocol, parse_protocol
from screw_module_ros.therapy.recorded import Act
from screw_module_ros.therapy.replay import replay
from screw_module_ros.therapy.session import RESTS, Session, State

CLOCK = load_protocol("clock_adaptive")
BLOCK = CLOCK.blocks[0]._replace(
    circuits=1, targets=CLOCK.blocks[0].targets._replace(count=2), rest=Rest(3, 10.0)
)
RESTING = CLOCK._replace(blocks=(BLOCK, BLOCK))


def played():
    """Play all; return the session, its samples and the trials after which it rested."""
    session = Session(RESTING)
    simulation = Simulation(session, HEALTHY, 1)
    samples, rested = [], {}
    while session.state in (State.RUNNING, State.PAUSED):
        simulation.step()
        simulation.step()
        samples.append(simulation.sample())
        session.take(samples[-1])
        simulation.look()
        if session.state == State.PAUSED:
            rested.setdefault(len(session.results), []).append(session.rest_left)
    return session, samples, rested


def test_a_session_rests_within_its_blocks_and_goes_on_by_itself():
    session, samples, rested = played()
    assert session.state == State.FINISHED and len(session.results) == 8
    assert list(rested) == [3, 7], "counted by block, and never after the last trial"
    for left in rested.values():
        assert left[0] == 10.0 and 0.0 < left[-1] < 0.02
        assert left == sorted(left, reverse=True)
    assert math.isnan(session.rest_left)
    again = replay(RESTING, samples, [Act(samples[0].sequence - 1, State.RUNNING, "")],
                   session.results)  # fmt: skip
    assert again.problems == []


def test_what_a_session_began_with_is_computed_again():
    """Its walls are those of last time, and what it learns goes on from there."""
    last = Assistance(1.1, 150.0)
    block = CLOCK.blocks[1]._replace(circuits=2, targets=BLOCK.targets)
    protocol = CLOCK._replace(blocks=(block,))
    session = Session(protocol, assistance=last)
    assert session.assistance == last != Session(protocol).assistance
    samples = Simulation(session, HEALTHY, 1).run()
    assert session.changes[0].before == last
    begins = [Act(samples[0].sequence - 1, State.RUNNING, "")]
    rows = [change.row(1) for change in session.changes]
    again = replay(protocol, samples, begins, session.results, rows, assistance=last)
    assert again.problems == []
    assert replay(protocol, samples, begins, session.results, rows).problems


def test_a_rest_holds_what_was_held_and_a_pause_in_it_does_not():
    session = Session(CLOCK)
    simulation = Simulation(session, HEALTHY, 1)
    sample = simulation.sample()._replace(x=0.0, y=0.0)
    for number in range(200):
        session.take(sample._replace(time_ns=sample.time_ns + number * 5_000_000))
    hold = session.wish.hold
    assert hold is not None and session.rest(60.0)
    assert session.wish.hold == hold and session.wish.plane is None
    assert not session.rest(60.0) and not session.pause(RESTS), "it rests already"
    assert session.pause("the arm pulls hard") and session.wish.hold is None
    assert math.isnan(session.rest_left)


def test_torque_off_in_a_rest_makes_it_a_pause():
    session = Session(CLOCK)
    sample = Simulation(session, HEALTHY, 1).sample()
    session.take(sample)
    session.rest(10.0)
    session.take(sample._replace(stop="the plane's torque is off"))
    session.take(sample._replace(time_ns=sample.time_ns + 11_000_000_000))
    assert (session.state, session.reason) == (State.PAUSED, "the plane's torque is off")


def test_rests_are_a_key_of_a_block():
    assert parse_protocol(as_yaml(RESTING), "test") == RESTING
    text = as_yaml(RESTING).replace("every: 3", "every: 0", 1)
    with pytest.raises(SettingError, match="every"):
        parse_protocol(text, "test")
