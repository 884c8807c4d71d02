# SPDX-License-Identifier: Apache-2.0
"""The hot loop of `characterize`: takes every sample, notes it, answers it in a torque trial.

The node's main thread runs `step`; everything else is called by the experiment's thread, which
hands over one object at a time and reads what comes back.
"""

from __future__ import annotations

import threading

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from screw_module_msgs.msg import EncoderSample, ForceCommand, ForceSample, ImpedanceState

from screw_module_ros import graph
from screw_module_ros.control.modes import OFF
from screw_module_ros.control.watch import WatchSettings
from screw_module_ros.loop.ticker import BETWEEN_TICKS_NS, Ticker
from screw_module_ros.nodes.support.due import Due
from screw_module_ros.nodes.support.hot_topics import Inbox, Outlet
from screw_module_ros.nodes.support.module_node import ModuleNode
from screw_module_ros.nodes.support.topics import offered

from .samples import Recording
from .torque_source import TorqueSource

# Unlike a controller a recorder wants the samples that came while it was kept from running, too.
EVERY_SAMPLE = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=50,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
_STATE_RATE = graph.TOPICS[graph.CONTROLLER_STATE].rate
_LOOK_NS = 5_000_000  # between looks for samples that nobody waits for
_SILENT_NS = 2_000_000
_PASS_S = 2.0
_IDLE_S = 0.05


class LiveLoop:
    """Encoder and force samples in, recordings out; in the controller's place also force commands.

    sample: the newest EncoderSample, None before the first.
    """

    def __init__(self, node: ModuleNode):
        self.sample: EncoderSample | None = None
        self._node, self._clock = node, node.clock
        self._inbox = inbox = Inbox(node, node.clock)
        self._takes = (
            inbox.subscribe(EncoderSample, graph.ENCODER, EVERY_SAMPLE, wakes=True),
            inbox.subscribe(ForceSample, graph.FORCE, EVERY_SAMPLE, wakes=True),
            inbox.subscribe(ForceCommand, graph.FORCE_COMMAND, EVERY_SAMPLE),
        )
        self._ticker = Ticker(node.clock, _LOOK_NS, BETWEEN_TICKS_NS)
        self._awake = threading.Event()
        self._recording: Recording | None = None
        self._source: TorqueSource | None = None
        self._outlets: tuple[Outlet, Outlet] | None = None
        self._command = ForceCommand(mode=OFF)
        self._state = ImpedanceState(mode=OFF, calibration="characterize")
        self._state.header.frame_id = "manus_base"
        self._state_due = Due(_STATE_RATE)
        self._passes = 0

    # Main thread ---------------------------------------------------------------------------

    def step(self) -> None:
        """One pass: wait for samples, at most some periods, and do with them what is wanted."""
        if not self._awake.is_set():
            self._clock.idle()
            if not self._awake.wait(_IDLE_S):
                return
        if self._source is None:
            self._ticker.sleep()
        else:
            self._inbox.wait(self._clock.now_ns() + _SILENT_NS)
        recording, source = self._recording, self._source
        self._take_forces(recording, source)
        newest = self._take_encoder(recording)
        if source is not None:
            self._answer(source, newest, self._clock.now_ns())
        self._take_commands(recording)
        self._passes += 1

    def _take_forces(self, recording: Recording | None, source: TorqueSource | None) -> None:
        while (force := self._takes[1]()) is not None:
            if recording is not None:
                recording.note_force(force)
            if source is not None:
                source.force(force, self._clock.now_ns())  # one that came just now is not ahead

    def _take_encoder(self, recording: Recording | None) -> EncoderSample | None:
        newest = None
        while (sample := self._takes[0]()) is not None:
            newest = sample
            if recording is not None:
                recording.note_encoder(sample)
        if newest is not None:
            self.sample = newest
        return newest

    def _take_commands(self, recording: Recording | None) -> None:
        while (command := self._takes[2]()) is not None:
            if recording is not None and self._source is None:
                recording.note_command(command)

    def _answer(self, source: TorqueSource, sample: EncoderSample | None, now: int) -> None:
        force = source.answer(sample, now) if sample is not None else None
        if force is not None:
            self._send(sample, force)
            if self._recording is not None:
                self._recording.note_command(self._command)
        elif source.idle(now) and self.sample is not None:
            self._send(self.sample, 0.0)
        if self._state_due(now):
            self._publish_state(source)

    def _send(self, sample: EncoderSample, force: float) -> None:
        command = self._command
        command.stamp = sample.stamp
        command.sequence, command.monotonic_ns = sample.sequence, sample.monotonic_ns
        command.force = force
        self._outlets[0].publish(command)

    def _publish_state(self, source: TorqueSource) -> None:
        message, sample = self._state, self.sample
        self._node.stamp(message.header)
        message.faulted, message.reason = bool(source.fault), source.fault
        message.active = source.out != 0.0
        message.commanded_force = source.out
        if sample is not None:
            message.position, message.velocity = sample.position, sample.velocity
        self._outlets[1].publish(message)

    def close(self) -> None:
        """Leave the topics; the loop no longer runs."""
        self._inbox.close()
        self._close_outlets()

    # The experiment's thread ---------------------------------------------------------------

    def wake(self) -> None:
        """Take samples from now on."""
        self.sample = None
        self._awake.set()

    def sleep(self) -> None:
        """Take no more samples."""
        self._awake.clear()

    def record(self, recording: Recording | None) -> None:
        """Note the samples from now on, None: no longer."""
        self._recording = recording

    def take_place(self, watch: WatchSettings, period_ns: int) -> TorqueSource:
        """Be the one who commands the amplifier, for now with zero; return the source to ask."""
        node, clock = self._node, self._clock
        self._outlets = (
            Outlet(node, clock, *offered(graph.FORCE_COMMAND)),
            Outlet(node, clock, *offered(graph.CONTROLLER_STATE)),
        )
        self._source = source = TorqueSource(watch, period_ns)
        return source

    def halt(self) -> None:
        """Ask for zero from the next sample on, and record no more."""
        if self._source is not None:
            self._source.halt()
        self._recording = None

    def leave_place(self) -> None:
        """Send no more commands and give the topics back."""
        self._source = None
        seen = self._passes  # two passes later the loop has surely seen it
        self._clock.wait_for(lambda: self._passes >= seen + 2, _PASS_S)
        self._close_outlets()

    def _close_outlets(self) -> None:
        for outlet in self._outlets or ():
            outlet.close()
        self._outlets = None
