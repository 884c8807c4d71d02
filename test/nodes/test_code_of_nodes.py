# SPDX-License-Identifier: Apache-2.0
"""What the sources of the nodes must not do."""

from __future__ import annotations

import ast
import inspect
import textwrap
from pathlib import Path

import pytest
import rclpy
from node_classes import node_class
from rclpy.lifecycle import LifecycleNode

import screw_module_ros.nodes as nodes
from screw_module_ros.graph import BESIDE, table

NODES = sorted(entry.executable for entry in table())
MEANT = {"_phase", "_failure", "drives", "hardware_id", "port"}
"""Attributes that a base class initializes for those below it."""


def taken(kind: type) -> set[str]:
    """Return the names that a class assigns to its instances, and those of its private methods."""
    private = {name for name in vars(kind) if name.startswith("_") and not name.endswith("__")}
    tree = ast.parse(textwrap.dedent(inspect.getsource(kind)))
    return private | {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store)
        and isinstance(node.value, ast.Name) and node.value.id == "self"
    }


@pytest.fixture(scope="module")
def of_rclpy(ros_domain_id):
    rclpy.init()
    node = LifecycleNode("plain")
    names = set(vars(node))
    node.destroy_node()
    rclpy.shutdown()
    return names


@pytest.mark.parametrize("name", [*NODES, *(each for each in BESIDE if each != "characterize")])
def test_names_are_used_once(name, of_rclpy):
    ours = [kind for kind in node_class(name).__mro__ if "screw_module_ros" in kind.__module__]
    known = dict.fromkeys(of_rclpy, "rclpy")
    for kind in reversed(ours):
        twice = {each: known[each] for each in taken(kind) & known.keys() - MEANT}
        assert not twice, f"{kind.__name__} takes names of {twice}"
        known |= dict.fromkeys(taken(kind), kind.__name__)


METER = {"tick", "rate", "latency", "missed_in_a_row"}
FILES = [
    file
    for file in sorted(Path(nodes.__file__).parent.glob("*.py"))
    if ".meter" in file.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("file", FILES, ids=lambda path: path.stem)
def test_health_does_not_ask_the_meter(file):
    for function in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(function, ast.FunctionDef) and function.name == "health":
            called = {
                node.func.attr
                for node in ast.walk(function)
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
            }
            assert not called & METER
