# SPDX-License-Identifier: Apache-2.0
"""The hot loop of `characterize`: receives and records every sample.

In a torque trial it is the vertical loop, with a `TorqueSource` as its controller. The node's main
thread runs `step`; the experiment's thread calls all other methods. The threads exchange single
object references.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from screw_module_msgs.msg import EncoderSample, ForceCommand, ForceSample, ImpedanceState

from screw_module_ros import graph
from screw_module_ros.control.modes import OFF
from screw_module_ros.loop.ticker import BETWEEN_TICKS_NS, Ticker
from screw_module_ros.loop.vertical import Parts, VerticalLoop, Wires
from screw_module_ros.nodes.support.inbox import Inbox, Outlet
from screw_module_ros.nodes.support.node import Node
from screw_module_ros.nodes.support.states import Due
from screw_module_ros.nodes.support.topics import offered
from screw_module_ros.safety.checks import WatchSettings

from .samples import Recording
from .torque_source import Output, TorqueSource

# Unlike a controller, a recorder also needs the samples that arrived while it could not run.
EVERY_SAMPLE = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=50,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
_STATE_RATE = graph.TOPICS[graph.CONTROLLER_STATE].rate
_LOOK_NS = 5_000_000  # period of polling without a torque trial
_PASS_S = 2.0
_IDLE_S = 0.05


class LiveLoop:
    """Records encoder and force samples; in the controller's place it also publishes commands.

    sample: the newest EncoderSample, None before the first.
    """

    def __init__(self, node: Node):
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
        self._loop: VerticalLoop | None = None
        self._outlets: tuple[Outlet, Outlet] | None = None
        self._command = ForceCommand(mode=OFF)
        self._state = ImpedanceState(mode=OFF, calibration="characterize")
        self._state.header.frame_id = "manus_base"
        self._state_due = Due(_STATE_RATE)
        self._passes = 0

    # Main thread ---------------------------------------------------------------------------

    def step(self) -> None:
        """One pass: wait for samples, at most some periods, record them, or run the torque loop."""
        if not self._awake.is_set():
            self._clock.idle()
            if not self._awake.wait(_IDLE_S):
                return
        source, loop = self._source, self._loop
        if source is None:
            self._ticker.sleep()
            self._next_force(0)
            self._next_sample(0)
        else:
            loop.step(Parts(controller=source))
        self._take_commands()
        self._passes += 1

    def _next_force(self, until_ns: int) -> ForceSample | None:
        return self._noted(self._takes[1], Recording.note_force, until_ns)

    def _next_sample(self, until_ns: int) -> EncoderSample | None:
        newest = self._noted(self._takes[0], Recording.note_encoder, until_ns)
        self.sample = newest or self.sample
        return newest

    def _noted(
        self, take: Callable[[], Any], note: Callable[[Recording, Any], None], until_ns: int
    ) -> Any:
        """Record all waiting samples of a topic; return the newest, waiting until a time [ns]."""
        if until_ns:
            self._inbox.wait(until_ns)
        newest = None
        while (sample := take()) is not None:
            newest = sample
            recording = self._recording  # once: the experiment's thread may end it meanwhile
            if recording is not None:
                note(recording, sample)
        return newest

    def _take_commands(self) -> None:
        while (command := self._takes[2]()) is not None:
            recording = self._recording
            if recording is not None and self._source is None:
                recording.note_command(command)

    def _publish_command(self, sample: EncoderSample, output: Output, mode: int) -> None:
        command = self._command
        command.stamp = sample.stamp
        command.sequence, command.monotonic_ns = sample.sequence, sample.monotonic_ns
        command.force = output.force
        self._outlets[0].publish(command)
        recording = self._recording
        if recording is not None:
            recording.note_command(command)

    def _publish_state(self, now_ns: int) -> None:
        source = self._source
        if source is None or not self._state_due(now_ns):
            return
        message, sample = self._state, self.sample
        self._node.stamp(message.header)
        message.faulted, message.reason = bool(source.fault), source.fault
        message.active = source.out != 0.0
        message.commanded_force = source.out
        if sample is not None:
            message.position, message.velocity = sample.position, sample.velocity
        self._outlets[1].publish(message)

    def close(self) -> None:
        """Remove the topics, after the loop has ended."""
        self._inbox.close()
        self._close_outlets()

    # The experiment's thread ---------------------------------------------------------------

    def wake(self) -> None:
        """Start receiving samples."""
        self.sample = None
        self._awake.set()

    def sleep(self) -> None:
        """Stop receiving samples."""
        self._awake.clear()

    def record(self, recording: Recording | None) -> None:
        """Record the samples from now on; None = stop recording."""
        self._recording = recording

    def take_place(self, watch: WatchSettings, period_ns: int) -> TorqueSource:
        """Command the amplifier in place of the controller, first with zero; return the source."""
        node, clock = self._node, self._clock
        self._outlets = (
            Outlet(node, clock, *offered(graph.FORCE_COMMAND)),
            Outlet(node, clock, *offered(graph.CONTROLLER_STATE)),
        )
        wires = Wires(
            take_sample=self._next_sample,
            take_force=self._next_force,
            publish_command=self._publish_command,
            publish_controller_state=self._publish_state,
        )
        self._loop = VerticalLoop(clock, period_ns, wires)
        self._source = source = TorqueSource(watch, period_ns)
        return source

    def halt(self) -> None:
        """Command zero from the next sample on, and stop recording."""
        source = self._source
        if source is not None:
            source.halt()
        self._recording = None

    def leave_place(self, met: Callable[[Callable[[], bool], float], bool]) -> None:
        """Stop sending commands and remove their publishers.

        met: waits as `Robot.met` does, which also outlasts a rig that pauses.
        """
        self._source = None
        seen = self._passes  # after two more passes the loop no longer uses the source
        met(lambda: self._passes >= seen + 2, _PASS_S)
        self._close_outlets()

    def _close_outlets(self) -> None:
        for outlet in self._outlets or ():
            outlet.close()
        self._outlets = None
