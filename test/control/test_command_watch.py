# SPDX-License-Identifier: Apache-2.0
"""Only new, finite and possible commands are acted upon."""

import math

import pytest

from screw_module_ros.control.command_watch import CommandWatch

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
