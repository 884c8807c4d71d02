# SPDX-License-Identifier: Apache-2.0
"""What came before a node was active counts no longer: its sender may have died meanwhile."""

from __future__ import annotations

import math
from collections import Counter
from types import SimpleNamespace

import pytest
import rclpy

from screw_module_ros import graph
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.loop.plane import JointSettings, Plane
from screw_module_ros.nodes.support.topics import offered
from screw_module_ros.safety.permit import PermitSettings

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
    return [
        controller._take_setpoint, controller._slot._take, controller._take_force,
        controller._safety._take,
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
        return not math.isnan(controller.part.wanted.at(controller.clock.now_ns(), True)[0])

    wait_until(wanted)
    controller.trigger_deactivate()
    controller.trigger_activate()
    assert math.isnan(controller.part.wanted.at(controller.clock.now_ns(), True)[0])
    controller.close()


def test_a_set_point_from_before_is_gone_in_the_plane_too(make_node, monkeypatch):
    """Deactivated and activated, with drives that do nothing."""
    node = make_node("manus")
    node.period_ns = 2_000_000
    node.port = SimpleNamespace(clock=node.clock, counters=Counter())
    drive = SimpleNamespace(
        settings=DriveSettings(), running=False, request_disable=lambda: None
    )
    settings = (PlanarSettings(), JointSettings(), PermitSettings())
    node._plane = Plane((drive, drive), node.port, node.period_ns, *settings)
    monkeypatch.setattr(node, "start_drives", lambda: None)
    node._make_topics()
    node.begin()
    node._plane.wanted.ask((0.1, 0.1), (0.0, 0.0), 1)
    node.end()
    node.begin()
    assert all(map(math.isnan, node._plane.wanted.at(1, True)[:2]))
    node.disconnect()
    node.close_topics()
