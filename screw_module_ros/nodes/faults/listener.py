# SPDX-License-Identifier: Apache-2.0
"""What happened on the rig and in the graph, in simulated time, and the game that is being played.

The rig's own torque decides, not what the nodes say about it.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from screw_module_msgs.msg import (
    AmplifierState,
    EncoderSample,
    EndpointSetpoint,
    ForceSample,
    PlanarState,
    SafetyState,
    SimTruth,
)

from ..support import qos
from ..support.transport import choose_transport

NO_TORQUE = 5e-4
"""Less is no torque: the amplifier's pole dies away [Nm]; 0.17 N at the handle."""
NO_JOINT_TORQUE = 5e-3
"""The same for a joint of the plane [Nm]; 0.01 N at the handle."""
_KEPT = 20_000
_FRESH_NS = 300_000_000
_GAME_S = 0.05
_ALARMS = (DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE)


class Moment(NamedTuple):
    """One sim/truth: simulated time [s], torque [Nm], joint torques, patient's force [N]."""

    time: float
    torque: float
    joints: tuple[float, float]
    force: tuple[float, float, float]
    height: float
    speed: float
    plane: tuple[float, float]
    joint_speed: float


class Listener:
    """Subscribes to everything a row is judged by; publishes the set points of a game.

    setpoint: (x, y, z, vx, vy, vz) of the game [m], [m/s]; None = no game.
    """

    def __init__(self):
        self.setpoint: tuple[float, ...] | None = None
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._moments: deque[Moment] = deque(maxlen=_KEPT)
        self._arrivals: dict[str, int] = {}
        self._told: dict[tuple[str, bytes, str], None] = {}
        self._reasons: dict[str, None] = {}
        self._enabled: dict[str, bool] = {}
        self._ever_enabled: set[str] = set()
        self._disabled_at: dict[str, float] = {}  # the first time since `mark`
        self.homed = False
        self.slipped = 0  # ms of simulated time the rig gave up because the machine was busy
        choose_transport()
        self._context = Context()
        self._context.init()
        self.node = Node("fault_listener", context=self._context)
        self._subscribe()
        self._game = self.node.create_publisher(EndpointSetpoint, "setpoint", qos.COMMAND)
        self.node.create_timer(_GAME_S, self._play)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _subscribe(self) -> None:
        listen = self.node.create_subscription
        listen(SimTruth, "sim/truth", self._truth, qos.STATE)
        listen(DiagnosticArray, "/diagnostics", self._diagnosed, 100)
        listen(SafetyState, "safety_state", self._safety, 50)
        listen(AmplifierState, "screw/amplifier_state", self._note_enabled("amplifier"), qos.STATE)
        listen(PlanarState, "manus/state", self._note_enabled("manus"), qos.STATE)
        listen(EncoderSample, "screw/encoder", self._encoder, qos.SAMPLE)
        listen(ForceSample, "handle/force", self._force, qos.SAMPLE)

    def close(self) -> None:
        """Leave the graph."""
        self._closing.set()
        self._executor.wake()
        self._thread.join(timeout=2.0)
        self._executor.shutdown(timeout_sec=2.0)
        self.node.destroy_node()
        self._context.try_shutdown()

    def _serve(self) -> None:
        while not self._closing.is_set():
            self._executor.spin_once(timeout_sec=0.2)

    # What comes in -------------------------------------------------------------------------

    def _truth(self, truth: SimTruth) -> None:
        moment = Moment(
            truth.simulated_time,
            truth.motor_torque,
            tuple(truth.joint_torque),
            (*truth.planar_force, truth.patient_force),
            truth.handle_position,
            truth.handle_velocity,
            tuple(truth.planar_position),
            max(map(abs, truth.joint_velocity)),
        )
        self.slipped = truth.slipped
        with self._lock:
            if self._moments and moment.time < self._moments[-1].time:
                self._moments.clear()  # the rig was started anew
            self._moments.append(moment)
            self._arrivals["sim_rig"] = time.monotonic_ns()

    def _diagnosed(self, array: DiagnosticArray) -> None:
        with self._lock:
            for status in array.status:
                node = status.name.rpartition("/")[2]
                self._told[node, status.level, status.message] = None
                self._arrivals[f"diagnostics of {node}"] = time.monotonic_ns()

    def _safety(self, state: SafetyState) -> None:
        with self._lock:
            self._reasons.update(dict.fromkeys(state.reasons))

    def _note_enabled(self, node: str):
        def note(state) -> None:
            with self._lock:
                self._enabled[node] = state.enabled
                self._arrivals[node] = time.monotonic_ns()
                if state.enabled:
                    self._ever_enabled.add(node)
                elif self._moments:
                    self._disabled_at.setdefault(node, self._moments[-1].time)

        return note

    def _encoder(self, sample: EncoderSample) -> None:
        self.homed = sample.homed
        self._arrivals["encoder"] = time.monotonic_ns()

    def _force(self, sample: ForceSample) -> None:
        self._arrivals["force_sensor"] = time.monotonic_ns()

    def _play(self) -> None:
        if self.setpoint is None:
            return
        message = EndpointSetpoint()
        message.header.frame_id = "manus_base"
        message.header.stamp = self.node.get_clock().now().to_msg()
        x, y, z, vx, vy, vz = self.setpoint
        message.position.x, message.position.y, message.position.z = x, y, z
        message.velocity.x, message.velocity.y, message.velocity.z = vx, vy, vz
        self._game.publish(message)

    # What it adds up to --------------------------------------------------------------------

    def mark(self) -> float:
        """Forget what was told so far; return the simulated time of now [s]."""
        with self._lock:
            self._told.clear()
            self._reasons.clear()
            self._ever_enabled.clear()
            self._disabled_at.clear()
            return self._moments[-1].time if self._moments else 0.0

    def forget_enabled(self) -> None:
        """Forget who was enabled so far."""
        with self._lock:
            self._ever_enabled.clear()

    @property
    def now(self) -> Moment | None:
        """The newest moment, None before the first."""
        with self._lock:
            return self._moments[-1] if self._moments else None

    def since(self, begin: float) -> list[Moment]:
        """Return the moments after the simulated time `begin` [s]."""
        with self._lock:
            found = []
            for moment in reversed(self._moments):
                if moment.time <= begin:
                    break
                found.append(moment)
        return found[::-1]

    def fresh(self, what: str) -> bool:
        """Return whether a node's topic (or `diagnostics of NODE`) was heard just now."""
        return time.monotonic_ns() - self._arrivals.get(what, 0) < _FRESH_NS

    def silent_for(self, what: str) -> float:
        """Return how long nothing has been heard [s]."""
        return (time.monotonic_ns() - self._arrivals.get(what, 0)) * 1e-9

    def alarms(self) -> dict[str, list[str]]:
        """Return the messages of every diagnostics entry above OK since `mark`, by node."""
        found: dict[str, list[str]] = {}
        with self._lock:
            for node, level, message in self._told:
                if level in _ALARMS:
                    found.setdefault(node, []).append(message)
        return found

    def reasons(self) -> list[str]:
        """Return every reason of safety_state since `mark`."""
        with self._lock:
            return list(self._reasons)

    def enabled(self, node: str) -> bool:
        """Return whether `amplifier` or `manus` says so now; a silent one is not."""
        return self.fresh(node) and self._enabled.get(node, False)

    def ever_enabled(self) -> set[str]:
        """Return who was enabled at some time since `mark` or `forget_enabled`."""
        with self._lock:
            return set(self._ever_enabled)

    def disabled_at(self) -> dict[str, float]:
        """Return who was not enabled since `mark`, and since which simulated time [s]."""
        with self._lock:
            return dict(self._disabled_at)

