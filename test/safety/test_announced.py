# SPDX-License-Identifier: Apache-2.0
"""Each stop is told once, in one line, when its reasons have come, and its end is told."""

from __future__ import annotations

import pytest

from screw_module_ros.safety.announced import Announced, announce
from screw_module_ros.safety.supervision import NOT_SEEN, OK, STOPPED, WAITING, Decision

EVERY_NS = 100_000_000
LOST = "encoder: no message for more than 0.2 s"
NO_SAMPLE = "impedance_controller: encoder: no sample for 5.0 ms"
DISABLED = "amplifier: disabled: no command"
THEN = "; when the cause is gone: ~/reset, then enable the drives"


def decision(level, *reasons):
    return Decision(level, level == OK, level == OK, level == OK, reasons)


def told(*stages, latched=False):
    """Return the lines with the time of each [s]; a stage: seconds, level, reasons."""
    state, lines, tick = Announced(), [], 0
    for seconds, level, *reasons in stages:
        for _ in range(round(seconds * 1e9 / EVERY_NS)):
            tick += 1
            state, line = announce(state, decision(level, *reasons), latched, tick * EVERY_NS)
            if line:
                lines.append((round(tick * EVERY_NS * 1e-9, 1), line))
    return lines


def test_a_start_tells_the_permission_alone():
    """What a node that is not there yet waits for is in its own log."""
    assert told(
        (5.0, WAITING, f"encoder: {NOT_SEEN}", f"manus: {NOT_SEEN}"),
        (5.0, WAITING, f"manus: {NOT_SEEN}"),
        (9.0, OK),
    ) == [(10.6, "motion permitted")]


def test_the_reasons_of_one_cause_are_one_line():
    """As after kill -9 of `encoder`: the controller first, the lost node 0.2 s later."""
    stop = (
        (0.2, STOPPED, NO_SAMPLE),
        (0.1, STOPPED, NO_SAMPLE, DISABLED),
        (60.0, STOPPED, NO_SAMPLE, DISABLED, LOST),
    )
    lines = told((3.0, OK), *stop, latched=True)
    assert [line for _, line in lines] == [
        "motion permitted",
        f"stopped: {NO_SAMPLE}; {DISABLED}; {LOST}{THEN}",
    ]


def test_a_stop_that_goes_on_changing_is_told_within_a_second():
    changing = [(0.2, STOPPED, f"reason {n}") for n in range(20)]
    lines = told((3.0, OK), *changing)
    assert lines[1][0] <= 3.0 + 1.1
    assert len(lines) <= 2 + 4, "and then once a second"


def test_a_reason_that_comes_back_is_not_told_again_but_a_new_one_is():
    lines = told(
        (3.0, OK), (5.0, STOPPED, LOST, NO_SAMPLE), (5.0, STOPPED, LOST),
        (5.0, STOPPED, LOST, NO_SAMPLE), (5.0, STOPPED, LOST, DISABLED),
    )  # fmt: skip
    assert [line for _, line in lines][1:] == [
        f"stopped: {LOST}; {NO_SAMPLE}", f"stopped: {LOST}; {DISABLED}",
    ]  # fmt: skip


def test_the_end_of_a_stop_is_told_and_the_next_one_again():
    lines = told((3.0, OK), (5.0, STOPPED, LOST), (5.0, OK), (5.0, STOPPED, LOST))
    assert [line for _, line in lines][1:] == [
        f"stopped: {LOST}", "motion permitted again", f"stopped: {LOST}",
    ]  # fmt: skip


def test_what_came_and_went_is_not_told():
    lines = told((3.0, OK), (0.4, STOPPED, LOST), (1.5, WAITING, LOST), (9.0, OK))
    assert [line for _, line in lines] == ["motion permitted"]


def test_a_stop_after_a_wait_that_was_not_told_yet_waits_for_its_own_reasons():
    lines = told((3.0, OK), (1.5, WAITING, LOST), (0.3, STOPPED, NO_SAMPLE),
                 (5.0, STOPPED, NO_SAMPLE, LOST))  # fmt: skip
    assert [line for _, line in lines][1:] == [f"stopped: {NO_SAMPLE}; {LOST}"]


@pytest.mark.parametrize(
    ("reason", "line"),
    [(LOST, f"motion not permitted: {LOST}"),
     (f"encoder: {NOT_SEEN}", "motion not permitted: nodes that were not seen yet")],
)  # fmt: skip
def test_a_node_that_is_lost_while_nothing_is_enabled_is_told(reason, line):
    assert told((3.0, OK), (9.0, WAITING, reason))[1:] == [(5.1, line)]
