# SPDX-License-Identifier: Apache-2.0
"""Late, lost and new answers told apart."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.devices.polled import FRESH, LATE, UNEXPECTED, RequestTracker

# Each step with what comes of it; a number is an answer, of that part.
SEQUENCES = {
    "each answer in its tick is fresh": (1, [("ask", True), (0, FRESH)] * 5),
    "nobody asked": (1, [(0, UNEXPECTED)]),
    "a burst after a stall ends fresh": (
        1, [("ask", True)] * 4 + [(0, LATE)] * 3 + [(0, FRESH), (0, UNEXPECTED)],
    ),
    "silence settles a lost answer": (
        1, [("ask", True), ("ask", True), (0, LATE), ("ask", False), ("ask", True), (0, FRESH)],
    ),
    "listening goes on while old answers come in": (
        1, [("ask", True)] * 3 + [(0, LATE), ("ask", False)] * 2
        + [(0, LATE), ("ask", True), (0, FRESH)],
    ),
    "a second part without its first pays for both": (
        2, [("ask", True), (1, FRESH), (0, UNEXPECTED), ("ask", True)],
    ),
    "an older second part after a newer first is late": (
        2, [("ask", True)] * 2 + [(0, LATE), (0, FRESH), (1, LATE), (1, FRESH)],
    ),
    "between ticks nothing is fresh": (
        1, [("ask", True), ("end", None), (0, LATE), (0, UNEXPECTED), ("ask", True), (0, FRESH)],
    ),
}  # fmt: skip


@pytest.mark.parametrize(("parts", "steps"), SEQUENCES.values(), ids=SEQUENCES)
def test_sequence(parts, steps):
    tracker = RequestTracker(parts)
    does = {"ask": tracker.ask, "end": tracker.end_tick}
    found = [does[step]() if step in does else tracker.answer(step) for step, _ in steps]
    assert found == [outcome for _, outcome in steps]


@given(st.integers(0, 10), st.lists(st.integers(1, 3), max_size=60))
def test_a_delayed_answer_is_never_fresh(stall, deliveries):
    """Nothing is lost, but the device begins with a stall and catches up at any pace, or never."""
    tracker = RequestTracker()
    under_way: list[int] = []
    for tick, deliver in enumerate([0] * stall + deliveries):
        if tracker.ask():
            under_way.append(tick)
        for _ in range(min(deliver, len(under_way))):
            request = under_way.pop(0)
            assert (tracker.answer() == FRESH) <= (request == tick)


@given(st.lists(st.booleans(), max_size=60))
def test_lost_answers_cost_few_samples_and_never_a_wrong_one(losses):
    tracker = RequestTracker()
    since_loss = 4
    for lost in losses + [False] * 6:
        asked = tracker.ask()
        since_loss = 0 if asked and lost else since_loss + 1
        if asked and not lost:
            verdict = tracker.answer()
            assert verdict in (FRESH, LATE)
            assert verdict == FRESH or since_loss < 3
