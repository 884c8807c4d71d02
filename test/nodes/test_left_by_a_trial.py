# SPDX-License-Identifier: Apache-2.0
"""The wide limits of a torque trial serve the trial alone, also if its process was killed."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from screw_module_msgs.msg import ForceCommand

from screw_module_ros import graph
from screw_module_ros.control.limits import TRIAL_RATE
from screw_module_ros.nodes.support import topics


@pytest.fixture
def amplifier(make_node):
    """Return a function that makes an amplifier with its parameters at start, its gate open."""

    def make(**given: float) -> Node:
        node = make_node("amplifier", *(w for k, v in given.items() for w in ("-p", f"{k}:={v}")))
        node.part = SimpleNamespace(permit=SimpleNamespace(enable=lambda clock: ""))
        node._senders = SimpleNamespace(count=lambda: "")
        return node

    return make


@pytest.fixture
def sender():
    """Return a function that makes a node which publishes the force command."""
    made = []

    def make(name: str) -> Node:
        made.append(Node(name))
        made[-1].create_publisher(ForceCommand, graph.FORCE_COMMAND, topics.COMMAND)
        return made[-1]

    yield make
    for node in made:
        node.destroy_node()


def as_in_a_trial(node: Node) -> None:
    freed = {"linearize": False, "command_rate": TRIAL_RATE, "command_up": 141.0}
    assert node.set_parameters_atomically([Parameter(k, value=v) for k, v in freed.items()])


def test_limits_that_a_killed_trial_left_are_nobody_else_s(amplifier, sender):
    """They were in force for whoever enabled next: 141 N, no limit of the rate."""
    node = amplifier()
    as_in_a_trial(node)
    assert "characterize does not command" in node.enable(), "killed, and nobody else commands"
    sender("impedance_controller")
    assert "start amplifier and impedance_controller anew" in node.enable()


def test_the_trial_itself_is_enabled(amplifier, sender):
    node = amplifier()
    as_in_a_trial(node)
    sender("characterize")
    assert node.enable() == ""


def test_beside_the_trial_nobody_else_commands(amplifier, sender):
    node = amplifier()
    as_in_a_trial(node)
    sender("characterize")
    sender("impedance_controller")
    assert node.enable() != ""


def test_an_amplifier_that_was_started_so_is_enabled(amplifier, sender):
    node = amplifier(command_rate=TRIAL_RATE)
    sender("impedance_controller")
    assert node.enable() == ""
