# SPDX-License-Identifier: Apache-2.0
"""The law on the whole robot in one thread, without ROS: a hand moves, and meets the floor."""

import sys
import time

from mylab import FLOOR, FloorSettings

from screw_module_ros.control.laws import LAWS
from screw_module_ros.plant.patient import ArmSettings
from screw_module_ros.trials.one_thread import OneThreadRobot

HAND = ArmSettings("active", target=(0.0, 0.0, 0.20), amplitude=(0, 0, 0.08), omega=(0, 0, 1.5),
                   duration=1.0, stiffness=1500.0)  # fmt: skip


def felt(seconds: float = 6.0, own: FloorSettings | None = None, work_ns=None):
    """Return the ticks of a robot on which the law runs: time, position [m], forces [N].

    work_ns: `time.thread_time_ns` to have the processor time judged that the law takes here.
    """
    robot = OneThreadRobot(laws=(*LAWS, FLOOR), work_ns=work_ns)
    try:
        robot.ready()
        robot.controller.laws.choose("floor", own or FloorSettings())
        robot.controller.mode = 100
        if refused := robot.enable():
            sys.exit(refused)
        robot.world.set_arm(HAND)
        return robot.seconds(seconds)
    finally:
        robot.close()


if __name__ == "__main__":
    for row in felt(work_ns=time.thread_time_ns)[::500]:
        print(f"{row.time:5.2f} s  {row.position:.3f} m  hand {row.patient:+6.1f} N", row.reason)
