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
    simulated_arguments,
)
from screw_module_ros.resources import resource_path

ARGUMENTS = (
    DeclareLaunchArgument("bench", default_value="false", description="Real hardware, no sim_rig."),
    DeclareLaunchArgument(
        "composed", default_value="false",
        description="One process `module` for encoder, force sensor, controller and amplifier.",
    ),  # fmt: skip
    DeclareLaunchArgument(
        "wall_clock", default_value="false", description="The simulated rig runs in real time.",
    ),
    DeclareLaunchArgument("params", default_value="", description="Parameter file."),
    DeclareLaunchArgument("namespace", default_value="", description="For a second robot."),
    DeclareLaunchArgument("without", default_value="", description="Nodes to leave out, by comma."),
)


def nodes(context):
    """Return the Node actions the launch arguments ask for."""
    value = {a.name: LaunchConfiguration(a.name).perform(context) for a in ARGUMENTS}
    bench, composed, wall_clock = (
        _is_true(value[name]) for name in ("bench", "composed", "wall_clock")
    )
    packaged = BENCH_PARAMETERS if bench else SIMULATION_PARAMETERS
    params = value["params"] or str(resource_path(packaged))
    without = [name for name in value["without"].split(",") if name]
    return [
        Node(
            package=PACKAGE,
            executable=entry.executable,
            name=None if entry.parts else entry.executable,  # a name given is given to every part
            namespace=value["namespace"],
            parameters=[params],
            ros_arguments=[] if bench else simulated_arguments(composed, wall_clock),
            output="screen",
        )
        for entry in chosen(not bench, without=without, composed=composed)
    ]


def _is_true(text):
    return text.lower() in ("true", "1", "yes")


def generate_launch_description():
    """Entry point of ros2 launch."""
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=nodes)])
