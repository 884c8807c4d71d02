# SPDX-License-Identifier: Apache-2.0
"""`robot_description`: the robot as URDF; shape from `urdf/`, dimensions from the settings.

    ros2 run screw_module_ros robot_description > therapy_robot.urdf
"""

from __future__ import annotations

import click
import xacro

from screw_module_ros.control.limits import CommandLimits
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.geometry import MANUS, PlanarArm
from screw_module_ros.resources import resource_path
from screw_module_ros.safety.checks import WatchSettings

SHAPE = "urdf/therapy_robot.urdf.xacro"
JOINT_SPEED = 6.0
"""Speed limit of the joints [rad/s], required by URDF; the laws limit the hand's speed instead."""


def robot_description(arm: PlanarArm = MANUS) -> str:
    """Return the URDF of the robot with these dimensions and the default limits of the nodes.

    Frames and joints: see the file. Raises ResourceError where it is not installed.
    """
    plane, vertical = PlanarSettings(), VerticalSettings()
    lengths = {
        "upper_arm": arm.upper_arm,
        "forearm": arm.forearm,
        "base_x": arm.base_x,
        "base_y": arm.base_y,
        "shoulder_low": plane.shoulder_low,
        "shoulder_high": plane.shoulder_high,
        "between_low": plane.between_low,
        "between_high": plane.between_high,
        "joint_torque": max(plane.shoulder_torque, plane.elbow_torque),
        "joint_speed": JOINT_SPEED,
        "travel_low": vertical.travel_low,
        "travel_high": vertical.travel_high,
        "vertical_force": CommandLimits().command_up,
        "vertical_speed": WatchSettings().speed,
    }
    mappings = {name: repr(float(value)) for name, value in lengths.items()}
    return xacro.process_file(str(resource_path(SHAPE)), mappings=mappings).toprettyxml("  ")


@click.command()
def command() -> None:
    """Print the robot's URDF."""
    click.echo(robot_description())
