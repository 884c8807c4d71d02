# SPDX-License-Identifier: Apache-2.0
"""What happens on the rig and in the graph during a row, in simulated time, and its measures.

The rig's true torque decides a row, not the torque that the nodes report.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from row import PERIOD, Report
from screw_module_msgs.msg import AmplifierState, PlanarState, SafetyState, SimTruth

from screw_module_ros import graph
from screw_module_ros.nodes.support.inbox import Inbox
from screw_module_ros.operator.robot import Robot

DRIVES = {"amplifier", "manus"}
NO_TORQUE = 5e-4
"""A smaller torque counts as zero, as it decays with the amplifier's pole [Nm]; 0.17 N at the
handle."""
NO_JOINT_TORQUE = 5e-3
"""The same for a joint of the plane [Nm]; 0.01 N at the handle."""
LARGEST_TORQUE = 0.34
"""Torque of a command of 95 N, plus the linearization's 0.025 Nm [Nm]."""
LARGEST_JOINT_TORQUE = 26.0
"""Limit of the planar drives [Nm]."""
STEP_S = 0.025
"""A change of the force on the hand within this time is a step [s]."""
LARGEST_STEP = 5.0
"""Allowed change of the force on the resting hand within `STEP_S` [N]."""
_SILENT_S = 2.5  # a node without a diagnostics entry for this time counts as silent
_FRESH_S = 0.3
_KEPT = 20_000
_ALARMS = (DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE)
_ALL = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=500, reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)  # fmt: skip
"""Deep enough for all messages between two calls of `look`."""


class Moment(NamedTuple):
    """One sim/truth: simulated time [s], torque [Nm], joint torques [Nm], patient's force [N],
    height [m], speed [m/s], x and y [m], the faster joint's speed [rad/s]."""

    time: float
    torque: float
    joints: tuple[float, float]
    force: tuple[float, float, float]
    height: float
    speed: float
    plane: tuple[float, float]
    joint_speed: float


def vertical(moment: Moment) -> bool:
    """Return whether the vertical motor gives torque."""
    return abs(moment.torque) > NO_TORQUE


def plane(moment: Moment) -> bool:
    """Return whether a motor of the plane gives torque."""
    return max(map(abs, moment.joints)) > NO_JOINT_TORQUE


def torque_samples(
    moments: Sequence[Moment], begin: float, has_torque: Callable[[Moment], bool]
) -> float:
    """Return the number of samples from `begin` [s] to the last torque."""
    last = max((moment.time for moment in moments if has_torque(moment)), default=begin)
    return (last - begin) / PERIOD


def largest_step(moments: Sequence[Moment]) -> float:
    """Return the largest change of a component of the patient's force within STEP_S [N].

    The median of three samples removes a knock of 5 ms in the play between nut and handle.
    """
    largest, first = 0.0, 0
    times = [moment.time for moment in moments[1:-1]]
    forces = [_median(three) for three in zip(moments, moments[1:], moments[2:], strict=False)]
    for time_now, force in zip(times, forces, strict=True):
        while times[first] < time_now - STEP_S * 1.01:
            first += 1
        pairs = zip(forces[first], force, strict=True)
        largest = max(largest, *(abs(b - a) for a, b in pairs))
    return largest


def _median(three: Sequence[Moment]) -> tuple[float, ...]:
    return tuple(sorted(axis)[1] for axis in zip(*(one.force for one in three), strict=True))


class Record:
    """Subscribes to the topics that decide a row.

    It belongs to the thread of `robot`, which calls `look` at least each 0.5 s of simulated time.
    Since `mark`: statuses (node, level and message of each diagnostics entry), reasons (of
    safety_state), ever_enabled (drives), disabled_at (drives, with the first time that they were
    not enabled [s]).
    """

    def __init__(self, robot: Robot):
        self.statuses: dict[tuple[str, bytes, str], None] = {}
        self.reasons: dict[str, None] = {}
        self.ever_enabled: set[str] = set()
        self.disabled_at: dict[str, float] = {}
        self._clock = robot.clock
        self._moments: deque[Moment] = deque(maxlen=_KEPT)
        self._arrived_ns: dict[str, int] = {}
        self._enabled: dict[str, bool] = {}
        self._inbox = Inbox(robot.node, robot.clock)
        self._wires = [
            (self._inbox.subscribe(kind, topic, _ALL), note)
            for kind, topic, note in (
                (SimTruth, graph.TRUTH, self._on_truth),
                (DiagnosticArray, graph.DIAGNOSTICS, self._on_diagnostics),
                (SafetyState, graph.SAFETY_STATE, self._on_safety),
                (AmplifierState, graph.AMPLIFIER_STATE, self._on_amplifier),
                (PlanarState, graph.MANUS_STATE, self._on_plane),
            )
        ]

    def close(self) -> None:
        """Remove the subscriptions."""
        self._inbox.close()

    def look(self) -> None:
        """Take the waiting messages."""
        for take, note in self._wires:
            while (message := take()) is not None:
                note(message)

    def _on_truth(self, truth: SimTruth) -> None:
        self._moments.append(Moment(
            seconds(truth.header.stamp),
            truth.motor_torque,
            tuple(truth.joint_torque),
            (*truth.planar_force, truth.patient_force),
            truth.handle_position,
            truth.handle_velocity,
            tuple(truth.planar_position),
            max(map(abs, truth.joint_velocity)),
        ))  # fmt: skip
        self._arrived_ns["sim_rig"] = self._clock.now_ns()

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in array.status:
            node = status.name.rpartition("/")[2]
            self.statuses[node, status.level, status.message] = None
            self._arrived_ns[f"/{node}"] = self._clock.now_ns()

    def _on_safety(self, state: SafetyState) -> None:
        self.reasons.update(dict.fromkeys(state.reasons))

    def _on_amplifier(self, state: AmplifierState) -> None:
        self._on_drive("amplifier", state)

    def _on_plane(self, state: PlanarState) -> None:
        self._on_drive("manus", state)

    def _on_drive(self, node: str, state: Any) -> None:
        self._enabled[node] = state.enabled
        self._arrived_ns[node] = self._clock.now_ns()
        if state.enabled:
            self.ever_enabled.add(node)
        else:
            self.disabled_at.setdefault(node, seconds(state.header.stamp))

    # Results -------------------------------------------------------------------------------

    def mark(self) -> float:
        """Forget the reports so far; return the present simulated time [s]."""
        self.look()
        for noted in (self.statuses, self.reasons, self.ever_enabled, self.disabled_at):
            noted.clear()
        return self._clock.now_ns() * 1e-9

    @property
    def now(self) -> Moment | None:
        """The newest moment, None before the first."""
        self.look()
        return self._moments[-1] if self._moments else None

    def since(self, begin: float) -> list[Moment]:
        """Return the moments after the simulated time `begin` [s]."""
        self.look()
        found = []
        for moment in reversed(self._moments):
            if moment.time <= begin:
                break
            found.append(moment)
        return found[::-1]

    def enabled(self, node: str) -> bool:
        """Return whether `amplifier` or `manus` reports enabled now; a silent node is not."""
        return self.fresh(node) and self._enabled[node]

    def fresh(self, what: str) -> bool:
        """Return whether a drive's state, or the truth of `sim_rig`, is fresh."""
        self.look()
        return self._silent_for(what) < _FRESH_S

    def _silent_for(self, what: str) -> float:
        """Return the time since the last state of a drive, or entry of a /node [s]."""
        return (self._clock.now_ns() - self._arrived_ns.get(what, -math.inf)) * 1e-9

    def alarms(self, node: str) -> list[str]:
        """Return the messages of a node's diagnostics entries above OK since `mark`."""
        return [said for by, level, said in self.statuses if by == node and level in _ALARMS]

    def found(self, report: Report) -> tuple[str, str] | None:
        """Return the message and the reason that the report asks for; None while one is missing."""
        self.look()
        said = reason = ""
        if report.node and not report.said:
            if self._silent_for(f"/{report.node}") < _SILENT_S:
                return None
        elif report.node:
            said = _first(report.said, self.alarms(report.node))
        if report.reason:
            reason = _first(report.reason, self.reasons)
        missing = (report.said and not said) or (report.reason and not reason)
        return None if missing else (said, reason)

    def text(self) -> str:
        """Return all reports since `mark`, for the message of a row that failed."""
        alarms = [f"{node}: {said}" for node, level, said in self.statuses if level in _ALARMS]
        return f"alarms: {'; '.join(alarms)}; reasons: {'; '.join(self.reasons) or 'none'}"


def _first(pattern: str, texts) -> str:
    return next((text for text in texts if re.search(pattern, text)), "")


def seconds(stamp: Any) -> float:
    """Return a message's stamp in simulated time [s]."""
    return stamp.sec + stamp.nanosec * 1e-9
