# SPDX-License-Identifier: Apache-2.0
"""Start the therapy robot with `ros2 launch`, from the same table as the bringup executable."""

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from screw_module_ros.nodes.support.graph import (
    BENCH_PARAMETERS,
    PACKAGE,
    SIMULATION_PARAMETERS,
    chosen,
)
from screw_module_ros.resources import resource_path

ARGUMENTS = (
    DeclareLaunchArgument("bench", default_value="false", description="Real hardware, no sim_rig."),
    DeclareLaunchArgument("params", default_value="", description="Parameter file."),
    DeclareLaunchArgument("namespace", default_value="", description="For a second robot."),
    DeclareLaunchArgument("without", default_value="", description="Nodes to leave out, by comma."),
)


def nodes(context):
    """Return the Node actions the launch arguments ask for."""
    value = {a.name: LaunchConfiguration(a.name).perform(context) for a in ARGUMENTS}
    bench = value["bench"].lower() in ("true", "1", "yes")
    packaged = BENCH_PARAMETERS if bench else SIMULATION_PARAMETERS
    params = value["params"] or str(resource_path(packaged))
    without = [name for name in value["without"].split(",") if name]
    return [
        Node(
            package=PACKAGE,
            executable=entry.executable,
            name=entry.executable,
            namespace=value["namespace"],
            parameters=[params],
            output="screen",
        )
        for entry in chosen(not bench, without=without)
    ]


def generate_launch_description():
    """Entry point of ros2 launch."""
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=nodes)])
