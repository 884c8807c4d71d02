# SPDX-License-Identifier: Apache-2.0
"""The parameter files name only what the nodes declare, and every node starts with them."""

from __future__ import annotations

import pytest
import yaml

from screw_module_ros.devices.drive_settings import JOINTS, SHARED, DriveSettings
from screw_module_ros.graph import BUSES, GRAPH
from screw_module_ros.nodes.bringup import HARDWARE_PARAMETERS, SIMULATION_PARAMETERS
from screw_module_ros.plant.world import load_world
from screw_module_ros.resources import resource_path

FILES = {
    SIMULATION_PARAMETERS: [entry.executable for entry in GRAPH],
    HARDWARE_PARAMETERS: [entry.executable for entry in GRAPH if not entry.simulation],
}
EVERY_NODE = "/**"
NAMESPACES = {SIMULATION_PARAMETERS: "/left", HARDWARE_PARAMETERS: "/"}
PAIRS = [(file, node) for file, nodes in FILES.items() for node in nodes]


def read(file: str) -> dict:
    """Return the file's mapping of node to parameters."""
    content = yaml.safe_load(resource_path(file).read_text())
    return {
        node.removeprefix("/**/"): section["ros__parameters"] for node, section in content.items()
    }


@pytest.mark.parametrize("file", FILES)
def test_a_section_for_every_node_and_no_other(file):
    """A misspelt node name would be ignored by ROS without a word."""
    assert set(read(file)) - {EVERY_NODE} == set(FILES[file])


def test_both_ends_of_a_bus_have_the_name_of_the_table(make_node):
    """The file says what the nodes declare anyway, for who wants to change it."""
    sections = read(SIMULATION_PARAMETERS)
    for bus in BUSES:
        assert sections[bus.node]["can.interface"] == "rig"
        assert sections[bus.node]["can.channel"] == bus.name
    rig = make_node("sim_rig")
    for bus in BUSES:
        assert rig.get_parameter(f"{bus.name}.can.channel").value == bus.name


@pytest.mark.parametrize(("file", "name"), PAIRS)
def test_the_node_takes_what_the_file_says(make_node, file, name):
    """Every value in the file is declared, of the right type, in range, and taken over.

    `ros2 param describe` has a sentence for each parameter of ours.
    """
    given = ["--params-file", str(resource_path(file)), "-r", f"__ns:={NAMESPACES[file]}"]
    node = make_node(name, *given)
    for parameter, value in read(file)[name].items():
        assert node.get_parameter(parameter).value == value
    for parameter in node.parameters._fields:
        assert len(node.describe_parameter(parameter).description) > 5, parameter


@pytest.mark.parametrize("joint", JOINTS)
def test_a_planar_drive_has_the_defaults_that_check_hardware_takes(make_node, joint):
    node = make_node("manus")
    shared = {name: node.get_parameter(name).value for name in ("rate", *SHARED)}
    assert node.parameters.read(DriveSettings, joint)._replace(**shared) == JOINTS[joint]


def test_home_position_is_where_the_rig_stands():
    """Homing in the simulation is true: the file's mark is where the plant starts."""
    assert read(SIMULATION_PARAMETERS)["encoder"]["home_position"] == load_world().start.position
