# SPDX-License-Identifier: Apache-2.0
"""What the amplifier tells a node whose service needs the drive's torque off."""

from __future__ import annotations

from types import SimpleNamespace

from screw_module_msgs.msg import AmplifierState

from screw_module_ros.clock import ManualClock


class PatientClock(ManualClock):
    """Time goes on while somebody waits."""

    def wait_for(self, ready, timeout_s: float) -> bool:
        return any(ready() for _ in range(10))


def inbox_with(*states: AmplifierState | None) -> SimpleNamespace:
    """Return an inbox that gives these states, one for each look, and then none."""
    told = iter(states)
    return SimpleNamespace(subscribe=lambda *_: lambda: next(told, None))


def each_state_again(states: dict) -> SimpleNamespace:
    """Return an inbox that gives the state of each topic at every look."""
    return SimpleNamespace(subscribe=lambda kind, topic, *_: lambda: states[topic])


def served_at_once():
    """Return a part of a loop that carries out each request as soon as it is asked for."""
    return SimpleNamespace(requests=SimpleNamespace(ask=lambda act, clock: act()))
