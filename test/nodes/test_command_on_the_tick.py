# SPDX-License-Identifier: Apache-2.0
"""A command that comes with the next tick is judged by what the drive answers on that tick."""

from __future__ import annotations

from typing import NamedTuple

import pytest

from screw_module_ros.clock import ManualClock

MS = 1_000_000


class Command(NamedTuple):
    sequence: int
    monotonic_ns: int
    force: float


class Inbox:
    """A command that is there when the wait ends."""

    def __init__(self, clock: ManualClock, comes_ns: int):
        self._clock, self._comes_ns = clock, comes_ns

    def wait(self, until_ns: int) -> None:
        self._clock.sleep_until(min(until_ns, self._comes_ns))


@pytest.mark.parametrize(("comes_ns", "taken"), [(9_300_000, True), (10 * MS, False)])
def test_a_command_of_the_next_tick_waits_for_its_sync(make_node, comes_ns, taken):
    node = make_node("amplifier")
    node.clock = ManualClock(9 * MS)
    node._commands = Inbox(node.clock, comes_ns)
    node._take_command = lambda early: Command(9, 9 * MS, 1.0) if early else None
    found = node.take_command(10 * MS)
    assert (found is not None) == taken
