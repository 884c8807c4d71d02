# SPDX-License-Identifier: Apache-2.0
"""A system clock that is set while a session runs ends no trial early or late."""

from __future__ import annotations

import random

import pytest
from session_bag import played, short_text, write_bag
from simulated_patient import HEALTHY, Simulation

from screw_module_ros.therapy.clock_watch import ClockWatch
from screw_module_ros.therapy.hand import HandSample
from screw_module_ros.therapy.protocol_file import parse_protocol
from screw_module_ros.therapy.recorded import read_sessions
from screw_module_ros.therapy.replay import replayed
from screw_module_ros.therapy.report_figures import outward_paths
from screw_module_ros.therapy.session import Session, State
from screw_module_ros.therapy.trial import Phase

DEFINITION = short_text()
PROTOCOL = parse_protocol(DEFINITION, "test")


def sample(tick: int, seconds: float) -> HandSample:
    return HandSample(tick % 2**32, round(seconds * 1e9), *[0.0] * 9)


def jumps(stamped: list[tuple[int, float]]) -> list[float]:
    watch = ClockWatch()
    return [jump for each in stamped if (jump := watch.jump(sample(*each)))]


@pytest.mark.parametrize("seconds", [3600.0, 0.13, -3.0])
def test_a_clock_that_is_set_in_a_movement_pauses_and_the_movement_is_done_again(seconds):
    session = Session(PROTOCOL)
    simulation = Simulation(session, HEALTHY, 1)
    while session.trial.phase != Phase.MOVING or session.trial.plan.number < 2:
        simulation.run(0.005)
    interrupted, done = session.trial, len(session.results)
    simulation.clock_set_ns = round(seconds * 1e9)
    simulation.run(1.0)
    assert (session.state, len(session.results)) == (State.PAUSED, done)
    assert session.reason == (
        f"the computer's clock was set by {seconds:+.1f} s: Resume repeats the movement"
    )
    session.resume()
    assert session.trial.plan == interrupted.plan and session.trial is not interrupted
    simulation.run()
    assert session.state == State.FINISHED
    assert [result["trial"] for result in session.results] == list(range(1, 9))
    assert all(0.2 < result["duration"] < 2.0 for result in session.results)


def test_a_clock_that_is_set_in_a_pause_is_nobodys_business():
    session = Session(PROTOCOL)
    simulation = Simulation(session, HEALTHY, 1)
    simulation.run(2.0)
    session.pause("the therapist paused it")
    simulation.clock_set_ns = -5_000_000_000
    session.resume()
    simulation.run(1.0)
    assert session.state == State.RUNNING


@pytest.mark.parametrize("seconds", [-3600.0, 2.0])
def test_the_recording_replays_bit_for_bit_though_the_clock_was_set(seconds, tmp_path):
    """A bag is in the order of the system clock: the samples after come before the others."""
    told = played(HEALTHY, 1, DEFINITION, begin_s=50_000, clock_set=(900, seconds))
    (recorded,) = read_sessions(write_bag(tmp_path / "set", [told]))
    assert replayed(recorded).problems == []
    assert recorded.samples == told.samples
    assert [row["trial"] for row in recorded.trials] == list(range(1, 9))
    assert [act.state for act in recorded.acts] == [
        State.RUNNING, State.PAUSED, State.RUNNING, State.FINISHED
    ]  # fmt: skip
    assert [len(path.points) < 600 for path in outward_paths(recorded)] == [True] * 4


def test_nothing_else_is_taken_for_a_clock_that_was_set():
    """Stamps that come late, lost and repeated samples, another count, numbers that wrap."""
    chance = random.Random("stamps")
    first = 2**32 - 3_000
    late = [(first + 5 * n, 0.005 * n + chance.choice((0.0, 0.0, 0.04))) for n in range(2_000)]
    assert jumps(late) == []
    assert jumps([each for each in late if chance.random() < 0.2]) == []
    assert jumps([each for each in late for _ in range(2)]) == []
    silent = late[:100] + late[160:]  # 0.3 s
    assert jumps(silent) == []
    absent = [(0, seconds) for _, seconds in late[300:330]]
    assert jumps(late[:300] + absent + late[330:]) == []
    counted_anew = [(tick // 2, seconds) for tick, seconds in late[300:]]
    assert jumps(late[:300] + counted_anew) == []


@pytest.mark.parametrize("rate", [125, 250, 1000, 2000])
def test_the_period_comes_from_the_samples(rate):
    stamped = [(int(n * rate / 200), n / 200) for n in range(400)]
    assert jumps(stamped) == []
    after = [(tick, seconds + 0.2) for tick, seconds in stamped[200:]]
    (jump,) = jumps(stamped[:200] + after)
    assert jump == pytest.approx(0.2, abs=0.02)
