# SPDX-License-Identifier: Apache-2.0
"""`therapy_session`: carries out a therapy protocol on the running robot.

It subscribes to `endpoint_state` and publishes the slot for the controllers. `therapy/`, which is
independent of ROS and of the clock, decides on the course of the session. When the node hangs or
dies, the controllers fade out its slot, because nothing renews it. The node never switches torque.

Games request set points by `therapy/wish`. The node passes them on within the workspace, no faster
than `wish.speed`, and only while no session runs and `allow_wishes` is true.

A therapist's page publishes `therapy/attendance`. Once a session has received it, the session
continues only while it does: if page, network or bridge fail, the session pauses.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from datetime import datetime
from itertools import islice
from typing import Annotated, NamedTuple

from screw_module_msgs.msg import (
    EndpointState,
    TherapySlot,
    TherapyState,
)
from screw_module_msgs.srv import StartTherapy
from std_srvs.srv import Trigger

from screw_module_ros import graph
from screw_module_ros.settings import Setting
from screw_module_ros.therapy.attendance import Attendance, AttendanceSettings
from screw_module_ros.therapy.limits import AssistanceLimits, allowed_protocol
from screw_module_ros.therapy.line import PLANE
from screw_module_ros.therapy.protocol_file import SHIPPED, protocol_text, sha256
from screw_module_ros.therapy.pseudonym import checked_pseudonym
from screw_module_ros.therapy.recorder_watch import RecorderWatchSettings
from screw_module_ros.therapy.samples import HandSample
from screw_module_ros.therapy.session import PAUSED, RUNNING, Outcome, Session
from screw_module_ros.therapy.wishes import WishLimits

from .session_recording import BEGUN, LOST, REFUSED, SessionRecording
from .support import topics
from .support.node import Node
from .support.place import below, root_folder
from .support.runtime import main as run_node
from .support.states import OK, WARN, Due, Health
from .support.topics import offered, requested
from .therapy_messages import change_message, fill_slot, fill_state, hand_sample, result_message
from .wish_relay import WishRelay

_LISTENS_NS = 50_000_000
_RENEW_HZ = 20.0
_SILENT_NS = 300_000_000
_WAITS = "waiting for the recording"
_BY_HAND = "the therapist paused it"


class TherapySettings(NamedTuple):
    """Limits of the requests of games and therapist."""

    folder: Annotated[
        str, Setting("folder of your own protocols, ~ is the home folder")
    ] = "~/protocols"
    allow_wishes: Annotated[
        bool, Setting("pass on set points of therapy/wish while no session runs", live=True)
    ] = True


class TherapySessionNode(Node):
    """The loop's thread takes samples; services change the session, under one lock."""

    def __init__(self):
        super().__init__("therapy_session")
        self.parameters.declare(TherapySettings)
        self.parameters.declare(WishLimits, "wish")
        self.parameters.declare(AssistanceLimits, "assistance")
        self.parameters.declare(AttendanceSettings, "attendance")
        self.parameters.declare(RecorderWatchSettings, "recorder")
        self._lock = threading.Lock()
        self._session: Session | None = None
        self._patient = self._definition = ""
        self._sample: HandSample | None = None
        self._sampled_ns: int | None = None
        self._attendance = Attendance()
        self._recording = SessionRecording(self, self.clock)
        self._slot: TherapySlot
        self._state: TherapyState
        self.serve(StartTherapy, "~/start", self._start)
        self.serve(Trigger, "~/pause", self._pause)
        self.serve(Trigger, "~/resume", self._resume)
        self.serve(Trigger, "~/abort", lambda _: self._act("abort", "the therapist ended it"))

    # Lifecycle -----------------------------------------------------------------------------

    def connect(self) -> None:
        """Make the topics."""
        self._inbox = inbox = self.new_inbox()
        self._take = inbox.subscribe(
            *requested(graph.ENDPOINT_STATE, topics.EACH_STATE), wakes=True
        )
        self._wishes = WishRelay(self, inbox, self.parameters.read(WishLimits, "wish"))
        self._take_attendance = inbox.subscribe(*requested(graph.THERAPY_ATTENDANCE))
        self._recording.connect(inbox)
        self._publish_slot = self.outlet(*offered(graph.THERAPY_SLOT))
        self._publish_state = self.outlet(*offered(graph.THERAPY_STATE))
        self._publish_result = self.outlet(*offered(graph.THERAPY_TRIAL))
        self._publish_change = self.outlet(*offered(graph.THERAPY_ASSISTANCE))

    def begin(self) -> None:
        """Start without a session, and without what the last one has published."""
        self._slot, self._state = TherapySlot(), TherapyState()
        for message in (self._slot, self._state):
            message.header.frame_id = "manus_base"
        self._due = Due(_RENEW_HZ)
        self._wishes.limit(self.parameters.read(WishLimits, "wish"))
        self._session, self._sent, self._wish = None, None, None
        self._sampled_ns = None
        self._attendance = Attendance(self.parameters.read(AttendanceSettings, "attendance"))
        self._recording.begin(self.parameters.read(RecorderWatchSettings, "recorder"))

    def changed(self, kind: type) -> None:
        """Apply live parameters; a session keeps its limits from its start."""
        if kind is WishLimits and self.active:
            with self._lock:
                self._wishes.limit(self.parameters.read(WishLimits, "wish"))

    def end(self) -> None:
        """End a running session, so that the slot fades out, its recording, and a game's pull."""
        with self._lock:
            now_ns = self.clock.now_ns()
            if self._session is not None:
                self._change(self._session.abort, "the node was stopped")
                self._send(now_ns)
            self._recording.close()
            self._relay_wishes(now_ns, ends=True)

    # Loop ----------------------------------------------------------------------------------

    def step(self) -> None:
        """Process new messages; renew slot and state."""
        self._inbox.wait(self.clock.now_ns() + _LISTENS_NS)
        with self._lock:
            now_ns = self.clock.now_ns()
            for message in islice(iter(self._take, None), topics.EACH_STATE.depth):
                self._take_sample(message, now_ns)
            self._watch(now_ns)
            self._follow_recorder(now_ns)
            self._relay_wishes(now_ns)
            self._send(now_ns)

    def _take_sample(self, message: EndpointState, now_ns: int) -> None:
        session = self._session
        self._sampled_ns = now_ns
        self._sample = hand_sample(message, session.protocol.space if session else PLANE)
        if session is not None:
            before = session.state
            self._publish(session.take(self._sample))
            self._note_state(session, before)

    def _note_state(self, session: Session, before: str) -> None:
        """Record the sample after which a state began: a replay needs it."""
        if session.state != before:
            self._state.state_since = self._sample.sequence if self._sample else 0

    def _watch(self, now_ns: int) -> None:
        """Pause the session when its samples stop or the therapist's page is silent."""
        self._take_page(now_ns)
        if self._session is None:
            return
        if self._silent(now_ns):
            self._change(self._session.pause, f"{graph.ENDPOINT_STATE} is silent")
        if reason := self._attendance.missed(now_ns):
            self._change(self._session.pause, reason)

    def _begin_attendance(self, now_ns: int) -> None:
        """Forget a silent page; take the attendance that was sent ahead of this request.

        At once, as the middleware may drop what a process that ends has sent.
        """
        self._attendance.begin(now_ns)
        self._take_page(now_ns)

    def _take_page(self, now_ns: int) -> None:
        if self._take_attendance() is not None:
            self._attendance.hear(now_ns)

    def _silent(self, now_ns: int) -> bool:
        return self._sampled_ns is None or now_ns - self._sampled_ns > _SILENT_NS

    def _change(self, act: Callable[..., None], *reason: str) -> bool:
        """Apply an operator's action to the session; return whether it changed the state."""
        before = self._session.state
        act(*reason)
        self._note_state(self._session, before)
        return self._session.state != before

    def _follow_recorder(self, now_ns: int) -> None:
        """Begin once the recording hears us, and do not go on unrecorded without being told to."""
        session = self._session
        if session is None:
            self._recording.listen(now_ns)
            return
        news = self._recording.follow(session.state in (RUNNING, PAUSED), now_ns)
        if news == REFUSED:
            self._change(session.abort, self._recording.message)
        elif news == LOST:
            self._change(session.pause, self._recording.message)
        elif news == BEGUN and session.reason == _WAITS:
            self._change(session.resume)

    def _publish(self, outcome: Outcome) -> None:
        name = self._session.protocol.name
        if outcome.result is not None:
            message = result_message(outcome.result, self._patient, name)
            self.stamp(message.header)
            self._publish_result(message)
        if outcome.change is not None:
            block = outcome.result.plan.block
            message = change_message(outcome.change, self._patient, name, block)
            self.stamp(message.header)
            self._publish_change(message)

    def _send(self, now_ns: int) -> None:
        """Publish slot and state when they have changed, and repeat them now and then."""
        session = self._session
        if session is None:
            if self._due(now_ns):
                self._state.state = TherapyState.IDLE
                self.stamp(self._state.header)
                self._publish_state(self._state)
            return
        progress = (session.state, session.reason, session.trial and session.trial.phase)
        changed = progress != self._sent or session.wish != self._wish
        if not (self._due(now_ns) or changed):
            return
        if session.wish != self._wish:
            self._start_ns = self._on_monotonic(session.wish.start_ns)
        if progress[:2] != (self._sent or ())[:2]:
            detail = session.reason or session.protocol.name  # logs name no patient
            self.get_logger().info(f"session {session.state}: {detail}")
        self._sent, self._wish = progress, session.wish
        fill_slot(self._slot, session.wish, self._start_ns)
        self.stamp(self._slot.header)
        self._publish_slot(self._slot)
        self._send_state(session)

    def _send_state(self, session: Session) -> None:
        fill_state(self._state, session, self._sample)
        self._state.patient, self._state.protocol = self._patient, session.protocol.name
        self._state.sequence = self._sample.sequence if self._sample else 0
        self._state.recorded = self._recording.runs
        if session.state == RUNNING:
            self._state.definition, self._definition = self._definition, ""
        else:
            self._state.definition = ""
        self.stamp(self._state.header)
        self._publish_state(self._state)

    def _on_monotonic(self, stamp_ns: int | None) -> int:
        """Return a stamp on the robot's monotonic clock [ns], 0 for none."""
        if stamp_ns is None:
            return 0
        return stamp_ns + self.clock.now_ns() - self.clock.stamp_ns()

    def _relay_wishes(self, now_ns: int, ends: bool = False) -> None:
        running = self._session is not None and self._session.state in (RUNNING, PAUSED)
        allowed = not (running or ends) and self.parameters.read(TherapySettings).allow_wishes
        self._wishes.relay(allowed, None if self._silent(now_ns) else self._sample.position, now_ns)

    # Services ------------------------------------------------------------------------------

    def _start(self, request: StartTherapy.Request) -> str:
        patient = checked_pseudonym(request.patient)
        name = self._named(request.protocol)
        protocol, definition = allowed_protocol(
            protocol_text(name), name, self.parameters.read(AssistanceLimits, "assistance"),
            self.parameters.read(WishLimits, "wish"),
        )  # fmt: skip
        with self._lock:
            running = self._session
            if running is not None and running.state in (RUNNING, PAUSED):
                return f"a session of {self._patient} is {running.state}: end it first"
            if self._sampled_ns is None:
                return "no endpoint_state has come yet"
            now_ns = self.clock.now_ns()
            if hindrance := self._recording.hindrance(now_ns):
                return hindrance
            if not request.record and (owner := self._recording.of_another(patient, now_ns)):
                return (
                    f"session_recorder still records a session of {owner}, whose bag would hold "
                    "this one too: stop it first (session_recorder/stop)"
                )
            self._begin_attendance(now_ns)
            self._patient, self._definition = patient, definition
            self._state.definition_sha256 = sha256(definition)
            self._session, self._sent, self._wish = Session(protocol), None, None
            self._state.state_since = self._sample.sequence
            if request.record:
                name = f"{patient}_{protocol.name}_{datetime.now():%Y_%m_%d-%H_%M_%S}"
                self._recording.ask(name)
                self._session.pause(_WAITS)
            self._wishes.begin(self.parameters.read(WishLimits, "wish"))
        return ""

    def _named(self, protocol: str) -> str:
        """Return one of the package's protocols, or the path of a file below `folder`."""
        if protocol in SHIPPED:
            return protocol
        root = root_folder(self.parameters.read(TherapySettings).folder)
        return str(below(root, protocol, "protocol"))

    def _act(self, name: str, *reason: str) -> str:
        with self._lock:
            session = self._session
            if session is None:
                return "no session has been started"
            changed = self._change(getattr(session, name), *reason)
            return "" if changed else f"the session is {session.state}"

    def _pause(self, request: Trigger.Request) -> str:
        with self._lock:
            session = self._session
            if session is not None and session.state == PAUSED and session.reason == _WAITS:
                session.reason = _BY_HAND  # so that it does not begin with its recording
                return ""
        return self._act("pause", _BY_HAND)

    def _resume(self, request: Trigger.Request) -> str:
        if self._recording.waits:
            return _WAITS
        with self._lock:
            self._begin_attendance(self.clock.now_ns())
        return self._act("resume")

    def health(self) -> Health:
        """Report the progress of the session."""
        session = self._session
        values = {"recording": self._recording.message}
        if session is None:
            return Health(OK, "no session", values)
        values |= {"trials done": len(session.results), "trials": session.trials}
        level = WARN if session.state == PAUSED else OK
        return Health(level, f"session {session.state}: {session.reason}".rstrip(": "), values)


def main() -> int:
    """Console entry point."""
    return run_node(TherapySessionNode)
