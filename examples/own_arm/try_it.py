# SPDX-License-Identifier: Apache-2.0
"""The serial arm on the whole robot in one thread, without ROS: it homes, and draws a square."""

import math
import sys

from serial_arm import SERIAL
from serial_plant import SERIAL_PLANT

from screw_module_ros.trials.one_thread import OneThreadRobot

CORNERS = ((0.08, 0.0), (0.08, 0.08), (-0.08, 0.08), (0.0, 0.0))


def drawn(seconds: float = 1.5):
    """Return where the handle was at each corner [m], and the first torques [Nm]."""
    robot = OneThreadRobot(arm=SERIAL, plane_plant=SERIAL_PLANT)
    try:
        robot.ready()
        robot.world.set_fixture("free")
        if refused := robot.enable_plane():
            sys.exit(refused)
        robot.plane.controller.settings = robot.plane.controller.settings._replace(
            stiffness=400.0, damping=60.0
        )
        places, torques = [], []
        for corner in CORNERS:
            robot.planar_setpoint = (*corner, 0.0, 0.0)
            torques.append(robot.seconds(seconds)[100].plane)
            places.append(robot.world.truth().planar_position)
        return places, torques
    finally:
        robot.close()


if __name__ == "__main__":
    for corner, place in zip(CORNERS, drawn()[0], strict=True):
        print(f"asked {corner}, there {place[0]:+.3f} {place[1]:+.3f} m, "
              f"{1e3 * math.dist(corner, place):.1f} mm away")  # fmt: skip
