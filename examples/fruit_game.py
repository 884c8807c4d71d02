# SPDX-License-Identifier: Apache-2.0
"""A game: fruit hangs in the air, the robot's spring pulls towards it, the hand picks it."""

import math
from contextlib import suppress
from itertools import cycle

import rclpy
from rclpy.executors import ExternalShutdownException
from screw_module_msgs.msg import EndpointSetpoint, EndpointState

rclpy.init()
node = rclpy.create_node("fruit_game")
pull = node.create_publisher(EndpointSetpoint, "setpoint", 1)
fruit = cycle([(0.08, 0.06, 0.24), (-0.08, 0.06, 0.12), (0.0, -0.08, 0.18)])  # x, y, z [m]
aim = next(fruit)


def play(state: EndpointState) -> None:
    """Answer every state of the hand with a set point."""
    global aim
    if math.dist((state.position.x, state.position.y, state.position.z), aim) < 0.04:
        print(f"picked the fruit at {aim}, pulling {state.force.z:+.1f} N", flush=True)
        aim = next(fruit)
    setpoint = EndpointSetpoint()
    setpoint.position.x, setpoint.position.y, setpoint.position.z = aim
    pull.publish(setpoint)


node.create_subscription(EndpointState, "endpoint_state", play, 1)
with suppress(KeyboardInterrupt, ExternalShutdownException):
    rclpy.spin(node)
