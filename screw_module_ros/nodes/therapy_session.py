# SPDX-License-Identifier: Apache-2.0
"""`therapy_session`: carries out a therapy protocol on the running robot.

It subscribes to `endpoint_state` and publishes the slot for the controllers. `therapy/`, which is
independent of ROS and of the clock, decides on the course of the session. When the node hangs or
dies, the controllers fade out its slot, because nothing renews it. The node never switches torque.

Games request set points by `therapy/wish`. The node passes them on within the workspace, no faster
than `wish.speed`, and only while no session but that of a game runs and `allow_wishes` is true.

A therapist's page publishes `therapy/attendance`; a session that has received it pauses without it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import Annotated, Any, NamedTuple

from screw_module_msgs.msg import EndpointState, ImpedanceState, TherapySlot, TherapyState
from screw_module_msgs.srv import StartTherapy
from std_srvs.srv import Trigger

from screw_module_ros import graph
from screw_module_ros.recording.pseudonym import checked_pseudonym, date_in_name
from screw_module_ros.settings import Setting
from screw_module_ros.therapy.adaptation import Assistance
from screw_module_ros.therapy.arm import WEIGHED, Arm
from screw_module_ros.therapy.arm_weights import Arms, weights_file
from screw_module_ros.therapy.asked import AFTER, ANSWERS, BEFORE, PAUSE, Asked
from screw_module_ros.therapy.attendance import Attendance, AttendanceSettings
from screw_module_ros.therapy.hand import PLANE, SPACE, VERTICAL, HandSample, Point, hand_sample
from screw_module_ros.therapy.line import NO_SLOT, SlotWish
from screw_module_ros.therapy.protocol import STRENGTH, Protocol
from screw_module_ros.therapy.protocol_file import (
    GAMES,
    SHIPPED,
    AssistanceLimits,
    allowed_protocol,
    protocol_text,
    sha256,
)
from screw_module_ros.therapy.session import (
    PATIENT_ASKED,
    PULLS_HARD,
    RESTS,
    THERAPIST_PAUSED,
    UNDER_WAY,
    Outcome,
    Session,
    State,
)
from screw_module_ros.therapy.support import SupportSettings, block_refusal
from screw_module_ros.therapy.support import refusal as support_refusal
from screw_module_ros.therapy.weighing import WeighingSettings, places
from screw_module_ros.therapy.wishes import WishLimits

from .support import topics
from .support.answering import Done
from .support.node import Node
from .support.place import below, root_folder
from .support.states import OK, WARN, Due, Health, at_base
from .support.topics import offered, requested
from .therapy_messages import (
    change_message,
    fill_arm,
    fill_asked,
    fill_slot,
    fill_state,
    result_message,
)
from .therapy_recording import RecorderSettings, SessionRecording
from .wish_relay import WishRelay

_LISTENS_NS = 50_000_000
_RENEW_HZ = 20.0
_SILENT_NS = 300_000_000
_WAITS = "waiting for the recording"
_REST = 60.0  # [s] of the therapist's button
_NOT_YET, _SILENT = "no endpoint_state has come yet", f"{graph.ENDPOINT_STATE} is silent"


class TherapySettings(NamedTuple):
    """Limits of the requests of games and therapist."""

    folder: Annotated[
        str, Setting("folder of your own protocols and games, ~ is the home folder")
    ] = "~/protocols"
    allow_wishes: Annotated[
        bool, Setting("pass on wishes of games, while no session but a game runs", live=True)
    ] = True
    rest_height: Annotated[
        float, Setting("to which ~/lower leads the arm", "m", 0.0, 0.36, live=True)
    ] = 0.05  # ours: an arm rest, above the soft stop
    patient_sound: Annotated[bool, Setting("of the patient's screen", live=True)] = False


@dataclass
class Course:
    """What one activation of the node knows; the next one begins without it, and its patient.

    arm: on the handle. slot, state: the messages. session: the newest; asked: of its patient, whose
    pseudonym is patient.
    definition: text of its protocol, until it was published. heard: the newest endpoint_state,
    sample: what a session takes of it; sampled_ns: when it came, told_ns: when the controller's
    state came [ns]. sent: what was published last: state, reason and phase of the session and what
    its patient is asked, slots, support.
    """

    attendance: Attendance
    arm: Arm
    slot: TherapySlot = field(default_factory=lambda: at_base(TherapySlot, support=math.nan))
    state: TherapyState = field(
        default_factory=lambda: at_base(TherapyState, arm_weight=math.nan, rest=math.nan)
    )
    due: Due = field(default_factory=lambda: Due(_RENEW_HZ))
    session: Session | None = None
    asked: Asked = field(default_factory=Asked)
    patient: str = ""
    definition: str = ""
    heard: EndpointState | None = None
    sample: HandSample | None = None
    sampled_ns: int | None = None
    told_ns: int = 0
    sent: tuple[tuple[State, str, Any, Any] | None, SlotWish, float] = (None, NO_SLOT, 0.0)

    @property
    def is_under_way(self) -> bool:
        """Whether a session runs, or may go on."""
        return self.session is not None and self.session.state in UNDER_WAY

    def silent(self, now_ns: int) -> str:
        """Return that no sample of the hand has come lately, at now_ns [ns]; empty if one has."""
        if self.sampled_ns is None:
            return _NOT_YET
        return _SILENT if now_ns - self.sampled_ns > _SILENT_NS else ""

    def hand(self, now_ns: int) -> Point | None:
        """Return the hand's position [m] at now_ns [ns], None if it is not known."""
        return self.sample.position if self.sample and not self.silent(now_ns) else None


def _arm_of(request: StartTherapy.Request) -> tuple[str, str]:
    """Return pseudonym and side, which may be empty. Raises ValueError for what is neither."""
    if request.side not in ("", *Arms._fields):
        raise ValueError(f"side = {request.side[:20]!r}: left or right is wanted, or nothing")
    return checked_pseudonym(request.patient), request.side


class TherapySessionNode(Node):
    """The loop's thread owns the session; services ask it to start and change it (`requests`).

    course: what this activation knows.
    """

    def __init__(self) -> None:
        super().__init__("therapy_session")
        self.parameters.declare(
            TherapySettings, wish=WishLimits, assistance=AssistanceLimits,
            attendance=AttendanceSettings, recorder=RecorderSettings, support=SupportSettings,
            weighing=WeighingSettings,
        )  # fmt: skip
        self.course = self._new_course(Attendance())
        self._recording = SessionRecording(self, self.clock)
        self.serve(StartTherapy, "~/start", self._start)
        self.serve(StartTherapy, "~/weigh", lambda of: self.requests.ask(lambda: self._weigh(of)))
        asked: dict[str, Callable[[], str]] = {
            "pause": partial(self._act, "pause", THERAPIST_PAUSED),
            "pause_by_patient": self._pause_by_patient, "resume": self._resume,
            "rest": self._rest, "abort": self._abort, "lower": self._lower,
        }  # fmt: skip
        for name, act in asked.items():
            self.serve(Trigger, f"~/{name}", partial(self._in_loop, act))

    def connect(self) -> None:
        """Make the topics."""
        self._inbox = inbox = self.new_inbox()
        hand = requested(graph.ENDPOINT_STATE, topics.EACH_STATE)
        self._take = inbox.subscribe(*hand, wakes=True)
        self._wishes = WishRelay(self, inbox, self.parameters.read(WishLimits, "wish"))
        self._take_controller = inbox.subscribe(*requested(graph.CONTROLLER_STATE))
        self._take_attendance = inbox.subscribe(*requested(graph.THERAPY_ATTENDANCE))
        self._take_answer = inbox.subscribe(*requested(graph.THERAPY_ANSWER))
        self._take_score = inbox.subscribe(*requested(graph.THERAPY_SCORE))
        self._recording.connect(inbox)
        self._publish_slot = self.outlet(*offered(graph.THERAPY_SLOT))
        self._publish_state = self.outlet(*offered(graph.THERAPY_STATE))
        self._publish_result = self.outlet(*offered(graph.THERAPY_TRIAL))
        self._publish_change = self.outlet(*offered(graph.THERAPY_ASSISTANCE))

    def begin(self) -> None:
        """Start without a session, and without what the last one has published."""
        attendance = Attendance(self.parameters.read(AttendanceSettings, "attendance"))
        self.course = self._new_course(attendance)
        self._wishes.limit(self.parameters.read(WishLimits, "wish"))
        self._recording.begin(self.parameters.read(RecorderSettings, "recorder"))

    def _new_course(self, attendance: Attendance) -> Course:
        return Course(attendance, Arm(weights_file(), lambda: self.clock.stamp_ns() // 10**9))

    def refusal(self, changes: Mapping[str, Any]) -> str:
        """Return why the support asked for by hand must not be; before activation it counts not."""
        force = changes.get("support.force", 0.0)
        if not self.active or not force:
            return ""
        arm = self.course.arm
        return WEIGHED if arm.weighing else support_refusal(force, arm.weight.weight, arm.limit)

    def changed(self, kind: type) -> None:
        """Apply live parameters; a session keeps its limits from its start."""
        if kind is SupportSettings and self.active:
            force = self.parameters.read(SupportSettings, "support").force
            self.requests.put(lambda: self._set_support(force))
        if kind is WishLimits and self.active:
            limits = self.parameters.read(WishLimits, "wish")
            self.requests.put(lambda: self._wishes.limit(limits))

    def end(self) -> None:
        """End a running session, so that the slot fades out, its recording, and a game's pull."""
        now_ns = self.clock.now_ns()
        self.course.arm.let_go("the node was stopped")
        if self.course.session is not None:
            self.course.session.abort("the node was stopped")
            self._send(now_ns)
        self._recording.close()
        self._relay_wishes(now_ns, ends=True)

    def step(self) -> None:
        """Process new messages; renew slot and state."""
        self._inbox.wait(self.clock.now_ns() + _LISTENS_NS)
        now_ns = self.clock.now_ns()
        self._hear_controller(self._take_controller(), now_ns)
        for message in islice(iter(self._take, None), topics.EACH_STATE.depth):
            self._take_sample(message, now_ns)
        self._watch(now_ns)
        self.course.arm.follow(now_ns)
        self._recording.follow(self.course.session, now_ns)
        self._ask(now_ns)
        self._relay_wishes(now_ns)
        self._send(now_ns)

    def _hear_controller(self, message: ImpedanceState | None, now_ns: int) -> None:
        """Take what the controller tells of the support."""
        course, arm = self.course, self.course.arm
        if message is not None:
            course.told_ns = now_ns
            arm.in_use, arm.limit = message.support, message.support_limit
        elif now_ns - course.told_ns > _SILENT_NS:
            arm.in_use, arm.limit = math.nan, None

    def _take_sample(self, message: EndpointState, now_ns: int) -> None:
        course, arm, session = self.course, self.course.arm, self.course.session
        course.sampled_ns, course.heard = now_ns, message
        sample = hand_sample(message, session.protocol.space if session else PLANE)
        course.sample = sample = sample._replace(support=arm.in_use)
        if session is not None:
            was = session.state
            self._publish(session, session.take(sample))
            if was == State.RUNNING:
                self._lower_for_rest(session)
            if session.state == State.RUNNING:
                arm.ask(session.carried.force)
        if arm.weighing:
            arm.weighing.take(hand_sample(message, SPACE))
        if arm.pulls_hard(sample):  # it stays carried
            arm.let_go(PULLS_HARD)
            if session is not None and session.trial and session.trial.kind != STRENGTH:
                session.pause(PULLS_HARD)

    def _lower_for_rest(self, session: Session) -> None:
        """Lower an arm that rests, where the trials after it bring it up again."""
        if session.reason == RESTS and session.protocol.space != PLANE:
            self._lower()

    def _ask(self, now_ns: int) -> None:
        """Take the patient's answer, keep what was told, and begin a session that waited for it.

        Take a game's score, too.
        """
        asked, session = self.course.asked, self.course.session
        if (score := self._take_score()) is not None and session is not None:
            session.score(score.data)
        if (answer := self._take_answer()) is not None:
            asked.answer(answer.data)
        asked.follow(now_ns)
        if session is not None and session.held and not asked.is_open:
            session.held = ""
            if not self._recording.waits:
                session.begin()
        if asked.scores and not self._recording.waits:  # until then it is not known where
            told, asked.scores = asked.scores, []
            if problem := self._recording.keep(self.course.patient, told):
                self.get_logger().warning(problem)

    def _set_support(self, force: float) -> None:
        """Ask for a support by hand [N]; it ends the fade of a session's block."""
        course, session = self.course, self.course.session
        if session is None or not course.is_under_way or course.sample is None:
            course.arm.ask_for_next(force)
            return
        course.arm.ask(force)
        session.carried.set_by_hand(course.arm.force)
        course.state.support_since = course.sample.sequence

    def _watch(self, now_ns: int) -> None:
        """Pause the session when its samples stop or the therapist's page is silent."""
        if self._take_attendance() is not None:
            self.course.attendance.hear(now_ns)
        silent, session = self.course.silent(now_ns), self.course.session
        reason = silent or self.course.attendance.pause_reason(now_ns)
        if reason and self.course.arm.weighing:
            self.course.arm.weighing.leave(reason, at_once=bool(silent))
        if reason and session is not None:
            session.pause(reason)

    def _publish(self, session: Session, outcome: Outcome) -> None:
        name, (result, change) = session.protocol.name, outcome
        if result is None:
            return
        message = result_message(result, self.course.patient, name, self.course.state.side)
        self._tell(self._publish_result, message)
        if change is not None:
            message = change_message(change, self.course.patient, name, result["block"])
            self._tell(self._publish_change, message)

    def _tell(self, publish: Callable[[Any], None], message: Any) -> None:
        self.stamp(message.header)
        publish(message)

    def _send(self, now_ns: int) -> None:
        """Publish slot and state when they have changed, and repeat them now and then."""
        course, session, state = self.course, self.course.session, self.course.state
        state.monotonic_ns = now_ns
        wish = course.arm.wish or (session.wish if session else NO_SLOT)
        progress = (*session.progress, course.asked.asks) if session else None
        news, last = (progress, wish, course.arm.force), course.sent
        if not (course.due(now_ns) or news != last):
            return
        course.sent = news
        if session or news[1:] != (NO_SLOT, 0.0) or last[1:] != (NO_SLOT, 0.0):
            fill_slot(course.slot, *news[1:])
            self._tell(self._publish_slot, course.slot)
        if news[1] != last[1] and course.sample and not course.is_under_way:
            self._wishes.ask_for(course.sample.position)  # else the spring pulls between slots
        if session is None:
            state.state = TherapyState.IDLE
        else:
            self._fill_session(state, session, last[0])
        fill_arm(state, course.arm)
        fill_asked(state, course.asked)
        state.sound = self.parameters.read(TherapySettings).patient_sound
        self._tell(self._publish_state, state)

    def _fill_session(
        self, state: TherapyState, session: Session, last: tuple[State, str, Any, Any] | None
    ) -> None:
        """Write the session into the state, and log its changes; last: progress told before."""
        course = self.course
        if last is None or (session.state, session.reason) != last[:2]:
            detail = session.reason or session.protocol.name  # logs name no patient
            self.get_logger().info(f"session {session.state.word}: {detail}")
            if session.reason in (PATIENT_ASKED, PULLS_HARD):
                course.asked.ask(PAUSE, state.monotonic_ns)
            elif session.state in (State.FINISHED, State.ABORTED) and session.results:
                course.asked.ask(AFTER, state.monotonic_ns)
        fill_state(state, session, course.patient, course.sample)
        state.recorded = self._recording.runs
        state.definition = ""
        if session.state == State.RUNNING:  # once, in the first message of the running session
            state.definition, course.definition = course.definition, ""

    def _relay_wishes(self, now_ns: int, ends: bool = False) -> None:
        plays = self.course.session is not None and self.course.session.plays
        is_free = not (self.course.is_under_way or self.course.arm.weighing or ends) or plays
        allowed = is_free and self.parameters.read(TherapySettings).allow_wishes
        self._wishes.relay(allowed, self.course.hand(now_ns), now_ns)

    def _start(self, request: StartTherapy.Request) -> str:
        patient, _ = _arm_of(request)
        name = self._named(request.protocol)
        protocol, definition = allowed_protocol(
            protocol_text(name), name, self.parameters.read(AssistanceLimits, "assistance"),
            self.parameters.read(WishLimits, "wish"), request.side, request.level, request.minutes,
        )  # fmt: skip
        return self.requests.ask(
            lambda: self._begin_session(protocol, definition, patient, request)
        )

    def _begin_session(
        self, protocol: Protocol, definition: str, patient: str, request: StartTherapy.Request
    ) -> str:
        """Begin a session, or ask for its recording first; return why not, empty if done."""
        course = self.course
        if course.session is not None and course.is_under_way:
            return f"a session of {course.patient} is {course.session.state.word}: end it first"
        sample, now_ns = course.sample, self.clock.now_ns()
        if sample is None or course.silent(now_ns) or course.arm.refusal:
            return course.silent(now_ns) or course.arm.refusal
        if start_refusal := self._recording.start_refusal(patient, request.record, now_ns):
            return start_refusal
        course.arm.know(patient, request.side)
        weight = course.arm.weight.weight
        for block in protocol.blocks:
            if refused := block_refusal(block.support, weight, course.arm.limit):
                return refused
        course.attendance.begin(request.attended, now_ns)
        course.patient, course.definition = patient, definition
        course.state.side, course.state.checks = request.side, request.checks
        course.state.definition_sha256 = sha256(definition)
        course.asked = Asked(bool(request.checks & StartTherapy.Request.ASK))
        course.asked.ask(BEFORE, now_ns)
        held = ANSWERS if course.asked.is_open else ""
        awaits = _WAITS if request.record else held
        course.arm.begin()
        asked = Assistance(request.duration, request.side_stiffness)
        course.session = Session(
            protocol, awaits, weight, course.arm.force, sample.sequence, asked
        )
        course.session.held = held
        course.state.support_since = 0
        course.sent = (None, *course.sent[1:])
        self._recording.folder = None
        if request.record:
            self._recording.ask(f"{patient}_{protocol.name}_{date_in_name()}")
        hand = None if course.arm.hangs(sample) else sample.position
        self._wishes.begin(self.parameters.read(WishLimits, "wish"), hand, now_ns)
        return ""

    def _weigh(self, request: StartTherapy.Request) -> str:
        """Begin to weigh the arm of a patient, or go on; the state tells what comes next."""
        course, arm = self.course, self.course.arm
        patient, side = _arm_of(request)
        if not side:
            raise ValueError("side: left or right is wanted: which arm is it?")
        if course.is_under_way:
            return "a session is under way: weigh before it, or end it first"
        now_ns, limits = self.clock.now_ns(), self.parameters.read(WishLimits, "wish")
        if not arm.weighing:
            if silent := course.silent(now_ns) or arm.refusal:
                return silent
            course.asked.settle(False)  # the next patient sits there
            course.attendance.begin(request.attended, now_ns)
            self._wishes.begin(limits, course.hand(now_ns), now_ns)
        settings = self.parameters.read(WeighingSettings, "weighing")
        refused = arm.weigh(patient, side, places(limits.ranges()), settings.cradle)
        arm.follow(now_ns)
        return refused or Done(arm.told)

    def _in_loop(self, act: Callable[[], str], request: Trigger.Request) -> str:
        return self.requests.ask(act)

    def _named(self, protocol: str) -> str:
        """Return one of the package's protocols, or the path of a file below `folder`."""
        if protocol in (*SHIPPED, *GAMES):
            return protocol
        root = root_folder(self.parameters.read(TherapySettings).folder)
        return str(below(root, protocol, "protocol"))

    def _pause_by_patient(self) -> str:
        """Pause the session, or end a weighing, which brings the arm back: nothing else."""
        if (weighing := self.course.arm.weighing) is not None:
            weighing.leave(PATIENT_ASKED)
            return ""
        return self._act("pause", PATIENT_ASKED)

    def _abort(self) -> str:
        self.course.asked.settle(False)
        return self._act("abort", "the therapist ended it")

    def _resume(self) -> str:
        if self._recording.waits:
            return _WAITS
        course, session = self.course, self.course.session
        course.attendance.resume(self.clock.now_ns())
        waited = session is not None and session.state == State.STARTING and course.asked.is_open
        course.asked.settle(True)
        return "" if waited else self._act("resume")

    def _rest(self) -> str:
        """Let the patient rest for a minute; return why not, empty if done."""
        refused = self._act("rest", _REST)
        if not refused and self.course.session is not None:
            self._lower_for_rest(self.course.session)
        return refused

    def _lower(self) -> str:
        """Begin to lower the arm; return why not, empty if done."""
        course, session = self.course, self.course.session
        if session is not None and session.state in (State.STARTING, State.RUNNING):
            return f"the session is {session.state.word}: pause it first"
        if course.arm.weighing:
            return WEIGHED
        now_ns = self.clock.now_ns()
        if course.heard is None or course.silent(now_ns):
            return course.silent(now_ns)
        hand = hand_sample(course.heard, VERTICAL)
        if not hand.stop:
            rest = self.parameters.read(TherapySettings).rest_height
            course.arm.lower(hand.z, rest, now_ns)
        return hand.stop

    def _act(self, name: str, *given: str | float) -> str:
        session = self.course.session
        if session is None:
            return "no session has been started"
        return "" if getattr(session, name)(*given) else f"the session is {session.state.word}"

    def health(self) -> Health:
        """Report the progress of the session."""
        session = self.course.session
        values: dict[str, object] = {
            "recording": self._recording.message,
            "support [N]": self.course.arm.force,
        }
        if session is None:
            return Health(OK, "no session", values)
        values |= {"trials done": len(session.results), "trials": session.trials}
        level = WARN if session.state == State.PAUSED else OK
        return Health(level, f"session {session.state.word}: {session.reason}".rstrip(": "), values)
