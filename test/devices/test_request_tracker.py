# SPDX-License-Identifier: Apache-2.0
"""Late, lost and new answers told apart."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.devices.polled import FRESH, LATE, UNEXPECTED, RequestTracker


def test_each_answer_in_its_tick_is_fresh():
    tracker = RequestTracker()
    assert [(tracker.ask(), tracker.answer()) for _ in range(5)] == [(True, FRESH)] * 5


def test_nobody_asked():
    assert RequestTracker().answer() == UNEXPECTED


def test_burst_after_a_stall_ends_fresh():
    tracker = RequestTracker()
    for _ in range(4):
        assert tracker.ask()
    assert [tracker.answer() for _ in range(5)] == [LATE, LATE, LATE, FRESH, UNEXPECTED]


def test_silence_settles_a_lost_answer():
    tracker = RequestTracker()
    tracker.ask()
    tracker.ask()
    assert tracker.answer() == LATE
    assert not tracker.ask()
    assert tracker.ask()
    assert tracker.answer() == FRESH


def test_listening_goes_on_while_old_answers_come_in():
    tracker = RequestTracker()
    for _ in range(3):
        tracker.ask()
    assert tracker.answer() == LATE
    assert not tracker.ask()
    assert tracker.answer() == LATE
    assert not tracker.ask()
    assert tracker.answer() == LATE
    assert tracker.ask()
    assert tracker.answer() == FRESH


def test_second_part_without_its_first_pays_for_both():
    tracker = RequestTracker(parts=2)
    tracker.ask()
    assert tracker.answer(1) == FRESH
    assert tracker.answer(0) == UNEXPECTED
    assert tracker.ask()


def test_older_second_part_after_a_newer_first_is_late():
    tracker = RequestTracker(parts=2)
    tracker.ask()
    tracker.ask()
    assert [tracker.answer(part) for part in (0, 0, 1, 1)] == [LATE, FRESH, LATE, FRESH]


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


def test_between_ticks_nothing_is_fresh():
    tracker = RequestTracker()
    assert tracker.ask()
    tracker.end_tick()
    assert tracker.answer() == LATE
    assert tracker.answer() == UNEXPECTED
    assert tracker.ask()
    assert tracker.answer() == FRESH
