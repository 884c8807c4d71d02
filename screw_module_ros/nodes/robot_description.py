# SPDX-License-Identifier: Apache-2.0
"""`robot_description`: print the robot's URDF, for tools that want a file.

    ros2 run screw_module_ros robot_description > therapy_robot.urdf
"""

from __future__ import annotations

import click

from .support.description import robot_description


@click.command()
def command() -> None:
    """Print the robot's URDF."""
    click.echo(robot_description())


def main() -> None:
    """Console entry point."""
    command()
