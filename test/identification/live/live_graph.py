# SPDX-License-Identifier: Apache-2.0
"""What the tests of `characterize` need to send goals beside a running graph."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from screw_module_msgs.action import RunExperiment

from screw_module_ros.nodes import bringup
from screw_module_ros.operator.robot import Robot
from screw_module_ros.trials.runner import GraphRun

SIMULATED = ["-p", "use_sim_time:=true"]
AS_FAST_AS_IT_GOES = ["-p", "sim_rig:speed:=0.0"]


@contextmanager
def own_node() -> Iterator[tuple[Node, SingleThreadedExecutor]]:
    """Give a node served by the thread that sends the goals.

    rclpy's action client loses a response that comes before `send_goal_async` has returned.
    """
    context = Context()
    context.init()
    node = Node("goals", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield node, executor
    executor.shutdown(timeout_sec=1.0)
    node.destroy_node()
    context.try_shutdown()


@contextmanager
def operated(graph: GraphRun) -> Iterator[tuple[Robot, ActionClient]]:
    """Give an operator, the robot homed, and a client of `characterize` beside a graph."""
    with own_node() as (node, executor):

        def watch() -> None:
            graph.watch()
            executor.spin_once(timeout_sec=0.0)

        with Robot("tester", watch=watch, simulated=True) as robot:
            robot.wait_until_ready([*graph.names, "characterize"])
            graph.wait_until_ready(robot, lambda waiting: None)
            robot.clear_faults()
            robot.home()
            client = ActionClient(node, RunExperiment, "characterize/run")
            robot.wait_until(client.server_is_ready, 20.0, "no action")
            yield robot, client
            client.destroy()


def characterize(folder: object) -> bringup.Process:
    """Start `characterize`; folder: its own parameter."""
    return bringup.Process("characterize", ["--ros-args", *SIMULATED, "-p", f"folder:={folder}"])
