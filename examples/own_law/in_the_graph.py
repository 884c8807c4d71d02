# SPDX-License-Identifier: Apache-2.0
"""The law in the running graph and in the recording, beside `bringup`: it needs no `ros2`."""

import sys

from screw_module_msgs.msg import ImpedanceState
from screw_module_msgs.srv import SetArm

from screw_module_ros.operator.robot import Robot, RobotError
from screw_module_ros.recording.decoded import columns

NODES = ("encoder", "force_sensor", "impedance_controller", "amplifier", "manus", "supervisor")
FLOOR = 100


def show(height: float, state: ImpedanceState) -> None:
    """Print what the controller says of the law that runs."""
    own = dict(zip(state.law_names, state.law_values, strict=True))
    print(f"floor at {height:.2f} m, nut at {state.position:.3f} m: {state.law.split()[0]} {own}")


def run(robot: Robot) -> None:
    """Choose the law, have the simulated hand press on its floor, and raise the floor."""
    robot.wait_until_ready(NODES)
    robot.home()  # the nut stands at its mark, 0.25 m, and the arm at its own
    robot.tare()  # nobody touches the handle
    robot.clear_faults()
    robot.permit()
    robot.set_mode(FLOOR)
    robot.enable()
    folder = robot.start_recording()
    hand = SetArm.Request(kind="active", mass=3.0, stiffness=1500.0, damping=50.0, duration=1.0)
    hand.target.z = 0.13
    robot.set_arm(hand)
    for height in (0.15, 0.20):
        robot.set_parameter("impedance_controller", "floor.height", height)
        robot.pause(2.0)
        show(height, robot.newest(ImpedanceState))
    robot.stop_recording()
    robot.enable(False)
    recorded = columns(folder, "/screw/controller_state")
    depths = [values[0] for values in recorded["law_values"]]  # as named in law_names
    print(f"recorded in {folder}: {recorded['law'][-1]}, up to {max(depths):.3f} m deep")


if __name__ == "__main__":
    try:
        with Robot(simulated=True) as client:
            run(client)
    except RobotError as error:
        sys.exit(f"in_the_graph: {error}")
