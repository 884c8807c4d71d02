# SPDX-License-Identifier: Apache-2.0
"""By wall clock a message is as old as it is, however late somebody takes it; no graph."""

from __future__ import annotations

from types import SimpleNamespace

from screw_module_msgs.msg import SafetyState

from screw_module_ros import graph
from screw_module_ros.clock import ManualClock
from screw_module_ros.loop.requests import Requests
from screw_module_ros.nodes.support.drives import VERTICAL, Permission
from screw_module_ros.nodes.support.inbox import Subscription
from screw_module_ros.nodes.support.topics import COMMAND, Newest
from screw_module_ros.safety.permit import Permit, PermitSettings

MS = 1_000_000
S = 1000 * MS
OFF_NS = 1_700_000_000 * S  # of the system clock, against the monotonic one


class Clock(ManualClock):
    simulated = False

    def stamp_ns(self) -> int:
        return self.time_ns + OFF_NS


def received(clock: Clock, *arrivals_ns: int):
    """Return a subscription in whose queue messages wait that came at these times."""
    waiting = [
        (SafetyState(motion_permitted=True, vertical_permitted=True),
         {"received_timestamp": at_ns + OFF_NS})
        for at_ns in arrivals_ns
    ]  # fmt: skip
    handle = SimpleNamespace(take_message=lambda *_: waiting.pop(0) if waiting else None)
    node = SimpleNamespace(create_subscription=lambda *_, **__: SimpleNamespace(handle=handle))
    return Subscription(node, clock, None, SafetyState, graph.SAFETY_STATE, COMMAND, False)


def test_the_last_message_of_a_dead_node_is_not_fresh():
    """`Robot.state` after a pause took it for news."""
    clock = Clock(100 * S)
    newest = Newest(received(clock, 20 * S), 200 * MS)
    assert newest.fresh(clock.now_ns()) is None
    assert newest.age_text(clock.now_ns()) == "80.000"


def test_a_message_that_has_just_come_is_fresh():
    clock = Clock(100 * S)
    newest = Newest(received(clock, 100 * S - 50 * MS), 200 * MS)
    assert newest.fresh(clock.now_ns()) is not None


def test_a_system_clock_that_was_set_back_makes_nothing_newer_than_now():
    clock = Clock(100 * S)
    take = received(clock, 4000 * S)
    assert take() is not None
    assert take.arrived_ns == 100 * S


def permit_after(clock: Clock, *arrivals_ns: int) -> Permit:
    inbox = SimpleNamespace(subscribe=lambda *_: received(clock, *arrivals_ns))
    node = SimpleNamespace(senders=lambda topic: SimpleNamespace(warning=""))
    permit = Permit([], Requests(), PermitSettings(), MS)
    Permission(node, inbox, VERTICAL).pass_on(permit, clock.now_ns())
    return permit


def test_after_a_stall_ten_old_permissions_are_none():
    """Their age counted from the moment at which the loop took them."""
    clock = Clock(100 * S)
    stalled = permit_after(clock, *(99 * S + n * 20 * MS for n in range(10)))
    assert not stalled.safety.fresh(clock.now_ns())
    assert permit_after(clock, 100 * S - 20 * MS).safety.fresh(clock.now_ns())
