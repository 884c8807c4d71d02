# SPDX-License-Identifier: Apache-2.0
"""The first tick of a loop comes after the loop has begun; what a tick waits for."""

from __future__ import annotations

from types import SimpleNamespace

from screw_module_ros.clock import ManualClock
from screw_module_ros.loop.vertical import Parts, VerticalLoop, Wires


def test_an_encoder_alone_waits_for_no_commands():
    """Its process has no drive: commands are another one's."""
    asked: list[int] = []
    encoder = SimpleNamespace(
        begin=lambda tick: None, answer=lambda until_ns: None, end=lambda: None
    )
    loop = VerticalLoop(ManualClock(5_000_000), 1_000_000, Wires(take_command=asked.append))
    loop.step(Parts(encoder=encoder))
    assert asked == []
