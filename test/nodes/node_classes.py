# SPDX-License-Identifier: Apache-2.0
"""Nodes by the names of their executables: their classes, and nodes that a test makes."""

from __future__ import annotations

import gc
import importlib
import inspect
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions

from screw_module_ros.nodes.support.node import Node


def node_class(name: str) -> type[Node]:
    """Return the node class of the executable `name`."""
    room = "identification.live" if name == "characterize" else "nodes"
    module = importlib.import_module(f"screw_module_ros.{room}.{name}")
    (found,) = [
        kind
        for _, kind in inspect.getmembers(module, inspect.isclass)
        if issubclass(kind, Node) and kind.__module__ == module.__name__
    ]
    return found


@contextmanager
def making_nodes(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Node]]:
    """Yield `make(name, *ros_args)`, which returns a node, declared but not configured."""
    made: list[Node] = []

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
