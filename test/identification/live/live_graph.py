# SPDX-License-Identifier: Apache-2.0
"""What the tests of `characterize` need to send goals beside a running graph."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

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
