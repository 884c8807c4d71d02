# SPDX-License-Identifier: Apache-2.0
"""One row of the catalogue: a fault, the node that must detect it, time limits, the recovery."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from screw_module_ros.control.modes import MODE_NAMES

if TYPE_CHECKING:
    from .testbed import Testbed

Act = Callable[["Testbed"], object]
"""An act on a testbed; returns the simulated time [s] or None. Raises Failed if the robot's answer
breaks the safety contract."""

# Safe states.
OFF = "both torques zero"
VERTICAL_OFF = "vertical torque zero, plane continues"
GOES_ON = "continues"
EITHER = "continues, or both torques zero"
SAFE_STATES = {
    OFF: "torque of all axes zero, drives disabled, coasting",
    VERTICAL_OFF: "vertical torque zero, coasting; the plane continues to work",
    GOES_ON: "continues to work; no drive goes off or silent, no torque limit is exceeded",
    EITHER: "continues to work or stops as above, by chance",
}

MISSED = "amplifier/clear_fault if it missed commands"
PLANE_BACK = (
    "mend it; manus/clear_fault, manus/home after a boot-up or 0.2 s of silence, reset, enable"
)
"""Part of a recovery: the amplifier may latch the missing commands before the supervisor's stop
reaches it."""


class Failed(Exception):
    """The robot broke the safety contract in this row; the message says how."""


class Alarm(NamedTuple):
    """Report of a fault.

    node: the node of the diagnostics entry, empty if the fault is too short for one; said: regular
    expression on its message, empty if the alarm is the absence of its entry; reason: regular
    expression on one of safety_state's reasons, empty if motion stays permitted.
    """

    node: str
    said: str
    reason: str = ""

    @property
    def text(self) -> str:
        """The alarm as text for the table."""
        parts = [f"{self.node}: “{self.said}”" if self.said else f"{self.node}: no entry any more"]
        reason = [f"safety_state: “{self.reason}”"] if self.reason else []
        return "; ".join((parts if self.node else []) + reason)


def nothing(testbed: Testbed) -> None:
    """Do nothing: the fault ends by itself."""


class Row(NamedTuple):
    """One fault.

    name: stable id; fault: description; within, plane_within: samples of the vertical chain after
    which the vertical axis and the plane must give no torque, 0 if the robot continues; watch:
    time of observation [s]; prepare: before the robot is made ready; inject: causes the fault and
    returns its simulated time; back: removes the cause; apart: each node in a process of its own,
    else the vertical axis as `module`; limp: the drive continues without torque; recovery: the
    operator's actions, with all services.
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
        """Name of the control mode during the fault."""
        return MODE_NAMES[self.mode]


class Verdict(NamedTuple):
    """Result of a row.

    problem: why it failed, empty if it passed; stuck: the robot did not recover; vertical, plane:
    samples until the torque was zero; step: largest force step on the patient's hand on recovery
    [N]; seconds, simulated: duration by wall clock and in simulated time [s]; alarm, reason: as
    reported.
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
        """Whether the robot behaved as the row requires."""
        return not self.problem
