# SPDX-License-Identifier: Apache-2.0
"""An operator's script: torque on, a recorded pull of 2 cm, torque off. Beside `bringup`."""

import sys

from screw_module_msgs.msg import ForceCommand, PlanarState

from screw_module_ros.operator.robot import Robot, RobotError

NODES = ("encoder", "force_sensor", "impedance_controller", "amplifier", "manus", "supervisor")


def operate(robot: Robot) -> None:
    """Bring the robot to operation, pull the hand to the right and back."""
    robot.wait_until_ready(NODES)
    robot.home()  # nut and arm stand at their marks
    robot.tare()  # nobody touches the handle
    robot.clear_faults()
    robot.permit()  # resets an earlier stop
    robot.set_mode(ForceCommand.FORCE_FEEDBACK)
    robot.set_impedance(200.0, 5.0)  # [N/m], [Ns/m]
    robot.set_impedance(200.0, 5.0, node="manus")
    robot.enable()
    robot.enable_plane()
    robot.start_recording()
    for x in (0.02, 0.0):  # [m] from the centre of the workspace
        robot.set_setpoint(x=x, y=0.0)
        robot.pause(2.0)
        print(f"set point x = {x:.3f} m, hand {robot.newest(PlanarState).position[0]:+.4f} m")
    print(robot.stop_recording())
    robot.enable(False)
    robot.enable_plane(False)


if __name__ == "__main__":
    try:
        with Robot(simulated="--hardware" not in sys.argv[1:]) as robot:
            operate(robot)
    except RobotError as error:
        sys.exit(f"operate: {error}")
