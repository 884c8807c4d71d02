# SPDX-License-Identifier: Apache-2.0
"""Start the therapy robot with `ros2 launch`, by the same plan as the bringup executable."""

import os
import sys

from screw_module_ros.programs import importing

NAME = "therapy_robot.launch.py"
# An ImportError would be told as a syntax error of this file, by `ros2 launch`.
with importing(NAME):
    from screw_module_ros.domain import domain_id
    from screw_module_ros.graph import PACKAGE
    from screw_module_ros.nodes.bringup import OLD_WORD, own_words, plan, shared_process
    from screw_module_ros.nodes.robot_description import robot_description
    from screw_module_ros.nodes.support.place import keep_to_this_machine, open_to_network
    from screw_module_ros.resources import resource_path
with importing(NAME):
    from ament_index_python.packages import PackageNotFoundError, get_package_prefix
    from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction, RegisterEventHandler
    from launch.event_handlers import OnProcessExit
    from launch.substitutions import LaunchConfiguration
    from launch_ros.actions import Node
    from launch_ros.parameter_descriptions import ParameterValue

    from launch import LaunchDescription

_YES, _NO = ("true", "1", "yes", "on"), ("false", "0", "no", "off", "")

# Ctrl-C reaches the nodes too. One whose Python is just starting would show a traceback; so it gets
# the signal when it has a handler (programs.py).
_UNTIL_IT_LISTENS = "env --block-signal=INT"


def _argument(name, default, description):
    return DeclareLaunchArgument(name, default_value=default, description=description)


ARGUMENTS = (
    _argument("hardware", "false", "The real robot, no sim_rig."),
    _argument("composed", "false",
              "One process `module` for encoder, force sensor, controller and amplifier."),
    _argument("one_process", "false",
              "One process `whole` with all nodes: simulated time passes several times as fast."),
    _argument("wall_clock", "false", "The simulated rig runs in real time."),
    _argument("params", "", "Parameter file, in place of the packaged one."),
    _argument("devices", "", "Makes of the devices, by comma (params/devices)."),
    _argument("patient", "", "Simulated patient who follows: a name of params/patients.yaml."),
    _argument("namespace", "", "For a second robot."),
    _argument("without", "", "Nodes to leave out, by comma."),
    _argument("network", "false", "Let other machines take part (see docs/security.md)."),
    _argument("rviz", "false", "Show the robot in RViz."),
    _argument("prefix", "", "Before the frames' names: so robots share /tf, and one RViz."),
)  # fmt: skip


def nodes(context):
    """Return the actions the launch arguments ask for."""
    domain_id()  # raises where ROS_DOMAIN_ID is none
    if "bench" in context.launch_configurations:
        print(f"{NAME}: bench:= {OLD_WORD.format('hardware:=true')}", file=sys.stderr)
        raise SystemExit(2)
    value = {a.name: LaunchConfiguration(a.name).perform(context).strip() for a in ARGUMENTS}
    hardware, composed, one_process, wall_clock, network, rviz = (
        _is_true(name, value[name])
        for name in ("hardware", "composed", "one_process", "wall_clock", "network", "rviz")
    )
    planned = plan(
        simulation=not hardware,
        params=value["params"] or None,
        devices=value["devices"],
        patient=value["patient"],
        namespace=value["namespace"],
        without=[name.strip() for name in value["without"].split(",") if name.strip()],
        shared=shared_process(composed, one_process),
        wall_clock=wall_clock,
    )
    told = [*planned.warnings, *_unknown(context)]
    before = dict(os.environ)
    told += [reach] if (reach := open_to_network() if network else keep_to_this_machine()) else []
    changed = {name: text for name, text in os.environ.items() if before.get(name) != text}
    prefix = LaunchConfiguration("launch-prefix", default="").perform(context)
    started = [
        Node(
            package=PACKAGE,
            executable=entry.executable,
            exec_name=entry.executable,
            namespace=planned.namespace,
            arguments=own_words(entry),
            ros_arguments=planned.arguments(entry),
            additional_env=changed,
            prefix=prefix or _UNTIL_IT_LISTENS,
            output="screen",
        )
        for entry in planned.entries
    ]
    return [
        *(LogInfo(msg=f"warning: {sentence}") for sentence in told),
        _fails_without(started),
        *started,
        *_viewers(planned.namespace, rviz, changed, value["prefix"]),
    ]


def _fails_without(started):
    """Return the handler that ends the launch with status 1 when every node has ended by itself."""
    running = set(started)

    def ended(event, context):
        running.discard(event.action)
        if not running and not context.is_shutdown:
            raise RuntimeError("every node of the robot has ended by itself")

    return RegisterEventHandler(OnProcessExit(on_exit=ended))


def _viewers(namespace, rviz, env, prefix):
    """Return the actions that show the robot, with what of it is installed.

    A second robot has a TF of its own, so that both keep their frames' names, or a prefix.
    """
    own_tf = [] if prefix else [("/tf", "tf"), ("/tf_static", "tf_static")]
    found = []
    if _is_installed("robot_state_publisher"):
        text = robot_description(prefix=prefix)
        described = {"robot_description": ParameterValue(text, value_type=str)}
        found.append(
            Node(
                package="robot_state_publisher", executable="robot_state_publisher",
                namespace=namespace, parameters=[described], remappings=own_tf,
                additional_env=env,
            )
        )  # fmt: skip
    shown = "two_robots" if prefix else "therapy_robot"
    if rviz and _is_installed("rviz2"):
        found.append(
            Node(
                package="rviz2", executable="rviz2", namespace=namespace, remappings=own_tf,
                arguments=["-d", str(resource_path(f"rviz/{shown}.rviz"))], additional_env=env,
            )
        )  # fmt: skip
    elif rviz:
        found.append(LogInfo(msg="warning: rviz2 is not installed: apt install ros-jazzy-rviz2"))
    return found


def _is_installed(package):
    try:
        get_package_prefix(package)
    except PackageNotFoundError:
        return False
    return True


def _unknown(context):
    """Return a sentence for launch arguments that nobody reads."""
    known = [argument.name for argument in ARGUMENTS]
    others = sorted(set(context.launch_configurations) - set(known))
    if not others:
        return []
    return [f"unknown arguments: {', '.join(others)}; there are {', '.join(known)}"]


def _is_true(name, text):
    if text.lower() not in _YES + _NO:
        raise ValueError(f"{name}:={text}: true or false is wanted")
    return text.lower() in _YES


def generate_launch_description():
    """Entry point of ros2 launch."""
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=nodes)])
