# SPDX-License-Identifier: Apache-2.0
"""A message of the present tick is held back until the next one, and does not get younger by it."""

from __future__ import annotations

import pytest
from rclpy.context import Context
from rclpy.node import Node
from std_msgs.msg import String

from screw_module_ros.lockstep.clock import SimulatedClock
from screw_module_ros.nodes.support import topics
from screw_module_ros.nodes.support.inbox import Inbox, Outlet
from screw_module_ros.nodes.support.topics import Newest

S, MS = 1_000_000_000, 1_000_000


@pytest.fixture
def node(ros_domain_id):
    context = Context()
    context.init()
    made = Node("held_back", context=context)
    yield made
    made.destroy_node()
    context.try_shutdown()


@pytest.fixture
def clock(conductor, page):
    return SimulatedClock(page, "test")


@pytest.fixture
def publish(node, clock):
    outlet = Outlet(node, clock, String, "held_back", topics.SAMPLE)
    yield lambda text: outlet.publish(String(data=text))
    outlet.close()


@pytest.fixture
def newest(conductor, node, clock, publish, wait_until):
    """Return the newest message of the topic, once the middleware delivers."""
    inbox = Inbox(node, clock)
    made = Newest(inbox.subscribe(String, "held_back", topics.SAMPLE), 300 * MS)

    def delivered() -> bool:
        publish("so far")
        move(conductor, clock.now_ns() + MS)
        return made.update(clock.now_ns()) is not None

    wait_until(delivered)
    yield made
    inbox.close()


def move(conductor, to_ns: int) -> None:
    conductor.move(to_ns)
    conductor.release()


def test_a_message_held_back_is_as_old_as_it_is(conductor, clock, newest, publish):
    """A client that looks once in a while took the one held back at its last look for a new one."""
    publish("first")
    assert newest.fresh(clock.now_ns()).data == "so far"
    long_after = clock.now_ns() + 5 * S
    move(conductor, long_after)
    publish("second")
    assert newest.fresh(long_after) is None, "second is of this tick, first is 5 s old"
    move(conductor, long_after + MS)
    assert newest.fresh(clock.now_ns()).data == "second"
    assert newest.arrival_ns == long_after
    move(conductor, long_after + S)
    assert newest.fresh(clock.now_ns()) is None


def test_a_message_of_this_tick_does_not_push_out_the_last_one(conductor, clock, newest, publish):
    """The queue has one place; whoever looked late found only the message that is not due yet."""
    publish("first")
    move(conductor, clock.now_ns() + MS)
    publish("second")
    assert newest.fresh(clock.now_ns()).data == "first"
    move(conductor, clock.now_ns() + MS)
    assert newest.fresh(clock.now_ns()).data == "second"


def test_a_waking_loop_leaves_a_message_of_the_next_tick(
    conductor, node, clock, publish, wait_until
):
    """Woken late, a loop took a command of the tick before it had sent that tick's SYNC."""
    inbox = Inbox(node, clock)
    take = inbox.subscribe(String, "held_back", topics.SAMPLE, wakes=True)

    def delivered() -> bool:
        publish("so far")
        return take() is not None

    wait_until(delivered)
    publish("of this tick")
    assert take(early=False) is None
    inbox.wait(clock.now_ns() + S)  # returns at once: it has been kept
    assert take().data == "of this tick"
    inbox.close()
