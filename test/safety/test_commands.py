# SPDX-License-Identifier: Apache-2.0
"""Only new, finite and possible commands are acted upon."""

from __future__ import annotations

import math

import pytest

from screw_module_ros.safety.checks import Stream, command_flaw
from screw_module_ros.safety.latch import Latch

PERIOD_NS = 1_000_000


class Commands:
    """A stream of commands and its latch."""

    def __init__(self):
        self.fault = Latch()
        self.stream = Stream("force command", PERIOD_NS, self.fault)

    def send(self, tick, stamp_ns=None, now_ns=None, number=None):
        stamp_ns = tick * PERIOD_NS if stamp_ns is None else stamp_ns
        now_ns = tick * PERIOD_NS + 200_000 if now_ns is None else now_ns
        return self.stream.accept(tick if number is None else number, stamp_ns, now_ns)


@pytest.fixture
def commands():
    return Commands()


def test_new_commands_pass_and_give_their_stamp(commands):
    assert commands.stream.monotonic_ns == 0
    assert commands.send(5)
    assert commands.send(6)
    assert commands.stream.monotonic_ns == 6 * PERIOD_NS
    assert commands.fault.reason == ""


@pytest.mark.parametrize("force", [math.nan, math.inf, -math.inf, 151.0, -1e300])
def test_an_impossible_force_is_refused(force):
    assert "beyond anything" in command_flaw(force)


@pytest.mark.parametrize("force", [0.0, 150.0, -150.0])
def test_a_possible_force_is_none(force):
    assert command_flaw(force) == ""


def test_older_and_repeated_commands_are_refused(commands):
    commands.send(5)
    assert not commands.send(5)
    assert not commands.send(4)


def test_two_controllers_at_once_are_noticed(commands):
    for tick in range(5, 40):
        commands.send(tick)
        commands.send(tick)
    assert "second node" in commands.fault.reason


def test_a_number_from_the_future_blocks_nobody(commands):
    """A foreign sender's tick numbers are not believed: the true commands are heard on."""
    assert commands.send(100)
    assert not commands.send(101, number=1_000_100)
    assert "second node" in commands.fault.reason
    assert all(commands.send(tick) for tick in range(102, 110))


@pytest.mark.parametrize("rate", [1, 2, 3, 4, 5, 10])
@pytest.mark.parametrize("numbered", ["by the clock", "one by one"])
def test_a_second_sender_is_noticed_at_any_rate(commands, rate, numbered):
    """It sends `rate` samples a period, each newer than the true one before it."""
    number = 0
    for tick in range(1, 20_000):
        number = max(number, tick)
        commands.send(tick)
        for k in range(rate):
            now_ns = tick * PERIOD_NS + 250_000 + k * 70_000
            number += numbered == "one by one"
            commands.stream.accept(number, now_ns, now_ns)
        if commands.fault.reason:
            break
    assert "second node" in commands.fault.reason
    assert tick < 20


def test_one_late_or_stuttering_sender_is_no_second_one(commands):
    """Jitter of half a period, a burst after a pause, a repetition now and then."""
    now_ns = 0
    for tick in range(1, 20_000):
        late_ns = PERIOD_NS // 2 * (tick % 2)
        if tick % 1000 < 5:
            late_ns = (6 - tick % 1000) * PERIOD_NS  # the queue of a node that was kept waiting
        now_ns = max(now_ns, tick * PERIOD_NS + late_ns)
        assert commands.send(tick, now_ns=now_ns)
        if tick % 50 == 0:
            commands.send(tick, now_ns=now_ns)
    assert commands.fault.reason == ""


def test_commands_at_another_rate_than_ours_are_told(commands):
    for half in range(20, 40):
        stamp_ns = half * PERIOD_NS // 2
        commands.stream.accept(half, stamp_ns, stamp_ns)
    reason = commands.fault.reason
    assert "ticks at 2000 Hz by the numbers of its samples, this node at 1000 Hz" in reason
