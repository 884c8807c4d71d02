# SPDX-License-Identifier: Apache-2.0
"""The fixture of the handle during a trial: the simulated rig's fixtures, or an operator.

The user does the mounting (stage, locked rotor, hand): a wrong fixture is refused, with the way
out. The trial controls a mounted stage or hand.

The zero of the transducer is measured with the handle untouched and the pin in, so that the nut
does not move. A rotor locked on the transducer is unloaded as soon as the torque is off.
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
    """Interface of a fixture. All methods may raise RobotError.

    simulated: services operate the fixture, without an operator.
    """

    simulated: bool

    def require(self, fixture: str) -> None:
        """Raise NotPossible, with the way out, unless the handle is mounted in this fixture."""

    def mounted(self) -> str:
        """Return the mounted fixture, empty if unknown."""

    def unload(self) -> None:
        """Bring the handle to rest, untouched."""

    def stage_at(self, height: float, upside_down: bool) -> None:
        """Have the stage hold the handle at rest at a height [m]."""

    def stage_hold(self) -> None:
        """Have the stage hold the handle where it is, after `unload`."""

    def stage_go(self, speed: float, end: float) -> None:
        """Let the stage move at a speed, up positive [m/s], to beyond the height `end` [m]."""

    def stage_passed(self, end: float) -> bool:
        """Return whether the stage has passed `end` [m]."""

    def stage_began_ns(self) -> float | None:
        """Return the time at which the stage began to move [ns], None if unknown."""

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
        """Undo `unload`: restore the former fixture, at rest at the present height."""

    def put_back(self) -> None:
        """Restore the former state of pin and mounting, at rest."""

    def close(self) -> None:
        """Remove the subscriptions."""


def fixture_of(
    rig_seen: bool,
    robot: Robot,
    confirmed: threading.Event,
    say: Callable[[str], None],
    newest: Callable[[], Any],
) -> Fixture:
    """Return the rig's fixture if the rig was detected, else the operator's.

    rig_seen: see `rig_seen.sees_rig`; newest: returns the newest EncoderSample, None before the
    first.
    """
    if rig_seen:
        return RigFixture(robot)
    return OperatorFixture(robot, confirmed, say, newest)
