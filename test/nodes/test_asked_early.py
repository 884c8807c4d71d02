# SPDX-License-Identifier: Apache-2.0
"""An enabling that waited behind an activation or a `clear_fault` does not come afterwards."""

from __future__ import annotations

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from screw_module_ros.nodes.support import drives

LONGEST_S = 20.0


@pytest.fixture
def amplifier(make_node):
    """An amplifier that is not configured, and a client of its ~/enable in another node."""
    node = make_node("amplifier")
    asker = Node("asker")
    client = asker.create_client(SetBool, "amplifier/enable")
    assert client.wait_for_service(LONGEST_S)
    yield node, asker, client
    asker.destroy_node()


def waits(node: Node, service) -> bool:
    """Wait until a request waits at a service that nobody serves; return whether one does."""
    wait_set = _rclpy.WaitSet(0, 0, 0, 0, 1, 0, node.context.handle)
    wait_set.clear_entities()
    with service.handle:
        wait_set.add_service(service.handle)
        wait_set.wait(int(LONGEST_S * 1e9))
        return bool(wait_set.get_ready_entities("service"))


def answer(asker: Node, future):
    executor = SingleThreadedExecutor()
    executor.add_node(asker)
    executor.spin_until_future_complete(future, LONGEST_S)
    executor.remove_node(asker)
    return future.result()


@pytest.mark.parametrize("busy", ["clear_fault", "activate"])
def test_an_enabling_that_waited_is_refused(amplifier, busy):
    node, asker, client = amplifier
    future = client.call_async(SetBool.Request(data=True))
    assert waits(node, node._enabling)
    if busy == "activate":
        node.connect = node.begin = lambda: None  # there are no devices here
        node.trigger_configure()
        node.trigger_activate()
        assert node.active
    else:
        clear = next(each for each in node.services if each.srv_name.endswith("clear_fault"))
        clear.callback(Trigger.Request(), Trigger.Response())
    told = answer(asker, future)
    assert (told.success, told.message) == (False, drives._ASKED_EARLY)


def test_a_disabling_that_waited_is_carried_out(amplifier):
    node, asker, client = amplifier
    future = client.call_async(SetBool.Request(data=False))
    assert waits(node, node._enabling)
    node._refuse_waiting()
    assert "not active" in answer(asker, future).message  # what ~/disable says before configuring
