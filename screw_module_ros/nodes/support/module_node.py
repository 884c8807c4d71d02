# SPDX-License-Identifier: Apache-2.0
"""Base class of every node: a lifecycle node with parameters, diagnostics and a hot loop.

`runtime` runs it in a process.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping
from typing import Annotated, Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile

from screw_module_ros import graph
from screw_module_ros.clock import TimeStandsStill, WallClock
from screw_module_ros.domain import domain_id
from screw_module_ros.settings import Setting

from .answering import answer_always
from .health import ERROR, OK, WARN, Health, status_message
from .inbox import Inbox, Outlet
from .parameters import Parameters
from .scheduling import RealtimeSettings
from .serving_node import ServingNode
from .timers import Timer, Timers
from .topics import offered

_LEAVE_STEP_S = 2.0
_RETRY_S = 1.0
_IDLE_S = 0.05
_NO_TIME = (
    "waiting for sim_rig: nobody moves simulated time in ROS domain {} yet (or set use_sim_time to "
    "false)"
)


class StartSettings(NamedTuple):
    """Start of the node."""

    autostart: Annotated[
        bool, Setting("configure and activate at start, and try again until it works")
    ] = True


class ModuleNode(ServingNode):
    """A lifecycle node with parameters, diagnostics and a hot loop.

    Two threads share a node. The loop's thread runs `step` and owns the data of the loop. The
    service thread runs services, timers and the lifecycle. It affects the loop only by replacing
    whole values or by requests that the loop carries out (see `loop/requests`).

    Subclasses override, as needed, `connect`, `begin`, `step`, `end`, `disconnect` (in the order of
    the lifecycle), `health` and `changed`.
    """

    def __init__(self, name: str):
        super().__init__(name)
        answer_always(self)
        self.periodic = Timers()
        self._called = self.create_guard_condition(self._make_calls)
        self._outlets: list[Outlet] = []
        self._outside_step = threading.Event()
        self._outside_step.set()
        self.parameters = Parameters(self, self.changed, self._is_configured, self.refusal)
        self.parameters.declare(StartSettings)
        self.parameters.declare(RealtimeSettings, "realtime")
        self._diagnostics = self.create_publisher(*offered(graph.DIAGNOSTICS))
        self.periodic.every(self.clock, 1.0, self.publish_health)
        self._start_timer: Timer | None = None
        self._inbox: Inbox | None = None
        self._inboxes: list[Inbox] = []
        self.start_serving()

    # For subclasses to use -----------------------------------------------------------------

    def outlet(
        self, kind: type, topic: str, qos: QoSProfile, raw: bool = False
    ) -> Callable[[Any], None]:
        """Return the publish function of a topic, valid until `disconnect`; raw: takes bytes."""
        outlet = Outlet(self, self.clock, kind, topic, qos, raw)
        self._outlets.append(outlet)
        return outlet.publish

    def new_inbox(self) -> Inbox:
        """Return a new inbox for subscriptions of the hot loop; `disconnect` closes it."""
        inbox = self._inbox = Inbox(self, self.clock, self.direct)
        self._inboxes.append(inbox)
        return inbox

    def close_topics(self) -> None:
        """Close all outlets and inboxes."""
        for topics in (*self._inboxes, *self._outlets):
            topics.close()
        self._inbox, self._inboxes, self._outlets = None, [], []

    def stamp(self, header: Any) -> None:
        """Write the present time into a message's header."""
        header.stamp.sec, header.stamp.nanosec = divmod(self.clock.stamp_ns(), 1_000_000_000)

    # For subclasses to override ------------------------------------------------------------

    hardware_id = ""

    moves_time = False
    """Whether simulated time begins with this node."""

    direct: Collection[str] = ()
    """Topics whose content other parts of this process pass by calls (see `Inbox`)."""

    def connect(self) -> None:
        """Open devices and topics (lifecycle configure). Raise with a clear message on failure."""

    def begin(self) -> None:
        """Start streaming (lifecycle activate). Raise with a clear message on failure."""

    def step(self) -> None:
        """Do one pass of the hot loop, with its waits; must return within a few periods."""
        self.clock.sleep(_IDLE_S)

    def end(self) -> None:
        """Stop streaming with the torque off (lifecycle deactivate)."""

    def disconnect(self) -> None:
        """Close what `connect` opened (lifecycle cleanup), also after a failed `connect`."""

    def health(self) -> Health:
        """Return the diagnostics entry while active."""
        return Health(OK, "running", {})

    def refusal(self, changes: Mapping[str, Any]) -> str:
        """Return why parameters, by name, do not go together with the others; empty if they do."""
        return ""

    def changed(self, kind: type) -> None:
        """Apply parameters of the settings tuple `kind` that changed at run time."""

    # Lifecycle -----------------------------------------------------------------------------

    def _is_configured(self) -> bool:
        return self._phase in ("inactive", "active")

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle configure."""
        try:
            with self.working():
                self.connect()
        except Exception as error:  # the sentence is what the user acts on, whatever its type
            self._fail("configure", error)
            self._closed()
            return TransitionCallbackReturn.FAILURE
        self._phase, self._failure = "inactive", ""
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle activate: what came before it counts no longer."""
        try:
            with self.working():
                self.begin()
                for inbox in self._inboxes:
                    inbox.discard()
        except Exception as error:
            self._fail("activate", error)
            return self._done("end after it", self.end, TransitionCallbackReturn.FAILURE)
        self._phase, self._failure = "active", ""
        self._active.set()
        self.get_logger().info("active")
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle deactivate; the node stays active while its loop waits for simulated time."""
        try:
            with self.working():
                self._leave_step()
        except TimeStandsStill as error:
            self.get_logger().error(f"cannot deactivate: {error}")
            self._active.set()
            return TransitionCallbackReturn.FAILURE
        result = self._done("deactivate", self._end_working)
        if result == TransitionCallbackReturn.SUCCESS:
            self._phase = "inactive"
        return result

    def _end_working(self) -> None:
        with self.working():
            self.end()

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle cleanup."""
        result = self._closed()
        if result == TransitionCallbackReturn.SUCCESS:
            self._phase = "unconfigured"
        return result

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """After an error in a transition: everything closed, as rcl has the node unconfigured.

        A drive that could not be switched off notices the missing heartbeat and switches off.
        """
        self._closed()
        self._phase = "unconfigured"
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle shutdown: from any state, torque off, everything closed."""
        return self._done("shut down", self.close)

    def _closed(self) -> TransitionCallbackReturn:
        """Close devices and topics, the topics also when a device fails."""
        result = self._done("clean up", self.disconnect)
        topics = self._done("clean up", self.close_topics)
        return topics if result == TransitionCallbackReturn.SUCCESS else result

    def _done(
        self, doing: str, action: Callable[[], None],
        result: TransitionCallbackReturn = TransitionCallbackReturn.SUCCESS,
    ) -> TransitionCallbackReturn:
        """Do a part of a transition; an error is logged, since rclpy drops it without a word."""
        try:
            action()
        except Exception as error:
            self._fail(doing, error)
            return TransitionCallbackReturn.ERROR
        return result

    def close(self, ended: Callable[[], None] = lambda: None) -> None:
        """Stop and disconnect from any lifecycle state; safe to call twice.

        ended: called when only topics and buses remain to be closed.
        """
        if self._active.is_set():
            try:
                with self.working():
                    self._leave_step()
                    self.end()
            except TimeStandsStill as error:
                self.get_logger().warning(f"not left in order: {error}")
        ended()
        self.stop_serving()
        if self._phase != "finalized":
            self.disconnect()
            self.close_topics()
        self._phase = "finalized"

    def _leave_step(self) -> None:
        self._active.clear()
        if not self.clock.wait_for(self._outside_step.is_set, _LEAVE_STEP_S):
            self.get_logger().error("the loop did not end its step in time")

    def _fail(self, doing: str, error: Exception) -> None:
        text = str(error) or type(error).__name__
        if text != self._failure:
            self.get_logger().error(f"cannot {doing}: {text}")
        self._failure = text

    def start_by_itself(self) -> None:
        """Configure and activate if `autostart` is set; try again each second until it works."""
        if self.parameters.read(StartSettings).autostart:
            self._start_timer = self.periodic.every(WallClock(), _RETRY_S, self._try_start)
            self._try_start()

    def _try_start(self) -> None:
        if self._phase == "unconfigured" and not self._time_moves():
            return
        if self._phase == "unconfigured":
            self.trigger_configure()
        if self._phase == "inactive":
            self.trigger_activate()
        if self._phase in ("active", "finalized"):
            self.periodic.cancel(self._start_timer)

    def _time_moves(self) -> bool:
        """Return whether the clock runs; report it if not."""
        if self.moves_time or not self.clock.simulated or self.clock.page.conductor:
            return True
        text = _NO_TIME.format(domain_id())
        if self._failure != text:
            self._failure = text
            self.get_logger().info(text)
        return False

    # Hot loop ------------------------------------------------------------------------------

    def run(self) -> None:
        """Run `step` while active, until `stop`; an error in it ends the process."""
        try:
            while not self.stopping.is_set():
                if self.takes_part():
                    self.step()
                else:
                    self.clock.idle()
                    self._active.wait(_IDLE_S)
        except TimeStandsStill as error:  # only raised here when the process is to end
            self.get_logger().warning(str(error))
        finally:
            self.leaves()

    def takes_part(self) -> bool:
        """Return whether the loop may run this node's part now.

        The loop's thread calls this before each step. Until its next call, or its call of `leaves`,
        the node closes nothing that the step uses.
        """
        self.wake_if_due()
        if self._active.is_set():
            if not self._outside_step.is_set():
                return True
            self._outside_step.clear()
            if self._active.is_set():  # a thread that clears it then waits for this step
                return True
        self._outside_step.set()
        return False

    def wake_if_due(self) -> None:
        """Wake the service thread when it has calls to make; a long step repeats this."""
        if self.periodic.is_due():
            self.hold_for_calls()
            self.wake()

    def wake(self) -> None:
        """Wake the service thread. `Executor.wake` does not: its `spin_once` sleeps again."""
        self._called.trigger()

    def make_calls(self) -> None:
        """Make the periodic calls that are due; in the service thread."""
        if self.periodic.due():
            self._make_calls()

    def _make_calls(self) -> None:
        with self.working():  # also without a call: the loop may have held time for one just made
            self.periodic.run()

    def leaves(self) -> None:
        """Record that the loop has ended its last step."""
        self._outside_step.set()

    # Diagnostics and parameters ------------------------------------------------------------

    def publish_health(self) -> None:
        """Publish the present diagnostics entry on /diagnostics."""
        if self._active.is_set():
            health = self.health()
        elif self._failure:
            health = Health(ERROR, self._failure, {})
        else:
            health = Health(WARN, f"lifecycle state {self._phase}", {})
        status = status_message(health, self.get_fully_qualified_name(), self.hardware_id)
        array = DiagnosticArray(status=[status])
        self.stamp(array.header)
        self._diagnostics.publish(array)
