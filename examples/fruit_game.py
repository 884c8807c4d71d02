# SPDX-License-Identifier: Apache-2.0
"""A game: fruit hangs in the air, the robot's spring pulls towards it, the hand picks it."""

import math
from itertools import cycle

import rclpy
from rclpy.executors import ExternalShutdownException
from screw_module_msgs.msg import EndpointSetpoint, EndpointState

rclpy.init()
node = rclpy.create_node("game")
wishes = node.create_publisher(EndpointSetpoint, "therapy/wish", 1)
fruit = cycle([(0.08, 0.06, 0.24), (-0.08, 0.06, 0.12), (0.0, -0.08, 0.18)])  # x, y, z [m]
aim = next(fruit)


def obstacle(state: EndpointState) -> str:
    """Return why the robot does not pull, empty if it does."""
    if not all(state.valid):
        return "an axis is not homed"
    if not all(state.enabled):
        return "the torque is off: enable both drives"
    if not wishes.get_subscription_count():
        return "nobody takes a game's wishes yet: does therapy_session run?"
    return ""


def play(state: EndpointState) -> None:
    """Answer every state of the hand with a wish."""
    global aim
    if why := obstacle(state):
        node.get_logger().warning(why, throttle_duration_sec=5.0)
    hand = state.position.x, state.position.y, state.position.z
    if math.dist(hand, aim) < 0.04:
        print(f"picked the fruit at {aim}, pushing {state.force.z:+.1f} N", flush=True)
        aim = next(fruit)
    wish = EndpointSetpoint()
    wish.position.x, wish.position.y, wish.position.z = aim
    wishes.publish(wish)


def listen() -> None:
    """Say that there is no robot; a timer also wakes a game that waits, so that it can end."""
    if not node.count_publishers("endpoint_state"):
        node.get_logger().warning("no robot: nobody tells endpoint_state")


node.create_timer(5.0, listen)
node.create_subscription(EndpointState, "endpoint_state", play, 1)
try:
    rclpy.spin(node)
except (KeyboardInterrupt, ExternalShutdownException):
    pass
except RuntimeError:  # rclpy's RCLError: a signal has ended ROS within a callback
    if rclpy.ok():
        raise
