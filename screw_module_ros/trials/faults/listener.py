# SPDX-License-Identifier: Apache-2.0
"""Records the events on the rig and in the graph, in simulated time; publishes a game's set points.

The rig's true torque decides a row, not the torque that the nodes report.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from screw_module_msgs.msg import (
    AmplifierState,
    EncoderSample,
    EndpointState,
    PlanarState,
    SafetyState,
    SimTruth,
)

from screw_module_ros import graph
from screw_module_ros.nodes.support import topics
from screw_module_ros.nodes.support.inbox import Inbox
from screw_module_ros.operator.robot import Robot

NO_TORQUE = 5e-4
"""A smaller torque counts as zero, as it decays with the amplifier's pole [Nm]; 0.17 N at the
handle."""
NO_JOINT_TORQUE = 5e-3
"""The same for a joint of the plane [Nm]; 0.01 N at the handle."""
_KEPT = 20_000
_MIDDLE, _BEYOND = 0.18, 0.02  # middle of the travel, and the stops' compression [m]
_FRESH_NS = 300_000_000
_GAME_NS = 50_000_000
_ALARMS = (DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE)
_ALL = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=500,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
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


class Listener:
    """Subscribes to the topics that decide a row; publishes the set points of a game.

    It belongs to the thread of `robot`, which calls `look` at least each 0.5 s of simulated time.
    setpoint: (x, y, z, vx, vy, vz) of the game [m], [m/s]; None = no game.
    """

    def __init__(self, robot: Robot):
        self.setpoint: tuple[float, ...] | None = None
        self._homed = False
        self._robot, self._clock = robot, robot.clock
        self._game_due_ns = 0
        self._moments: deque[Moment] = deque(maxlen=_KEPT)
        self._arrivals: dict[str, int] = {}
        self._statuses: dict[tuple[str, bytes, str], None] = {}
        self._reasons: dict[str, None] = {}
        self._enabled: dict[str, bool] = {}
        self._ever_enabled: set[str] = set()
        self._disabled_at: dict[str, float] = {}  # the first time since `mark`
        self._inbox = Inbox(robot.node, robot.clock)
        self._wires: list[tuple[Callable[[], Any], Callable[[Any], None]]] = []
        self._listen(SimTruth, graph.TRUTH, self._truth)
        self._listen(DiagnosticArray, graph.DIAGNOSTICS, self._diagnosed)
        self._listen(SafetyState, graph.SAFETY_STATE, self._safety)
        self._listen(AmplifierState, graph.AMPLIFIER_STATE, self._note_enabled("amplifier"))
        self._listen(PlanarState, graph.MANUS_STATE, self._note_enabled("manus"))
        self._listen(EndpointState, graph.ENDPOINT_STATE, self._endpoint, topics.NEWEST)
        self._listen(EncoderSample, graph.ENCODER_DECIMATED, self._sample, topics.SAMPLE)
        self._listen(WrenchStamped, graph.WRENCH, self._wrench, topics.NEWEST)

    def _listen(self, kind: type, topic: str, note: Callable, profile: QoSProfile = _ALL) -> None:
        self._wires.append((self._inbox.subscribe(kind, topic, profile), note))

    def close(self) -> None:
        """Remove the subscriptions."""
        self._inbox.close()

    def look(self) -> None:
        """Take the waiting messages, and publish the game's set point when it is due."""
        for take, note in self._wires:
            while (message := take()) is not None:
                note(message)
        now_ns = self._clock.now_ns()
        if self.setpoint is not None and now_ns >= self._game_due_ns:
            self._game_due_ns = now_ns + _GAME_NS
            self._robot.set_setpoint(*self.setpoint[:3], self.setpoint[3:])

    # Messages ------------------------------------------------------------------------------

    def _arrived(self, what: str) -> None:
        self._arrivals[what] = self._clock.now_ns()

    def _truth(self, truth: SimTruth) -> None:
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
        self._arrived("sim_rig")

    def _diagnosed(self, array: DiagnosticArray) -> None:
        for status in array.status:
            node = status.name.rpartition("/")[2]
            self._statuses[node, status.level, status.message] = None
            self._arrived(f"diagnostics of {node}")

    def _safety(self, state: SafetyState) -> None:
        self._reasons.update(dict.fromkeys(state.reasons))

    def _note_enabled(self, node: str):
        def note(state: AmplifierState | PlanarState) -> None:
            self._enabled[node] = state.enabled
            self._arrived(node)
            if state.enabled:
                self._ever_enabled.add(node)
            else:
                self._disabled_at.setdefault(node, seconds(state.header.stamp))

        return note

    def _endpoint(self, _: EndpointState) -> None:
        self._arrived("endpoint_state")

    def _sample(self, sample: EncoderSample) -> None:
        # An operator homes if the position is outside the travel, even if the encoder is homed.
        self._homed = sample.homed and abs(sample.position - _MIDDLE) < _MIDDLE + _BEYOND
        self._arrived("encoder")

    def _wrench(self, _: WrenchStamped) -> None:
        self._arrived("force_sensor")

    # Results -------------------------------------------------------------------------------

    @property
    def homed(self) -> bool:
        """Whether the encoder reports that it is homed, and the report is fresh."""
        return self._homed and self.fresh("encoder")

    @property
    def time(self) -> float:
        """Present simulated time [s]."""
        return self._clock.now_ns() * 1e-9

    def mark(self) -> float:
        """Forget the reports so far; return the present simulated time [s]."""
        self.look()
        self._statuses.clear()
        self._reasons.clear()
        self._ever_enabled.clear()
        self._disabled_at.clear()
        return self.time

    def forget_enabled(self) -> None:
        """Forget which drives were enabled so far."""
        self.look()
        self._ever_enabled.clear()

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

    def fresh(self, what: str) -> bool:
        """Return whether a node's topic (or `diagnostics of NODE`) is fresh."""
        return self.silent_for(what) < _FRESH_NS * 1e-9

    def silent_for(self, what: str) -> float:
        """Return the time since the last message [s], infinity without any."""
        self.look()
        if what not in self._arrivals:
            return math.inf
        return (self._clock.now_ns() - self._arrivals[what]) * 1e-9

    def alarms(self) -> dict[str, list[str]]:
        """Return the messages of all diagnostics entries above OK since `mark`, by node."""
        self.look()
        found: dict[str, list[str]] = {}
        for node, level, message in self._statuses:
            if level in _ALARMS:
                found.setdefault(node, []).append(message)
        return found

    def reasons(self) -> list[str]:
        """Return all reasons of safety_state since `mark`."""
        self.look()
        return list(self._reasons)

    def enabled(self, node: str) -> bool:
        """Return whether `amplifier` or `manus` reports enabled now; a silent node is not."""
        return self.fresh(node) and self._enabled.get(node, False)

    def ever_enabled(self) -> set[str]:
        """Return the nodes that were enabled at any time since `mark` or `forget_enabled`."""
        self.look()
        return set(self._ever_enabled)

    def disabled_at(self) -> dict[str, float]:
        """Return the nodes that were not enabled since `mark`, with the first such time [s]."""
        self.look()
        return dict(self._disabled_at)


def seconds(stamp: Any) -> float:
    """Return a message's stamp in simulated time [s]."""
    return stamp.sec + stamp.nanosec * 1e-9
