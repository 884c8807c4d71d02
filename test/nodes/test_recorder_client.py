# SPDX-License-Identifier: Apache-2.0
"""The session's way to the recorder: one that was just started is found a moment later."""

from __future__ import annotations

import threading

import pytest
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from screw_module_ros.clock import ManualClock
from screw_module_ros.nodes.recorder_client import RECORDER, RecorderClient

S = 1_000_000_000


@pytest.fixture
def served(ros_domain_id):
    """Return a maker of nodes that are served until the end of the test."""
    context = Context()
    context.init()
    executor, ending, nodes = SingleThreadedExecutor(context=context), threading.Event(), []

    def serve() -> None:
        while not ending.is_set():
            executor.spin_once(timeout_sec=0.05)

    def make(name: str) -> Node:
        nodes.append(Node(name, context=context))
        executor.add_node(nodes[-1])
        return nodes[-1]

    thread = threading.Thread(target=serve)
    thread.start()
    yield make
    ending.set()
    thread.join()
    executor.shutdown(timeout_sec=1.0)
    for node in nodes:
        node.destroy_node()
    context.try_shutdown()


def test_a_recorder_that_appears_records(served, wait_until):
    clock = ManualClock(S)
    client = RecorderClient(served("session"), clock)
    client.start("P-22222")
    client.look(2 * S)
    assert not client.refused
    recorder = served(RECORDER)
    recorder.declare_parameter("name", "")

    def record(request, response):
        response.success, response.message = True, recorder.get_parameter("name").value
        return response

    recorder.create_service(Trigger, "~/start", record)
    wait_until(lambda: client.look(2 * S) or client.message == "recording to P-22222")
    assert client.since(2 * S) == S
    # Else a recording by hand would be refused, or be another person's under this name.
    wait_until(lambda: recorder.get_parameter("name").value == "", what="the name is taken back")


def test_without_a_recorder_it_is_refused_after_a_while(served):
    clock = ManualClock(S)
    client = RecorderClient(served("session"), clock)
    client.start("P-22222")
    client.look(6 * S - 1)
    assert not client.refused
    client.look(6 * S)
    assert client.refused and "no session_recorder answers" in client.message
