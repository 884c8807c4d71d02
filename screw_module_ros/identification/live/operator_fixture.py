# SPDX-License-Identifier: Apache-2.0
"""An operator in place of the rig's services (see `fixture.Fixture`)."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Any

from screw_module_ros.identification.trials import Arm, MotionTrial
from screw_module_ros.operator.client import RobotError
from screw_module_ros.operator.robot import Robot

from .graph import topic_of

_CONFIRM_S = 1800.0
_RETURN_S = 1.0
_NEAR = 2e-4  # [m]

Say = Callable[[str], None]


class OperatorFixture:
    """Requests actions of an operator, who confirms each with `~/confirm`."""

    simulated = False

    def __init__(
        self, robot: Robot, confirmed: threading.Event, say: Say, newest: Callable[[], Any]
    ):
        self._robot, self._confirmed, self._say = robot, confirmed, say
        self._newest = newest
        self._mounted = ""
        self._speed = 0.0

    def _ask(self, what: str) -> None:
        self._confirmed.clear()
        service = topic_of(self._robot, "characterize/confirm")
        self._say(f"PLEASE: {what}; then ros2 service call {service} std_srvs/srv/Trigger")
        if not self._robot.met(self._confirmed.is_set, _CONFIRM_S):
            raise RobotError(f"nobody confirmed within {_CONFIRM_S / 60:.0f} minutes: {what}")

    def require(self, fixture: str) -> None:
        """Request the mounting and its confirmation, once."""
        if self._mounted != fixture:
            self._ask({
                "stage": "mount the positioning stage, lock pin out",
                "locked_rotor": "take the motor off the screw and lock its rotor to the transducer",
                "human_arm": "let a healthy person hold the handle, lock pin out",
            }[fixture])  # fmt: skip
            self._mounted = fixture

    def unload(self) -> None:
        """Request the release of the handle."""
        self._ask("let go of the handle, or take it off the stage, and leave it at rest")

    def stage_at(self, height: float, upside_down: bool) -> None:
        """Request the handle on the stage at a height [m]."""
        over = ", the module upside down" if upside_down else ", the module upright"
        self._ask(f"put the handle on the stage at {1e3 * height:.0f} mm{over}, at rest")

    def stage_hold(self) -> None:
        """Request the connection of the handle to the stage at its present height."""
        self._ask("fix the handle to the stage as it hangs")

    def stage_go(self, speed: float, end: float) -> None:
        """Tell the operator to start the stage."""
        self._speed = speed
        self._say(f"PLEASE: run the stage to {1e3 * end:.0f} mm at {1e3 * speed:g} mm/s")

    def stage_passed(self, end: float) -> bool:
        """Return whether the nut has passed `end` [m]."""
        sample = self._newest()
        direction = math.copysign(1.0, self._speed)
        return sample is not None and direction * (sample.position - end) > -_NEAR

    def stage_began_ns(self) -> float | None:
        """Return None: only the position of the nut is known."""
        return None

    def stage_halt(self) -> None:
        """Tell the operator to stop the stage."""
        self._say("PLEASE: stop the stage")

    def hand_at(self, hand: Arm, centre: float) -> None:
        """Request that the person holds the handle at a height [m]."""
        self._ask(f"hold the handle at rest at {1e3 * centre:.0f} mm")

    def hand_moves(self, trial: MotionTrial) -> None:
        """Tell the person to move."""
        self._say(
            f"PLEASE: move the handle up and down by {1e3 * trial.amplitude:.0f} mm about "
            f"{1e3 * trial.centre:.0f} mm, once in {2.0 * math.pi / trial.omega:.1f} s"
        )

    def hand_lets_go(self) -> None:
        """Tell the person to let go."""
        self._say("PLEASE: let the handle go")

    def hand_rests(self, centre: float) -> None:
        """Tell the person to stop."""
        self._say("PLEASE: hold the handle at rest")
        self._robot.pause(_RETURN_S)

    def mounted(self) -> str:
        """Return what the operator confirmed."""
        return self._mounted

    def reload(self) -> None:
        """Do nothing: the next trial requests its fixture."""

    def put_back(self) -> None:
        """Leave the mounting to the operator."""

    def close(self) -> None:
        """There is nothing to close."""
