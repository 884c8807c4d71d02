# SPDX-License-Identifier: Apache-2.0
"""A system clock that is set while a session runs changes nothing but the stamps."""

from __future__ import annotations

import pytest
from session_bag import played, short_text, write_bag
from simulated_patient import HEALTHY, Simulation

from screw_module_ros.therapy.protocol_file import parse_protocol
from screw_module_ros.therapy.recorded import read_sessions
from screw_module_ros.therapy.replay import replayed
from screw_module_ros.therapy.session import Session, State

DEFINITION = short_text()
PROTOCOL = parse_protocol(DEFINITION, "test")
STAMPS = {"started_ns", "ended_ns"}


def finished(set_by: float) -> list[dict]:
    """Return the results of a session in whose second trial the clock is set [s]."""
    session = Session(PROTOCOL)
    simulation = Simulation(session, HEALTHY, 1)
    while len(session.results) < 1:
        simulation.run(0.005)
    simulation.clock_set_ns = round(set_by * 1e9)
    simulation.run()
    assert session.state == State.FINISHED
    return session.results


@pytest.mark.parametrize("seconds", [3600.0, 0.13, -3.0])
def test_no_trial_ends_early_or_late_and_no_figure_changes(seconds):
    without = finished(0.0)
    for before, after in zip(without, finished(seconds), strict=True):
        shown = {name for name in before if repr(before[name]) != repr(after[name])}
        assert shown == (STAMPS if before["trial"] > 1 else set())
        if shown:
            assert after["started_ns"] - before["started_ns"] == round(seconds * 1e9)


@pytest.mark.parametrize("seconds", [-3600.0, 2.0])
def test_the_recording_replays_bit_for_bit_though_the_clock_was_set(seconds, tmp_path):
    """A bag is in the order of the system clock: the samples after come before the others."""
    told = played(HEALTHY, 1, DEFINITION, begin_s=50_000, clock_set=(900, seconds))
    (recorded,) = read_sessions(write_bag(tmp_path / "set", [told]))
    assert replayed(recorded).problems == []
    assert recorded.samples == told.samples
    assert [row["trial"] for row in recorded.trials] == list(range(1, 9))
    assert [act.state for act in recorded.acts] == [State.RUNNING, State.FINISHED]
