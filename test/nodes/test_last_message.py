# SPDX-License-Identifier: Apache-2.0
"""The last message of a publisher that has gone, and never comes, holds nobody up.

After Ctrl-C it held the time of the whole graph for 0.9 s each, until the rig left the others.
"""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest
from rclpy.context import Context
from rclpy.node import Node
from std_msgs.msg import UInt32

from screw_module_ros.lockstep.clock import simulated_clock
from screw_module_ros.nodes.support import inbox, topics
from screw_module_ros.nodes.support.inbox import Inbox, Outlet

FOREVER_NS = 3_600_000_000_000


@pytest.fixture
def ends(wait_until):
    """Return an outlet and the function that takes its messages, of which one has come."""
    clock = simulated_clock("tester", "/last_message")
    context = Context()
    context.init()
    node = Node("tester", context=context)
    outlet, inbox = Outlet(node, clock, UInt32, "number", topics.SAMPLE), Inbox(node, clock)
    take = inbox.subscribe(UInt32, "number", topics.SAMPLE, wakes=True)
    wait_until(lambda: node.count_subscribers("number") and node.count_publishers("number"))
    outlet.publish(UInt32(data=1))
    wait_until(lambda: (found := take()) and found.data == 1)
    yield SimpleNamespace(outlet=outlet, take=take)
    inbox.close()
    node.destroy_node()
    context.try_shutdown()
    clock.leave()
    clock.close()


@pytest.mark.parametrize("goes_first", [True, False])
def test_what_never_comes_is_waited_for_no_longer_than_its_publisher_is_there(
    ends, monkeypatch, goes_first
):
    monkeypatch.setattr(inbox, "_LOST_NS", FOREVER_NS)
    ends.outlet._end.count()  # counted, and dropped by the middleware
    found = []
    taking = threading.Thread(target=lambda: found.append(ends.take()), daemon=True)
    if goes_first:
        ends.outlet.close()
        taking.start()
    else:
        taking.start()
        ends.outlet.close()
    taking.join(timeout=60.0)
    assert found == [None]
