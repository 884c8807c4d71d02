# SPDX-License-Identifier: Apache-2.0
"""The hand on the rig's handle: the patient's, and the technician's who carries the handle."""

from __future__ import annotations

import math

from record import Record, plane, vertical
from screw_module_msgs.srv import SetFixture

from screw_module_ros.control.modes import OFF
from screw_module_ros.operator.robot import Robot, RobotError, arm

MARK = 0.25  # height of the hand and of the reference mark [m]
STILL = (0.0, 0.0, 0.0)
LEAVE = math.nan
_AMPLITUDE, _OMEGA = (0.02, 0.02, 0.06), 3.0  # of the moving hand [m], [rad/s]
_DAMPING = 40.0  # of the arm [Ns/m]: the hand comes to rest
_LIMP_DAMPING = 10.0  # of one that hangs [Ns/m]
_GRAVITY = 9.81  # [m/s^2]
_LOWEST, _HIGHEST = 0.02, 0.33  # heights at which the hand may rest [m]
_AT_MARK, _RESTING, _RESTING_JOINT = 0.002, 0.004, 0.01
_AT_PLANE_MARK = 0.005  # the joints' stiction holds a soft hand 2 mm from its mark [m]
_REST_S, _RESTING_FORCE = 0.1, 0.3  # at rest the force changes by less in this time [s], [N]
_HOMING_S = 20.0  # a joint whose drive has lost its settings brakes


class Hand:
    """Moves the handle, lets it rest, carries it to its marks; the `Hand` of `bring_up`."""

    def __init__(self, robot: Robot, record: Record):
        self._robot, self._record = robot, record
        self._holds = True

    def set_up(self) -> None:
        """Set the arm of the rig's patient, who holds it up, after a start of the rig."""
        self._robot.set_arm(
            arm(kind="active", mass=3.0, stiffness=300.0, damping=_DAMPING, traits={"carried": 1.0})
        )

    def hang(self, weight: float) -> None:
        """Let an arm of a weight [N] hang on the handle, as heavy as it is inert."""
        traits = {"weight": weight, "carried": 0.0}
        self._robot.set_arm(
            arm(kind="relaxed", mass=weight / _GRAVITY, damping=_LIMP_DAMPING, traits=traits)
        )

    def rest(self) -> None:
        """Let the hand rest at the reference mark; with a drive off, where the handle is."""
        record = self._record
        (x, y), z = (0.0, 0.0), MARK
        if not (record.enabled("amplifier") and record.enabled("manus")):
            now = record.now
            (x, y), z = now.plane, min(max(now.height, _LOWEST), _HIGHEST)
        self._robot.set_arm(
            arm((float(x), float(y), z), 0.2, amplitude=STILL, omega=STILL, kind="active")
        )

    def move(self, mode: int) -> None:
        """Move the hand until the motors give torque, in `mode`. Raises RobotError if not."""
        self._robot.set_arm(
            arm(target=(0.0, 0.0, MARK), amplitude=_AMPLITUDE, omega=(_OMEGA,) * 3)
        )

        def torque_is_out() -> bool:
            now = self._record.now
            return (vertical(now) or mode == OFF) and plane(now) and abs(now.speed) > 1e-3

        self._robot.wait_until(torque_is_out, 3.0, "no torque in motion")

    @property
    def at_rest(self) -> bool:
        """Whether the hand rests in the vertical: only the robot changes the force there now.

        In the plane it need not: the simulated robot's gain of force feedback is beyond what its
        structure bears, and it chatters under a hand that holds still (docs/studies.md).
        """
        moments = self._record.since(self._record.now.time - _REST_S)
        forces = [moment.force[2] for moment in moments]
        return bool(forces) and max(forces) - min(forces) < _RESTING_FORCE

    def to_mark(self) -> None:
        """Carry the handle and the hand to the reference mark. Raises RobotError if it fails."""
        robot, rest = self._robot, (LEAVE, LEAVE, 0.0)
        robot.set_arm(arm((LEAVE, LEAVE, MARK), amplitude=rest, omega=rest))
        request = SetFixture.Request(fixture="human_arm", position=MARK)
        robot.ask(SetFixture, "sim_rig/set_fixture", request)
        self._holds = True

        def there() -> bool:
            now = self._record.now
            return abs(now.height - MARK) < _AT_MARK and abs(now.speed) < _RESTING

        if not robot.met(there, 5.0):
            now = self._record.now
            raise RobotError(
                f"the handle does not come to {MARK:g} m: {now.height:.4f} m, {now.speed:.3f} m/s"
                f"{robot.complaints_text()}"
            )

    def plane_to_mark(self) -> None:
        """Hold the handle on the plane's reference mark. Raises RobotError if it stays off."""
        robot = self._robot
        robot.set_arm(arm((0.0, 0.0, LEAVE), 0.2, amplitude=STILL, omega=STILL))

        def there() -> bool:
            now = self._record.now
            return math.hypot(*now.plane) < _AT_PLANE_MARK and now.joint_speed < _RESTING_JOINT

        if not robot.met(there, _HOMING_S):
            now = self._record.now
            raise RobotError(
                f"the plane does not come to rest: {1e3 * math.hypot(*now.plane):.1f} mm from "
                f"its mark, {now.joint_speed:.2g} rad/s{robot.complaints_text()}"
            )

    def let_go(self) -> None:
        """Leave the handle alone, for taring."""
        self._robot.set_fixture("free")
        self._holds = False

    def take_hold(self) -> None:
        """Hold the handle at the reference mark again after `let_go`."""
        if not self._holds:
            self.to_mark()
