# SPDX-License-Identifier: Apache-2.0
"""The class of a node, by the name of its executable."""

from __future__ import annotations

import importlib
import inspect

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
