# SPDX-License-Identifier: Apache-2.0
"""A game: fruit hangs in the air, the robot's spring pulls towards it, the hand picks it."""

import math
import signal
from itertools import cycle

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from screw_module_msgs.msg import EndpointSetpoint, EndpointState

rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # rclpy's own may miss the moment
stops: list[int] = []
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, lambda given, _: stops.append(given))
node = rclpy.create_node("fruit_game")
pull = node.create_publisher(EndpointSetpoint, "setpoint", 1)
fruit = cycle([(0.08, 0.06, 0.24), (-0.08, 0.06, 0.12), (0.0, -0.08, 0.18)])  # x, y, z [m]
aim = None


def play(state: EndpointState) -> None:
    """Answer every state of the hand with a set point."""
    global aim
    hand = state.position.x, state.position.y, state.position.z  # nan: not homed yet
    if aim is None or math.dist(hand, aim) < 0.04:
        picked = f"picked the fruit at {aim}, pulling {state.force.z:+.1f} N; " if aim else ""
        aim = next(fruit)
        print(f"{picked}hand {hand}, next fruit {aim}", flush=True)
    setpoint = EndpointSetpoint()
    setpoint.position.x, setpoint.position.y, setpoint.position.z = aim
    pull.publish(setpoint)


node.create_subscription(EndpointState, "endpoint_state", play, 1)
executor = SingleThreadedExecutor()
executor.add_node(node)
while not stops:
    executor.spin_once(timeout_sec=0.1)
