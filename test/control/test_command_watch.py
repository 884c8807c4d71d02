# SPDX-License-Identifier: Apache-2.0
"""Only new, finite and possible commands are acted upon."""

import math

import pytest

from screw_module_ros.control.watch import CommandWatch

PERIOD_NS = 1_000_000


@pytest.fixture
def watch():
    return CommandWatch(PERIOD_NS, largest_force=150.0)


def send(watch, tick, force=10.0, stamp_ns=None):
    stamp_ns = tick * PERIOD_NS if stamp_ns is None else stamp_ns
    return watch.accept(tick, stamp_ns, force, tick * PERIOD_NS + 200_000)


def test_new_commands_pass_and_give_their_stamp(watch):
    assert watch.newest_ns == 0
    assert send(watch, 5)
    assert send(watch, 6)
    assert watch.newest_ns == 6 * PERIOD_NS
    assert watch.fault == ""


@pytest.mark.parametrize("force", [math.nan, math.inf, -math.inf, 151.0, -1e300])
def test_an_impossible_force_is_refused_and_latched(watch, force):
    assert not send(watch, 5, force)
    assert "beyond anything" in watch.fault
    assert send(watch, 6), "the latch is the caller's to obey"
    assert "beyond anything" in watch.fault
    watch.reset()
    assert watch.fault == ""


def test_older_and_repeated_commands_are_refused(watch):
    send(watch, 5)
    assert not send(watch, 5)
    assert not send(watch, 4)


def test_two_controllers_at_once_are_noticed(watch):
    for tick in range(5, 15):
        send(watch, tick, 10.0)
        send(watch, tick, -10.0)
    assert "second node" in watch.fault


def test_a_stamp_from_the_future_does_not_look_fresh_for_ever(watch):
    assert not send(watch, 5, stamp_ns=2**62)
    assert watch.newest_ns == 0
    assert "future" in watch.fault


def test_a_number_from_the_future_blocks_nobody_for_ever(watch):
    """A foreign sender's tick numbers go with the fault: the true commands are heard again."""
    assert send(watch, 100)
    assert watch.accept(1_000_100, 101 * PERIOD_NS, 10.0, 101 * PERIOD_NS)
    assert not any(send(watch, tick) for tick in range(102, 110))
    assert "second node" in watch.fault
    watch.reset()
    assert all(send(watch, tick) for tick in range(110, 120))
    assert not watch.fault


@pytest.mark.parametrize("rate", [1, 2, 3, 4, 5, 10])
@pytest.mark.parametrize("numbered", ["by the clock", "one by one"])
def test_a_second_sender_is_noticed_at_any_rate(watch, rate, numbered):
    """It sends `rate` samples a period, each newer than the true one before it."""
    number = 0
    for tick in range(1, 20_000):
        number = max(number, tick)
        send(watch, tick)
        for k in range(rate):
            now_ns = tick * PERIOD_NS + 250_000 + k * 70_000
            number += numbered == "one by one"
            watch.accept(number, now_ns, 30.0, now_ns)
        if watch.fault:
            break
    assert "second node" in watch.fault
    assert tick < 20


def test_one_late_or_stuttering_sender_is_no_second_one(watch):
    """Jitter of half a period, a burst after a pause, a repetition now and then."""
    now_ns = 0
    for tick in range(1, 20_000):
        late_ns = PERIOD_NS // 2 * (tick % 2)
        if tick % 1000 < 5:
            late_ns = (6 - tick % 1000) * PERIOD_NS  # the queue of a node that was kept waiting
        now_ns = max(now_ns, tick * PERIOD_NS + late_ns)
        assert watch.accept(tick, tick * PERIOD_NS, 1.0, now_ns)
        if tick % 50 == 0:
            watch.accept(tick, tick * PERIOD_NS, 0.0, now_ns)
    assert watch.fault == ""


def test_commands_at_another_rate_than_ours_are_told(watch):
    for half in range(2, 200):
        stamp_ns = half * PERIOD_NS // 2
        watch.accept(half, stamp_ns, 1.0, stamp_ns)
    assert "another rate" in watch.fault
