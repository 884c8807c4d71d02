# SPDX-License-Identifier: Apache-2.0
"""What the launch file starts; `launch` has no wheels, so its classes are stand-ins here."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from unittest.mock import Mock

import pytest
import yaml

from screw_module_ros.graph import WHOLE

LAUNCH_FILE = Path(__file__).parents[2] / "launch/therapy_robot.launch.py"


class Argument(SimpleNamespace):
    """`DeclareLaunchArgument`."""

    def __init__(self, name, default_value, description):
        super().__init__(name=name, default_value=default_value)


class Configuration:
    """`LaunchConfiguration`: the value that was given, in `launch_configurations`."""

    def __init__(self, name, default=""):
        self._name, self._default = name, default

    def perform(self, context):
        return context.launch_configurations.get(self._name, self._default)


class Node(SimpleNamespace):
    """`launch_ros.actions.Node`."""

    __hash__ = object.__hash__


@pytest.fixture
def started(monkeypatch):
    """Return `started(**given)`: executable -> its own arguments, of launch arguments."""
    for name, content in {
        "launch": {"LaunchDescription": Mock()},
        "launch.actions": {"DeclareLaunchArgument": Argument, "LogInfo": Mock(),
                           "OpaqueFunction": Mock(), "RegisterEventHandler": Mock()},
        "launch.event_handlers": {"OnProcessExit": Mock()},
        "launch.substitutions": {"LaunchConfiguration": Configuration},
        "launch_ros": {},
        "launch_ros.actions": {"Node": Node},
        "launch_ros.parameter_descriptions": {"ParameterValue": lambda text, value_type: text},
    }.items():  # fmt: skip
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    file = runpy.run_path(str(LAUNCH_FILE))
    defaults = {argument.name: argument.default_value for argument in file["ARGUMENTS"]}

    def start(**given: str) -> dict[str, list[str]]:
        return {name: each.arguments for name, each in start.nodes(**given).items()}

    def nodes(**given: str) -> dict[str, Node]:
        context = SimpleNamespace(launch_configurations={**defaults, **given})
        actions = file["nodes"](context)
        return {each.executable: each for each in actions if isinstance(each, Node)}

    start.nodes = nodes
    return start


def test_one_process_is_one_executable_with_all_nodes(started):
    assert started(one_process="true") == {"whole": []}
    others = ",".join(name for name in WHOLE.parts if name != "manus")
    assert started(one_process="true", without="manus") == {"whole": ["--parts", others]}
    assert {"sim_rig", "encoder", "manus"} < started().keys()
    assert "whole" not in started(composed="true") and "module" in started(composed="true")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"composed": "true"}, "one of them"),
        ({"hardware": "true"}, "is for simulated time alone"),
        ({"wall_clock": "true"}, "is for simulated time alone"),
    ],
)
def test_one_process_is_refused_in_a_sentence(started, given, told):
    with pytest.raises(ValueError, match=told):
        started(one_process="true", **given)


@pytest.fixture
def viewers(monkeypatch):
    """Every package counts as installed, before the launch file is read."""
    monkeypatch.setattr("ament_index_python.packages.get_package_prefix", lambda package: package)


def test_robots_with_a_prefix_share_a_tf_and_one_rviz(viewers, started):
    """Without one, each has a TF of its own, and its frames keep their names."""
    for prefix, topics in (("", [("/tf", "tf"), ("/tf_static", "tf_static")]), ("left_", [])):
        shown = started.nodes(namespace="left", prefix=prefix, rviz="true")
        publisher, viewer = shown["robot_state_publisher"], shown["rviz2"]
        assert publisher.remappings == viewer.remappings == topics
        (described,) = publisher.parameters
        assert f'<link name="{prefix}handle">' in described["robot_description"]
        fixed = yaml.safe_load(Path(viewer.arguments[1]).read_text("utf-8"))
        fixed = fixed["Visualization Manager"]["Global Options"]["Fixed Frame"]
        assert fixed == f"{prefix}manus_base"
