# SPDX-License-Identifier: Apache-2.0
"""What holds the handle during a trial: the simulated rig's fixtures, or an operator.

Mounting (stage, locked rotor, hand) is never done for the user: the wrong fixture is refused, with
the way out. What stage and hand do once mounted belongs to the trial.

The transducer's zero is taken with the handle untouched and the pin in, so that the nut stays where
it is. The rotor locked on the transducer is unloaded as soon as the torque is off.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Protocol

from screw_module_ros.identification.trials import Arm, MotionTrial
from screw_module_ros.operator.robot import Robot

from .operator_fixture import OperatorFixture
from .rig_fixture import RigFixture


class Fixture(Protocol):
    """What the bench needs of the far side of the handle. All may raise RobotError.

    simulated: services do everything, no operator is asked.
    """

    simulated: bool

    def require(self, fixture: str) -> None:
        """Raise NotPossible with the way out when the handle is mounted otherwise."""

    def mounted(self) -> str:
        """Return what holds the handle, empty when unknown."""

    def unload(self) -> None:
        """Have the handle at rest and untouched."""

    def stage_at(self, height: float, upside_down: bool) -> None:
        """Have the stage hold the handle at rest at a height [m]."""

    def stage_hold(self) -> None:
        """Have the stage hold the handle where it is, after `unload`."""

    def stage_go(self, speed: float, end: float) -> None:
        """Let the stage move at a speed, up positive [m/s], to beyond the height `end` [m]."""

    def stage_passed(self, end: float) -> bool:
        """Return whether the stage has come to `end` [m]."""

    def stage_began_ns(self) -> float | None:
        """Return when the stage began to move [ns] by the clock; None where it is unknown."""

    def stage_halt(self) -> None:
        """Stop the stage where it is."""

    def hand_at(self, hand: Arm, centre: float) -> None:
        """Have the hand rest at a height [m]."""

    def hand_moves(self, trial: MotionTrial) -> None:
        """Let the hand move up and down as the trial says."""

    def hand_lets_go(self) -> None:
        """Have the hand let the handle go where it is."""

    def hand_rests(self, centre: float) -> None:
        """Let the hand come back and rest at a height [m]."""

    def reload(self) -> None:
        """Undo `unload`, with what held the handle before at rest where it is."""

    def put_back(self) -> None:
        """Leave pin and mounting as they were found, everything at rest."""

    def close(self) -> None:
        """Leave the graph."""


def fixture_of(
    rig_seen: bool,
    robot: Robot,
    confirmed: threading.Event,
    say: Callable[[str], None],
    newest: Callable[[], Any],
) -> Fixture:
    """Return the rig's fixture where the rig was seen at work, else the operator's.

    rig_seen: see `rig_seen.sees_rig`; newest: returns the newest EncoderSample, None before the
    first.
    """
    if rig_seen:
        return RigFixture(robot)
    return OperatorFixture(robot, confirmed, say, newest)
