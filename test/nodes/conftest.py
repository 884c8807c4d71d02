# SPDX-License-Identifier: Apache-2.0
"""What the tests of nodes share."""

from __future__ import annotations

import gc
import sys

import pytest
import rclpy
from node_classes import node_class
from rclpy.signals import SignalHandlerOptions

from screw_module_ros.nodes.support.node import Node


@pytest.fixture
def make_node(monkeypatch):
    """Return `make_node(name, *ros_args)`: the node, declared but not configured."""
    made = []

    def make(name: str, *ros_args: str) -> Node:
        monkeypatch.setattr(sys, "argv", [name, "--ros-args", *ros_args])
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        try:
            node = node_class(name)()
        except BaseException:
            rclpy.shutdown()
            raise
        made.append(node)
        node.parameters.finish()
        return node

    yield make
    for node in made:
        node.destroy_node()
        node.clock.close()  # else the next rig of this run goes on in its time
    rclpy.try_shutdown()
    # Now: the middleware ends a participant when its node is collected, and hung for ever when that
    # happened while the next one was being discovered. A graph of this module has the same names.
    made.clear()
    node = None
    gc.collect()
