# SPDX-License-Identifier: Apache-2.0
"""One row of the catalogue: a fault, who must notice it, how soon, and the recovery."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from screw_module_ros.control.modes import MODE_NAMES

if TYPE_CHECKING:
    from .testbed import Testbed

Act = Callable[["Testbed"], object]
"""What is done to a testbed. Raises Failed when the robot's answer breaks the promise."""

# Safe states.
OFF = "both torques zero"
VERTICAL_OFF = "vertical torque zero, plane works on"
GOES_ON = "goes on"
EITHER = "goes on, or both torques zero"
SAFE_STATES = {
    OFF: "torque of all axes zero, drives disabled, coasting",
    VERTICAL_OFF: "vertical torque zero, coasting; the plane works on",
    GOES_ON: "works on, no drive goes off or silent and no torque limit is exceeded",
    EITHER: "works on so, or stops in good order: it depends on chance",
}

MISSED = "amplifier/clear_fault if it missed commands"
"""Of the recovery: the amplifier latches that before it hears of the supervisor's stop, or not."""


class Failed(Exception):
    """The row's promise was broken; the message says how."""


class Alarm(NamedTuple):
    """How the fault is reported.

    node: whose diagnostics entry, empty where it passes too soon for one; said: regular expression
    on its message, empty when the alarm is that its entry no longer comes; reason: regular
    expression on one of safety_state's reasons, empty when motion stays permitted.
    """

    node: str
    said: str
    reason: str = ""

    @property
    def text(self) -> str:
        """The alarm for people."""
        parts = [f"{self.node}: “{self.said}”" if self.said else f"{self.node}: no entry any more"]
        reason = [f"safety_state: “{self.reason}”"] if self.reason else []
        return "; ".join((parts if self.node else []) + reason)


def nothing(testbed: Testbed) -> None:
    """Do nothing: the fault is over by itself."""


class Row(NamedTuple):
    """One fault.

    name: stable id; fault: what is injected; within, plane_within: samples of the vertical chain
    after which the vertical axis and the plane may have no torque left, 0 where the robot goes on;
    watch: how long it is watched [s]; prepare, inject, back: before the robot is made ready, make
    it happen (and tell since when, in simulated time), take its cause away; apart: each node must
    be a process of its own, else `module` is one; limp: the drive works on without torque;
    recovery: what an operator does then, with each service he calls.
    """

    name: str
    group: str
    fault: str
    inject: Act
    alarm: Alarm | None
    recovery: str
    noticed_by: str
    within: int = 0
    plane_within: int = 0
    mode: int = 1
    safe: str = OFF
    back: Act = nothing
    prepare: Act = nothing
    watch: float = 0.2
    apart: bool = False
    limp: bool = False

    @property
    def mode_name(self) -> str:
        """Name of the control mode it happens in."""
        return MODE_NAMES[self.mode]


class Verdict(NamedTuple):
    """What came of a row.

    problem: why it failed, empty when it passed; stuck: the robot could not be brought back;
    vertical, plane: samples until no torque was left; step: largest force step on the patient's
    hand on recovery [N]; seconds, simulated: the row took, by wall clock and by the rig's [s].
    """

    name: str
    problem: str
    stuck: bool = False
    vertical: float = 0.0
    plane: float = 0.0
    step: float = 0.0
    seconds: float = 0.0
    alarm: str = ""
    reason: str = ""
    simulated: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether all was as the row says."""
        return not self.problem
