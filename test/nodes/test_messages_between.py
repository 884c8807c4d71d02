# SPDX-License-Identifier: Apache-2.0
"""Messages between processes: how old they are, what holds nobody up, which service is found."""

from __future__ import annotations

import math
import threading
from collections import Counter
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from screw_module_msgs.msg import SafetyState
from std_msgs.msg import UInt32
from std_srvs.srv import Trigger

from screw_module_ros import graph
from screw_module_ros.clock import ManualClock
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.life import Phase
from screw_module_ros.lockstep.clock import simulated_clock
from screw_module_ros.loop.plane import Plane
from screw_module_ros.loop.plane_controller import JointSettings
from screw_module_ros.nodes.support import inbox, topics
from screw_module_ros.nodes.support.drives import VERTICAL, Permission
from screw_module_ros.nodes.support.inbox import Inbox, Outlet, Subscription
from screw_module_ros.nodes.support.topics import COMMAND, Newest, is_served, offered
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
    permit = Permit([], PermitSettings(), MS)
    Permission(node, inbox, VERTICAL).pass_on(permit, clock.now_ns())
    return permit


def test_after_a_stall_ten_old_permissions_are_none():
    """Their age counted from the moment at which the loop took them."""
    clock = Clock(100 * S)
    stalled = permit_after(clock, *(99 * S + n * 20 * MS for n in range(10)))
    assert not stalled.safety.fresh(clock.now_ns())
    assert permit_after(clock, 100 * S - 20 * MS).safety.fresh(clock.now_ns())


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


SERVICE = "/robot/enable"


@pytest.fixture
def nodes():
    """Return the nodes `server` and `client`, each a participant of its own."""
    made = {}
    for name in ("server", "client"):
        context = Context()
        context.init()
        made[name] = Node(name, context=context)
    yield SimpleNamespace(**made)
    for node in made.values():
        node.destroy_node()
        node.context.try_shutdown()


class Listed:
    """A node that sees the live endpoints of a service and those that stayed of ended processes.

    Where they are not as many of either kind, the middleware calls no service ready.
    """

    def __init__(self, node: Node, readers: int, writers: int, live: bool):
        self._node, self._live = node, live
        self._stale = {"readers": readers, "writers": writers}

    def _listed(self, kind: str, endpoints: list) -> list:
        ended = [SimpleNamespace(endpoint_gid=[n] * 16) for n in range(self._stale[kind])]
        return ended + (endpoints if self._live else [])

    def get_subscriptions_info_by_topic(self, topic, no_mangle):
        return self._listed("readers", self._node.get_subscriptions_info_by_topic(topic, no_mangle))

    def get_publishers_info_by_topic(self, topic, no_mangle):
        return self._listed("writers", self._node.get_publishers_info_by_topic(topic, no_mangle))


def test_a_service_is_found(nodes, wait_until):
    client = nodes.client.create_client(Trigger, SERVICE)
    assert not is_served(nodes.client, client)
    nodes.server.create_service(Trigger, SERVICE, lambda request, response: response)
    wait_until(lambda: is_served(nodes.client, client))
    assert client.service_is_ready()


@pytest.mark.parametrize(
    ("readers", "writers", "live", "served"),
    [
        (1, 0, True, True),
        (0, 1, True, True),
        (3, 1, True, True),
        (1, 0, False, False),
        (0, 1, False, False),
        (0, 0, False, False),
    ],
)
def test_stale_endpoints_neither_hide_a_service_nor_stand_for_one(
    nodes, wait_until, readers, writers, live, served
):
    client = nodes.client.create_client(Trigger, SERVICE)
    nodes.server.create_service(Trigger, SERVICE, lambda request, response: response)
    wait_until(client.service_is_ready)
    unready = SimpleNamespace(service_is_ready=lambda: False, service_name=client.service_name)
    assert is_served(Listed(nodes.client, readers, writers, live), unready) == served


def test_a_service_that_is_only_half_matched_is_waited_for(nodes, wait_until):
    """As many readers as writers: the middleware knows them all, and says when it is ready."""
    client = nodes.client.create_client(Trigger, SERVICE)
    nodes.server.create_service(Trigger, SERVICE, lambda request, response: response)
    wait_until(client.service_is_ready)
    unready = SimpleNamespace(service_is_ready=lambda: False, service_name=client.service_name)
    assert not is_served(nodes.client, unready)


TOPICS = (graph.SETPOINT, graph.THERAPY_SLOT, graph.FORCE, graph.SAFETY_STATE)


@pytest.fixture
def controller(make_node):
    node = make_node("impedance_controller")
    node.trigger_configure()
    return node


@pytest.fixture
def publish(controller):
    """Return a function that publishes one message on each topic, at the readers on return.

    The middleware passes messages within a process by calls.
    """
    sender = rclpy.create_node("sender")
    publishers = []
    for topic in TOPICS:
        kind, name, qos = offered(topic)
        publishers.append((sender.create_publisher(kind, name, qos), kind))

    def publish_all() -> None:
        for publisher, kind in publishers:
            publisher.publish(kind())

    yield publish_all
    sender.destroy_node()


def takes_of(controller) -> list:
    inputs = controller.inputs
    return [
        inputs.setpoint, inputs.slot.take, inputs.force, lambda: inputs.safety.update(0)
    ]  # fmt: skip


def test_what_came_before_an_activation_is_dropped(controller, publish, wait_until):
    waiting = takes_of(controller)

    def matched() -> bool:
        publish()
        waiting[:] = [take for take in waiting if take() is None]
        return not waiting

    wait_until(matched)
    publish()
    controller.trigger_activate()
    assert [take() for take in takes_of(controller)] == [None] * len(TOPICS)
    publish()
    assert all(take() is not None for take in takes_of(controller))
    controller.close()


def test_a_set_point_from_before_is_gone(controller, publish, wait_until):
    """The spring would pull to where a game wanted the hand whose page was closed long ago."""
    controller.trigger_activate()

    def wanted() -> bool:
        publish()
        controller.read_inputs(controller.clock.now_ns())
        return not math.isnan(controller.role.wanted.at(controller.clock.now_ns(), True)[0])

    wait_until(wanted)
    controller.trigger_deactivate()
    controller.trigger_activate()
    assert math.isnan(controller.role.wanted.at(controller.clock.now_ns(), True)[0])
    controller.close()


def test_a_set_point_from_before_is_gone_in_the_plane_too(make_node, monkeypatch):
    """Deactivated and activated, with drives that do nothing."""
    node = make_node("manus")
    node.period_ns = 2_000_000
    node.port = SimpleNamespace(clock=node.clock, counters=Counter())
    drive = SimpleNamespace(
        settings=DriveSettings(), label="drive", phase=Phase.NEW, request_disable=lambda: None
    )
    settings = (PlanarSettings(), JointSettings(), PermitSettings())
    node._plane = Plane((drive, drive), node.port, node.period_ns, *settings)
    monkeypatch.setattr(node, "start_drives", lambda: None)
    node._make_topics()
    node.begin()
    node._plane.controller.wanted.ask((0.1, 0.1), (0.0, 0.0), 1)
    node.end()
    node.begin()
    assert all(map(math.isnan, node._plane.controller.wanted.at(1, True)[:2]))
    node.disconnect()
    node.close_topics()
