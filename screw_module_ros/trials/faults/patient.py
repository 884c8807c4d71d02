# SPDX-License-Identifier: Apache-2.0
"""The hand on the rig's handle: the patient's, and the technician's who carries the handle."""

from __future__ import annotations

import math

from screw_module_msgs.msg import ForceCommand
from screw_module_msgs.srv import SetFixture

from screw_module_ros.operator.robot import Robot, RobotError, arm

from .listener import NO_JOINT_TORQUE, NO_TORQUE, Listener

HOME = 0.25  # height of the hand and of the reference mark [m]
SPRING = (0.05, 0.05, HOME + 0.06, 0.0, 0.0, 0.0)  # set point off the hand, so that torque acts
_AMPLITUDE, _OMEGA = (0.02, 0.02, 0.06), 3.0  # of the moving hand [m], [rad/s]
_DAMPING = 40.0  # of the arm [Ns/m]: the hand comes to rest
_STILL = (0.0, 0.0, 0.0)
_LOWEST, _HIGHEST = 0.02, 0.33  # heights at which the hand may rest [m]
_AT_HOME, _RESTING, _RESTING_JOINT = 0.002, 0.004, 0.01
_AT_PLANE_HOME = 0.005  # the joints' stiction holds a soft hand 2 mm from its mark [m]
_REST_S, _RESTING_FORCE = 0.1, 0.3  # at rest the force changes by less in this time [s], [N]
_HOMING_S = 20.0  # a joint whose drive has lost its settings brakes


class Patient:
    """Moves the hand, lets it rest, carries the handle; checks whether the hand is at rest."""

    def __init__(self, robot: Robot, listener: Listener):
        self._robot, self._listener = robot, listener

    def set_up(self) -> None:
        """Set mass, stiffness and damping of the rig's patient, after a start of the rig."""
        self._robot.set_arm(arm(kind="active", mass=3.0, stiffness=300.0, damping=_DAMPING))

    def rest(self) -> None:
        """Let the hand rest at the reference mark; with a drive off, where the handle is."""
        listener = self._listener
        listener.setpoint = SPRING
        (x, y), z = (0.0, 0.0), HOME
        if not (listener.enabled("amplifier") and listener.enabled("manus")):
            now = listener.now
            (x, y), z = now.plane, min(max(now.height, _LOWEST), _HIGHEST)
        self._robot.set_arm(
            arm((float(x), float(y), z), 0.2, amplitude=_STILL, omega=_STILL, kind="active")
        )

    def move(self, mode: int) -> None:
        """Move the hand until the motors give torque, in `mode`. Raises RobotError if not."""
        self._robot.set_arm(
            arm(target=(0.0, 0.0, HOME), amplitude=_AMPLITUDE, omega=(_OMEGA,) * 3)
        )
        if not self._robot.met(lambda: self._torque_is_out(mode), 3.0):
            now = self._listener.now
            raise RobotError(
                f"no torque in motion: {now.torque:.3f} Nm, {now.speed:.3f} m/s, joints "
                f"{now.joints[0]:.2f} and {now.joints[1]:.2f} Nm{self._robot.complaints_text()}"
            )

    def _torque_is_out(self, mode: int) -> bool:
        now = self._listener.now
        vertical = abs(now.torque) > NO_TORQUE or mode == ForceCommand.OFF
        plane = max(map(abs, now.joints)) > NO_JOINT_TORQUE
        return vertical and plane and abs(now.speed) > 1e-3

    @property
    def at_rest(self) -> bool:
        """Whether the hand rests: from now on only the robot changes the force on it."""
        moments = self._listener.since(self._listener.now.time - _REST_S)
        forces = [moment.force for moment in moments]
        return bool(moments) and all(
            max(axis) - min(axis) < _RESTING_FORCE for axis in zip(*forces, strict=True)
        )

    def place(self) -> None:
        """Carry the handle and the hand to the reference mark, as a technician does.

        Raises RobotError if they do not arrive.
        """
        robot, rest = self._robot, (math.nan, math.nan, 0.0)
        robot.set_arm(arm((math.nan, math.nan, HOME), amplitude=rest, omega=rest))
        robot.ask(
            SetFixture,
            "sim_rig/set_fixture",
            SetFixture.Request(fixture="human_arm", position=HOME),
        )

        def there() -> bool:
            now = self._listener.now
            return abs(now.height - HOME) < _AT_HOME and abs(now.speed) < _RESTING

        if not robot.met(there, 5.0):
            now = self._listener.now
            raise RobotError(
                f"the handle does not come to {HOME:g} m: {now.height:.4f} m, {now.speed:.3f} m/s"
                f"{robot.complaints_text()}"
            )

    def place_plane(self) -> None:
        """Hold the handle on the plane's reference mark. Raises RobotError if it stays off."""
        robot = self._robot
        robot.set_arm(arm((0.0, 0.0, math.nan), 0.2, amplitude=_STILL, omega=_STILL))
        if not robot.met(self._plane_at_home, _HOMING_S):
            now = self._listener.now
            raise RobotError(
                f"the plane does not come to rest: {1e3 * math.hypot(*now.plane):.1f} mm from "
                f"its mark, {now.joint_speed:.2g} rad/s{robot.complaints_text()}"
            )

    def _plane_at_home(self) -> bool:
        now = self._listener.now
        return math.hypot(*now.plane) < _AT_PLANE_HOME and now.joint_speed < _RESTING_JOINT
