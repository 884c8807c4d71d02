# SPDX-License-Identifier: Apache-2.0
"""A tick of a drive node on a bus that fails: gate and writes get their turn all the same."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from screw_module_ros.devices.errors import BusError
from screw_module_ros.nodes.support.realtime import Tick


def fails(*_):
    raise BusError("the cable is out")


@pytest.mark.parametrize("failing", ["request", "pump"])
def test_an_error_before_the_writes_does_not_skip_them(make_node, failing):
    node = make_node("manus")
    idle = []
    node.next_tick = lambda: Tick(1, 5_000, 6_000, 0)
    node.ticker = SimpleNamespace(due_ns=lambda: 2**62)
    node.port = SimpleNamespace(pump=fails)
    node._look_around = lambda now: None
    node._own = SimpleNamespace(state_every=100)
    node._ticks = 0
    node._axes = SimpleNamespace(
        request=fails if failing == "request" else lambda now: None,
        answered=lambda since: False,
        idle=idle.append,
    )
    node.step()
    assert idle == [5_000]
    node.port = node._axes = None


def test_the_vertical_drive_is_no_other(make_node):
    node = make_node("amplifier")
    idle = []
    node.period_ns, node._pumped_ns, node._look_every, node._state_due_ns = 1, 0, 100, 2**62
    node.port = SimpleNamespace(pump=fails)
    node._axis = SimpleNamespace(idle=idle.append)
    node.end_tick(Tick(1, 5_000, 6_000, 0))
    assert idle == [5_000]
    node.port = None
