# SPDX-License-Identifier: Apache-2.0
"""One row of the fault catalogue: a fault, who reports it, its time limits, the way back.

Times are in samples of the vertical chain (1 ms), after the safety contract.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from screw_module_ros.control.laws import names
from screw_module_ros.control.modes import IMPEDANCE
from screw_module_ros.graph import WHOLE, Entry

if TYPE_CHECKING:
    from fault_robot import FaultRobot

Act = Callable[["FaultRobot"], object]
"""An act on the robot; returns the simulated time of the fault [s] or None. Asserts what the robot
must answer."""

# Outcomes.
OFF, VERTICAL_OFF, GOES_ON, EITHER = "off", "vertical off", "goes on", "goes on or off"
OUTCOMES = {
    OFF: "torque of all axes zero, drives disabled, coasting",
    VERTICAL_OFF: "vertical torque zero, coasting; the plane continues to work",
    GOES_ON: "continues to work; no drive goes off or silent, no torque limit is exceeded",
    EITHER: "continues to work or stops as above, by chance",
}

# Services of an operator, in the order in which `bring_up` calls them.
HOME, TARE, PLANE_HOME = "encoder/home", "force_sensor/tare", "manus/home"
CLEAR, PLANE_CLEAR = "amplifier/clear_fault", "manus/clear_fault"
RESET, MODE = "supervisor/reset", "impedance_controller/set_mode"
ENABLE = ("amplifier/enable", "manus/enable")
STOPPED = (RESET, *ENABLE)
"""What ends any stop of the supervisor."""
MISSED = (CLEAR, *STOPPED)
"""The same where the amplifier may latch missing commands before the stop reaches it."""
PLANE_BACK = (PLANE_CLEAR, PLANE_HOME, *STOPPED)

LAW_OF_OTHERS = "laws_of_others:THE_ODD"
"""A law from outside the package that each robot has loaded, in a mode of its own."""

# Limits, in samples.
RATE = 1000.0  # of the vertical chain [Hz]; the plane runs at half of it
PERIOD = 1.0 / RATE  # [s]
PERIOD_NS = round(PERIOD * 1e9)
STALE = 5
"""Samples until a silent sensor or controller is detected."""
COMMAND = 20
"""Samples without an RPDO after which a drive drops its torque by itself."""
HEARTBEAT = 150
"""Samples in which three of a drive's heartbeats are missed."""
SAFETY = 100
"""Samples without safety_state after which the drives' nodes stop."""
LOST = 200
"""Samples after which the supervisor counts a silent node as lost."""
FROZEN = 500
"""Samples until a force sensor with a constant reading is detected."""
DYING = 8
"""Samples: the torque decays with the amplifier's pole; sim/truth has every second sample."""
VIA_SUPERVISOR = 40
"""Samples: a node reports a fault at 100 Hz, the supervisor decides at 50 Hz, and the drives' nodes
read its state each 4 ms."""
AT_ONCE = 2 + DYING
"""Samples: detected in the first sample, or in the first answer of a drive."""
SILENT = STALE + AT_ONCE
"""Samples until the absence of a sample is noticed."""
BY_SERVICE = 6 + DYING
"""Samples: the supervisor publishes at once, the drives' nodes read its state each 4 ms."""
BY_CHANCE = VIA_SUPERVISOR + 2 * DYING
"""Samples of a stop that is not sure to come, from the first drive that goes off."""
APART = 50 + 2 + DYING
"""Samples: two positions of one motion have differed for 50 ms."""
SLOW = 900
"""Samples until the hand is so slow that a shift of 5 mm exceeds the tolerance, at 70 mm/s."""


class Report(NamedTuple):
    """Report of a fault.

    node: of the diagnostics entry, empty if the fault is too short for one; said: regular
    expression on its message, empty if the report is the absence of its entry; reason: regular
    expression on one of safety_state's reasons, empty if motion stays permitted.
    """

    node: str
    said: str
    reason: str = ""

    @property
    def text(self) -> str:
        """The report as text for the table."""
        parts = [f"{self.node}: “{self.said}”" if self.said else f"{self.node}: no entry any more"]
        same = "the same" if self.reason == self.said else f"“{self.reason}”"
        reason = [f"safety_state: {same}"] if self.reason else []
        return "; ".join((parts if self.node else []) + reason)


def nothing(robot: FaultRobot) -> None:
    """Do nothing: the fault ends by itself."""


class Row(NamedTuple):
    """One fault.

    name: stable id; fault: description; report: None if nobody must report it; services: all that
    an operator may need afterwards; noticed_by: in words; within, plane_within: samples after which
    the vertical axis and the plane must give no torque, 0 if the robot continues; watch: time of
    observation [s]; prepare: before the robot is brought up; inject: causes the fault; mend:
    removes the cause; shared: the process that the nodes share, as of `graph.chosen`; limp: the
    drive continues without torque.

    shared is `graph.WHOLE` unless the row acts on a process, or needs what a foreign sender says on
    a topic that passes by calls within that one.
    """

    name: str
    group: str
    fault: str
    inject: Act
    report: Report | None
    services: tuple[str, ...]
    noticed_by: str
    within: int = 0
    plane_within: int = 0
    mode: int = IMPEDANCE
    outcome: str = OFF
    mend: Act = nothing
    prepare: Act = nothing
    watch: float = 0.2
    shared: Entry | None = WHOLE
    limp: bool = False

    @property
    def mode_name(self) -> str:
        """Name of the control mode during the fault."""
        return names()[self.mode]

    @property
    def longest(self) -> float:
        """The longer time limit [s]."""
        return max(self.within, self.plane_within) * PERIOD


def goes_on(
    name: str, group: str, fault: str, act: Act, who: str, mend: Act = nothing, **more
) -> Row:
    """Return a row in which the robot continues and needs no recovery."""
    return Row(name, group, fault, act, None, (), who, mend=mend, outcome=GOES_ON, **more)
