# SPDX-License-Identifier: Apache-2.0
"""A permission that came before the node was active permits nothing."""

from __future__ import annotations

from collections import deque
from types import SimpleNamespace

from screw_module_msgs.msg import SafetyState

from screw_module_ros.clock import ManualClock
from screw_module_ros.nodes.support.permission import Permission
from screw_module_ros.nodes.support.timers import Timers


class Gate:
    """Notes what it is told."""

    def __init__(self):
        self.told = []

    def permit(self, permitted, reason, now_ns):
        self.told.append(permitted)


def test_what_came_before_the_start_permits_nothing():
    """The supervisor died while the node was inactive; its last messages still lie there."""
    queue = deque(SafetyState(planar_permitted=True) for _ in range(10))
    inbox = SimpleNamespace(subscribe=lambda *_: lambda: queue.popleft() if queue else None)
    node = SimpleNamespace(periodic=Timers(), clock=ManualClock())
    permission = Permission(node, inbox, lambda state: state.planar_permitted)
    gate = Gate()
    permission.begin()
    permission.pass_on(gate, 1)
    assert gate.told == []
    queue.append(SafetyState(planar_permitted=True))
    permission.pass_on(gate, 2)
    assert gate.told == [True]
