# SPDX-License-Identifier: Apache-2.0
"""Base class of every node; `runtime` runs it in a process."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack, nullcontext
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.lifecycle import LifecycleNode, LifecycleState
from rclpy.lifecycle import TransitionCallbackReturn as Outcome
from rclpy.qos import QoSProfile
from rclpy.service import Service

from screw_module_ros import graph
from screw_module_ros.clock import Clock, TimeStandsStill, WallClock
from screw_module_ros.lockstep.clock import simulated_clock
from screw_module_ros.loop.requests import Requests

from .answering import Done, answer_always, carried_out
from .arguments import arguments, overrides
from .inbox import Inbox, Outlet, fill_stamp
from .parameters import Parameters
from .scheduling import RealtimeSettings, StartSettings
from .states import ERROR, OK, WARN, Health
from .threads import ServiceThread, Timers, run_loop
from .topics import Senders, offered

if TYPE_CHECKING:  # a process of one node has no topics within it
    from .local_topics import LocalTopics

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = "unconfigured", "inactive", "active", "finalized"
_LEAVE_STEP_S = 2.0
_POLL_S = 0.05


class Node(LifecycleNode):
    """A lifecycle node with parameters, services, diagnostics and a hot loop.

    Two threads share a node. The loop's thread runs `step` and owns the data of the loop. The
    service thread runs services, timers and the lifecycle. It affects the loop only by replacing
    whole values, or by `requests`, which `run_loop` has carried out between two steps: what an act
    there changes, no step sees half changed.

    Subclasses override, as needed, `connect`, `begin`, `step`, `end`, `disconnect` (in the order of
    the lifecycle), `alarm`, `health`, `refusal`, `fixed` and `changed`.

    clock: the one clock of this process. stopping: set when the process is to end. periodic: calls
    of the service thread. requests: acts for the loop's thread. phase: lifecycle state. failure: of
    the last transition, empty without. opened: what `disconnect` closes, the last one first;
    `connect` fills it.
    """

    hardware_id = ""
    moves_time = False
    """Whether simulated time begins with this node."""

    in_order = False
    """Whether the process ends because it was asked to, and not by an error."""

    direct: Collection[str] = ()
    """Topics whose content other parts of this process pass by calls (see `Inbox`)."""

    local: LocalTopics | None = None
    """Topics that pass within this process, where all its loops share a thread."""

    def __init__(self, name: str):
        super().__init__(name, parameter_overrides=overrides(name, arguments().rules))
        self.stopping = threading.Event()
        self.clock = self._chosen_clock()
        answer_always(self)
        self._active = threading.Event()
        self._stepping = threading.Lock()
        self.phase, self.failure = UNCONFIGURED, ""
        self.periodic = Timers()
        self.requests = Requests(self.clock)
        self.opened = ExitStack()
        self._inboxes: list[Inbox] = []
        self._topics: list[Outlet | Senders] = []  # that are closed with the topics
        self.parameters = Parameters(self, self.changed, self.fixed, self.refusal)
        self.parameters.declare(StartSettings, realtime=RealtimeSettings)
        self._diagnostics = self.create_publisher(*offered(graph.DIAGNOSTICS))
        self._reported = ""
        self.periodic.every(self.clock, 1.0, self.publish_health)
        self.service = ServiceThread(self, self.periodic)

    def _chosen_clock(self) -> Clock:
        if not self.get_parameter("use_sim_time").value:
            return WallClock()
        # Our time comes from the page: the topic /clock would only cost 100 callbacks a second.
        for subscription in list(self.subscriptions):
            if subscription.topic_name == "/clock":
                self.destroy_subscription(subscription)
        names = self.get_name(), self.get_namespace()
        return simulated_clock(*names, lambda: self.stopping.is_set())

    # For subclasses to override ------------------------------------------------------------

    def connect(self) -> None:
        """Open devices and topics (lifecycle configure). Raise with a clear message on failure."""

    def begin(self) -> None:
        """Start streaming (lifecycle activate). Raise with a clear message on failure."""

    def step(self) -> None:
        """Do one pass of the hot loop, with its waits; must return within a few periods."""
        self.clock.sleep(_POLL_S)

    def end(self) -> None:
        """Stop streaming with the torque off (lifecycle deactivate)."""

    def finish(self) -> None:
        """Act at an orderly end of the process, in any state, while the topics are still open."""

    def disconnect(self) -> None:
        """Close what `connect` opened (lifecycle cleanup), also after a failed `connect`."""
        self.opened.close()

    @property
    def alarm(self) -> str:
        """The latched fault or stop of an active node: its diagnostics entry shows it at once."""
        return ""

    def health(self) -> Health:
        """Return the diagnostics entry while active."""
        return Health(OK, "running", {})

    def refusal(self, changes: Mapping[str, Any]) -> str:
        """Return why parameters, by name, do not go together with the others; empty if they do."""
        return ""

    def fixed(self, kind: type) -> bool:
        """Return whether settings of the tuple `kind` that are not live may not change now."""
        return self.configured

    def changed(self, kind: type) -> None:
        """Apply parameters of the settings tuple `kind` that changed at run time."""

    # Topics and services, for subclasses to use --------------------------------------------

    @property
    def active(self) -> bool:
        """Whether the node is in the lifecycle state active."""
        return self._active.is_set()

    @property
    def configured(self) -> bool:
        """Whether the node is in the lifecycle state inactive or active."""
        return self.phase in (INACTIVE, ACTIVE)

    def outlet(
        self, kind: type, topic: str, qos: QoSProfile, raw: bool = False
    ) -> Callable[[Any], None]:
        """Return the publish function of a topic, valid until `disconnect`; raw: takes bytes."""
        outlet = Outlet(self, self.clock, kind, topic, qos, raw, self.local)
        self._topics.append(outlet)
        return outlet.publish

    def new_inbox(self) -> Inbox:
        """Return a new inbox for subscriptions of the hot loop, open until `disconnect`."""
        inbox = Inbox(self, self.clock, self.direct, self.local)
        self._inboxes.append(inbox)
        return inbox

    def senders(self, *topics: str) -> Senders:
        """Return what counts the publishers of these topics until `disconnect`."""
        senders = Senders(self, self.periodic, self.clock, topics)
        self._topics.append(senders)
        return senders

    def close_topics(self) -> None:
        """Close everything that `outlet`, `new_inbox` and `senders` have returned."""
        for each in (*self._inboxes, *self._topics):
            each.close()
        self._inboxes, self._topics = [], []

    def stamp(self, header: Any) -> None:
        """Write the present time into a message's header."""
        fill_stamp(header, self.clock.stamp_ns())

    def serve(
        self, kind: type, name: str, action: Callable[[Any], str], done: str = "",
        always: bool = False, then: Callable[[], None] = lambda: None,
    ) -> Service:
        """Offer a service whose response has `success` and `message`.

        action: takes the request and returns the reason of a failure, an empty string for success,
        or `Done` with a message. An exception becomes the answer, and the node continues. done: the
        message for an empty string. always: serve also while the node is not active. then: called
        when the answer is known.
        """

        def answer(request: Any, response: Any) -> Any:
            with self.service.answering():
                said = carried_out(self, action, request, name, always)
            response.success = not said or isinstance(said, Done)
            response.message = str(said) or done
            for field, value in (said.fields if isinstance(said, Done) else {}).items():
                setattr(response, field, value)
            then()
            return response

        return self.create_service(kind, name, answer)

    def refuse_waiting(self, service: Service, why: str, refused: Callable[[Any], bool]) -> None:
        """Answer the requests that wait at a service: refuse those that `refused` picks.

        A request does not tell how long it has waited; who sent it may have given up long ago.
        """
        kind: Any = service.srv_type
        while True:
            with service.handle:
                request, header = service.handle.service_take_request(kind.Request)
            if header is None:
                return
            response = kind.Response()
            if refused(request):
                with self.service.answering():
                    response.success, response.message = False, why
            else:
                response = service.callback(request, response)
            service.send_response(response, header)

    # Lifecycle -----------------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> Outcome:
        """Lifecycle configure."""
        if not self._done("configure", self.connect, holding=True):
            self._closed()
            return Outcome.FAILURE
        self.phase, self.failure = INACTIVE, ""
        return Outcome.SUCCESS

    def on_activate(self, state: LifecycleState) -> Outcome:
        """Lifecycle activate."""
        if not self._done("activate", self._begin_afresh, holding=True):
            return Outcome.FAILURE if self._done("end after it", self.end) else Outcome.ERROR
        self.phase, self.failure = ACTIVE, ""
        self._active.set()
        self.get_logger().info("active")
        return Outcome.SUCCESS

    def _begin_afresh(self) -> None:
        self.begin()
        self.requests.discard()
        for inbox in self._inboxes:
            inbox.discard()  # what came before it counts no longer

    def on_deactivate(self, state: LifecycleState) -> Outcome:
        """Lifecycle deactivate; the node stays active while its loop waits for simulated time."""
        try:
            with self.service.working():
                self._leave_step()
        except TimeStandsStill as error:
            self.get_logger().error(f"cannot deactivate: {error}")
            self._active.set()
            return Outcome.FAILURE
        if not self._done("deactivate", self.end, holding=True):
            return Outcome.ERROR
        self.phase = INACTIVE
        return Outcome.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> Outcome:
        """Lifecycle cleanup."""
        if not self._closed():
            return Outcome.ERROR
        self.phase = UNCONFIGURED
        return Outcome.SUCCESS

    def on_error(self, state: LifecycleState) -> Outcome:
        """After an error in a transition: everything closed, as rcl has the node unconfigured.

        A drive that could not be switched off notices the missing heartbeat and switches off.
        """
        self._closed()
        self.phase = UNCONFIGURED
        return Outcome.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> Outcome:
        """Lifecycle shutdown: from any state, torque off, everything closed."""
        return Outcome.SUCCESS if self._done("shut down", self.close) else Outcome.ERROR

    def _closed(self) -> bool:
        """Close devices and topics, the topics also when a device fails; return whether all was."""
        devices = self._done("clean up", self.disconnect)
        return self._done("clean up", self.close_topics) and devices

    def _done(self, doing: str, action: Callable[[], None], holding: bool = False) -> bool:
        """Do a part of a transition; return whether it went well.

        An error is logged, whatever its type: rclpy drops it without a word. holding: simulated
        time waits for the action.
        """
        try:
            with self.service.working() if holding else nullcontext():
                action()
        except Exception as error:
            text = str(error) or type(error).__name__
            if text != self.failure:
                self.get_logger().error(f"cannot {doing}: {text}")
            self.failure = text
            return False
        return True

    def close(self, ended: Callable[[], None] = lambda: None) -> None:
        """Stop and disconnect from any lifecycle state; safe to call twice.

        ended: called when only topics and buses remain to be closed.
        """
        if self.active:
            try:
                with self.service.working():
                    self._leave_step()
                    self.end()
            except TimeStandsStill as error:
                self.get_logger().warning(f"not left in order: {error}")
        self.finish()
        ended()
        self.service.close()
        if self.phase != FINALIZED:
            self.disconnect()
            self.close_topics()
        self.phase = FINALIZED

    def _leave_step(self) -> None:
        self._active.clear()
        # The rig's own time ends with its step.
        if not (WallClock() if self.moves_time else self.clock).wait_for(
            lambda: not self._stepping.locked(), _LEAVE_STEP_S
        ):
            self.get_logger().error("the loop did not end its step in time")

    # Hot loop ------------------------------------------------------------------------------

    def run(self) -> None:
        """Run `step` while active, until `stopping`; an error in it ends the process."""
        run_loop([self], lambda active: self.step())

    def enters(self) -> bool:
        """Return whether the loop does a step with this node now; then it calls `leaves` after it.

        Meanwhile the node closes nothing that the step uses.
        """
        if self.periodic.is_due():
            self.service.wake()
        self._stepping.acquire()
        if self._active.is_set():
            return True
        self._stepping.release()
        return False

    def leaves(self) -> None:
        """End the step; an alarm, or its end, is on /diagnostics at once.

        An operator sees it, and the supervisor permits no motion meanwhile.
        """
        if (alarm := self.alarm) != self._reported:
            self._reported = alarm
            self.publish_health()
        self._stepping.release()

    def wait_for_activation(self) -> None:
        """Wait until the node is active, for a moment at most."""
        self.clock.rest(self._active, _POLL_S)

    # Diagnostics ---------------------------------------------------------------------------

    def publish_health(self) -> None:
        """Publish the present diagnostics entry on /diagnostics."""
        if self.active:
            health = self.health()
        elif self.failure:
            health = Health(ERROR, self.failure, {})
        else:
            health = Health(WARN, f"lifecycle state {self.phase}", {})
        status = health.status(self.get_fully_qualified_name(), self.hardware_id)
        array = DiagnosticArray(status=[status])
        self.stamp(array.header)
        self._diagnostics.publish(array)
