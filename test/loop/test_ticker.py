# SPDX-License-Identifier: Apache-2.0
"""The first tick of a loop comes after the loop has begun; what a tick waits for."""

from __future__ import annotations

from types import SimpleNamespace

from screw_module_ros.clock import ManualClock
from screw_module_ros.loop.ticker import Ticker
from screw_module_ros.loop.vertical import Parts, VerticalLoop, Wires


def test_what_passed_between_making_and_running_is_no_overrun():
    clock = ManualClock(1_000_000)
    ticker = Ticker(clock, 1_000_000)
    clock.time_ns = 7_400_000
    first = ticker.sleep()
    assert (first.sequence, first.monotonic_ns, first.skipped) == (8, 8_000_000, 0)


def test_an_overrun_skips_ticks_and_counts_them():
    clock = ManualClock()
    ticker = Ticker(clock, 1_000_000)
    ticker.sleep()
    clock.time_ns += 3_100_000
    assert ticker.sleep().skipped == 2


def test_an_encoder_alone_waits_for_no_commands():
    """Its process has no drive: commands are another one's."""
    asked: list[int] = []
    encoder = SimpleNamespace(
        begin=lambda tick: None, answer=lambda until_ns: None, end=lambda: None
    )
    loop = VerticalLoop(ManualClock(5_000_000), 1_000_000, Wires(take_command=asked.append))
    loop.step(Parts(encoder=encoder))
    assert asked == []
