# SPDX-License-Identifier: Apache-2.0
"""`robot_description`: the robot as URDF or for MuJoCo; shape from `urdf/`, sizes from settings.

    ros2 run screw_module_ros robot_description > therapy_robot.urdf
    ros2 run screw_module_ros robot_description --mujoco > therapy_robot.xml

Masses and inertias are those of the simulated rig, `params/plant.yaml`, which `urdf/parts.xacro`
reads by itself, as it reads the figures of the thesis.
"""

from __future__ import annotations

import click
import xacro

from screw_module_ros.control.limits import CommandLimits
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.geometry import MANUS, SCREW, PlanarArm
from screw_module_ros.resources import resource_path
from screw_module_ros.safety.checks import WatchSettings
from screw_module_ros.thesis import FACTS_FILE

SHAPE, SHAPE_MUJOCO = "urdf/therapy_robot.urdf.xacro", "urdf/therapy_robot.mjcf.xacro"
MASSES = "params/plant.yaml"
JOINT_SPEED = 6.0
"""Speed limit of the joints [rad/s], required by URDF; the laws limit the hand's speed instead."""


def robot_description(
    arm: PlanarArm = MANUS, handle_angle: float = 0.0, prefix: str = "", shape: str = SHAPE
) -> str:
    """Return the URDF of the robot with these dimensions and the default limits of the nodes.

    handle_angle: of the grip about the line from the screw to it, 0 = upright [rad] (thesis
    3.1.10). prefix: before the names of the links, so that two robots share a TF. shape:
    `SHAPE_MUJOCO` for MuJoCo's format, without a prefix. Frames and joints: see the files. Raises
    ResourceError where one is not installed.
    """
    plane, vertical = PlanarSettings(), VerticalSettings()
    lengths = {
        "upper_arm": arm.upper_arm,
        "forearm": arm.forearm,
        "base_x": arm.base_x,
        "base_y": arm.base_y,
        "lead": SCREW.lead,
        "handle_angle": handle_angle,
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
    mappings |= {"plant": str(resource_path(MASSES)), "thesis": str(resource_path(FACTS_FILE))}
    mappings["prefix"] = prefix
    return xacro.process_file(str(resource_path(shape)), mappings=mappings).toprettyxml("  ")


@click.command()
@click.option("--handle-angle", default=0.0, metavar="RAD", help="Of the grip, 0 = upright.")
@click.option("--prefix", default="", help="Before the links' names: two robots in one TF.")
@click.option("--mujoco", is_flag=True, help="For MuJoCo (MJCF) instead.")
def command(handle_angle: float, prefix: str, mujoco: bool) -> None:
    """Print the robot's URDF."""
    click.echo(robot_description(MANUS, handle_angle, prefix, SHAPE_MUJOCO if mujoco else SHAPE))
