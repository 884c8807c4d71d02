# SPDX-License-Identifier: Apache-2.0
"""The recording of a therapy session: begins before it, is watched over, and ends with it.

A recording that went on would hold the next patient's movements in a bag of this one's name.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, NamedTuple

from rclpy.node import Node
from rclpy.task import Future
from screw_module_msgs.srv import StartRecording
from std_srvs.srv import Trigger

from screw_module_ros import graph
from screw_module_ros.clock import Clock
from screw_module_ros.recording import pseudonym
from screw_module_ros.settings import Setting, SettingError
from screw_module_ros.therapy.scores import Score, keep_scores, time_now
from screw_module_ros.therapy.session import UNDER_WAY, Session

from .support.inbox import Inbox
from .support.topics import is_served, requested

RECORDER = "session_recorder"
_FOUND_NS = 5_000_000_000  # time for which a recorder that was just started may stay undiscovered
_ANSWER_NS = 10_000_000_000  # time in which a recorder that was found must answer
_HEARS_NS = 1_000_000_000  # time from the recorder's answer until its subscriptions hear everybody
_LATEST_NS = 5_000_000_000  # time from there until it must have subscribed to what a session needs
_OLD_NS = 3_000_000_000  # age of a report that comes once a second: the recorder has gone
_NEEDED = (
    graph.ENDPOINT_STATE, graph.THERAPY_STATE, graph.THERAPY_TRIAL, graph.THERAPY_ASSISTANCE
)  # fmt: skip
"""Topics without which a bag has no session: each message counts, the first one most."""
_OFF, _ASKED, _ON, _CLOSING = range(4)


class RecorderSettings(NamedTuple):
    """Longest silence of the recorder, which reports once a second. The value is ours."""

    timeout: Annotated[
        float, Setting("silence of the recorder after which a session pauses", "s", 2.0, 60.0)
    ] = 5.0


class SessionRecording:
    """OFF -> ASKED -> ON -> CLOSING -> OFF; one recording at a time, and nobody waits for it.

    message: what the recorder answered, or why the recording was lost; folder: in which the newest
    session's bag lies, None if it has none.
    """

    def __init__(self, node: Node, clock: Clock):
        self.message = ""
        self.folder: Path | None = None
        self._node, self._clock = node, clock
        self._settings = RecorderSettings()
        self._state, self._since_ns = _OFF, 0
        self._number = 0  # of the request whose answers count
        self._unsent: StartRecording.Request | None = None
        self._due_ns: int | None = None  # of the recorder's discovery, then of its answer
        self._started_ns: int | None = None
        self._refusal = self._end = ""  # why no recording began, or why the recorder ended it
        self._bag, self._heard_ns = "", 0  # that the recorder writes, and when it reported so
        self._values: dict[str, str] = {}  # of its last report: what it records, by full name
        self._ended_ns: int | None = None  # when the session was over
        self._starter = node.create_client(StartRecording, f"{RECORDER}/record")
        self._stopper = node.create_client(Trigger, f"{RECORDER}/stop")

    def connect(self, inbox: Inbox) -> None:
        """Subscribe to what the recorder reports."""
        kind, name, profile = requested(graph.RECORDER_STATUS)
        self._take = inbox.subscribe(kind, name.replace("~", RECORDER), profile)

    def begin(self, settings: RecorderSettings) -> None:
        """Start without a recording."""
        self._settings = settings
        self._to(_OFF)

    @property
    def waits(self) -> bool:
        """Whether a session waits for its recording."""
        return self._state == _ASKED

    @property
    def runs(self) -> bool:
        """Whether a session is being recorded."""
        return self._state == _ON

    def of_another(self, patient: str, now_ns: int) -> str:
        """Return whose bag the recorder writes, empty unless it is that of another patient.

        The node that began that recording was killed: it would hold this patient's movements too.
        """
        owner = pseudonym.owner(self._bag)
        return owner if now_ns - self._heard_ns < _OLD_NS and owner != patient else ""

    def keep(self, patient: str, told: Sequence[tuple[str, float]]) -> str:
        """Keep scores beside the bags, of a session that is recorded; return what is wrong."""
        if self.folder is None:
            return ""
        try:
            keep_scores(self.folder, patient, [Score(time_now(), *each) for each in told])
        except (OSError, SettingError):  # whose text names the file, and so the patient
            return "what the patient told is not kept"
        return ""

    def start_refusal(self, patient: str, recorded: bool, now_ns: int) -> str:
        """Return why no session of a patient can start now, empty if it can.

        The last one's bag is still being written; or the session would not be recorded and come
        into another patient's bag.
        """
        is_mute = self._state == _CLOSING and now_ns - self._since_ns >= _ANSWER_NS
        if self._state != _OFF and not is_mute:
            return "the recording of the last session is being closed: try again in a moment"
        if not recorded and (owner := self.of_another(patient, now_ns)):
            return (
                f"session_recorder still records a session of {owner}, whose bag would hold "
                "this one too: stop it first (session_recorder/stop)"
            )
        return ""

    def ask(self, name: str) -> None:
        """Ask for a recording of this name."""
        self._to(_ASKED)
        self._unsent = StartRecording.Request(name=name)
        self._due_ns = self._clock.now_ns() + _FOUND_NS
        self._started_ns = self._ended_ns = None
        self._refusal, self.message = "", "asked for"

    def close(self) -> None:
        """End the recording at once: nobody follows it any more."""
        if self._state in (_ASKED, _ON):
            self._stop()

    def _listen(self, now_ns: int) -> None:
        """Hear what the recorder reports, also between sessions."""
        status = self._take()
        if status is not None:
            self._values = values = {value.key: value.value for value in status.values}
            records = values.get("recording") == str(True)
            self._bag = Path(values.get("bag", "")).name if records else ""
            self._end = "" if records else f"the recording has ended: {status.message}"
            self._heard_ns = now_ns

    def follow(self, session: Session | None, now_ns: int) -> None:
        """Look at the recorder; begin the session once it hears us.

        A session that it refuses ends. One that it loses pauses, and does not go on unrecorded
        without being told to. A second after a session's end its recording ends.
        """
        self._listen(now_ns)
        if session is not None and self._state == _ASKED:
            self._begin(session, now_ns)
        elif session is not None and self._state == _ON:
            self._watch(session, now_ns)

    def _begin(self, session: Session, now_ns: int) -> None:
        self._send(now_ns)
        since_ns = -1 if self._started_ns is None else now_ns - self._started_ns
        if self._refusal:
            self.message = self._refusal
            self._node.get_logger().warning(self.message)
            self._to(_OFF)
            session.abort(self.message)
        elif since_ns >= _HEARS_NS and not (missing := self._not_taken()):
            self._to(_ON)
            self._heard_ns, self._end = now_ns, ""  # earlier reports do not count
            session.begin()
        elif since_ns >= _LATEST_NS:
            self.message = f"not recorded: the session_recorder does not subscribe to {missing}"
            self._stop()
            session.abort(self.message)

    def _send(self, now_ns: int) -> None:
        """Send the request as soon as there is a recorder; give up one that is mute."""
        is_late = self._due_ns is not None and now_ns >= self._due_ns
        if self._unsent is None:
            if is_late:
                self._refusal = "not recorded: the session_recorder does not answer"
        elif is_served(self._node, self._starter):
            request, self._unsent, self._due_ns = self._unsent, None, now_ns + _ANSWER_NS
            started = partial(self._started, self._number)
            self._starter.call_async(request).add_done_callback(started)
        elif is_late:
            self._refusal = "not recorded: no session_recorder answers"

    def _started(self, number: int, future: Future) -> None:
        answer = future.result()
        success = answer is not None and answer.success
        if number != self._number:
            if success:  # too late: it would record whoever comes next
                self._stopper.call_async(Trigger.Request()).add_done_callback(self._stopped)
        elif success:
            self._started_ns, self._due_ns = self._clock.now_ns(), None
            self.folder = Path(answer.message).parent  # also for what is told after the end
            self.message = "the session is recorded"  # the bag's name has the pseudonym
            self._node.get_logger().info(self.message)
        else:
            self._refusal = f"not recorded: {answer.message if answer else 'no answer'}"

    def _not_taken(self) -> str:
        """Return the names of the topics of a session that the recorder does not take.

        It subscribes to them, or has them by calls from a node of its process and reports them.
        """
        here = RECORDER, self._node.get_namespace()
        taken = self._node.get_subscriptions_info_by_topic
        return ", ".join(
            name for name in _NEEDED
            if here not in [(each.node_name, each.node_namespace) for each in taken(name)]
            and self._node.resolve_topic_name(name) not in self._values
        )  # fmt: skip

    def _watch(self, session: Session, now_ns: int) -> None:
        timeout = self._settings.timeout
        if self._end:
            self.message = self._end
            self._to(_OFF)
            session.pause(self.message)
        elif now_ns - self._heard_ns > timeout * 1e9:
            self.message = f"the session recorder has been silent for {timeout:g} s"
            self._stop()  # it may go on later, when nobody counts on it
            session.pause(self.message)
        elif session.state in UNDER_WAY:
            self._ended_ns = None
        elif self._ended_ns is None:
            self._ended_ns = now_ns
        elif now_ns - self._ended_ns >= _HEARS_NS:
            self._stop()

    def _stop(self) -> None:
        """Ask for the bag to be closed; the log has the outcome."""
        self._to(_CLOSING)
        self._stopper.call_async(Trigger.Request()).add_done_callback(self._stopped)

    def _stopped(self, future: Future) -> None:
        answer = future.result()
        if self._state == _CLOSING:
            self._to(_OFF)
        if answer is not None and answer.success:
            self.message = "the recording is closed"
            self._node.get_logger().info(self.message)
        else:
            self.message = f"the bag was not closed: {answer.message if answer else 'no answer'}"
            self._node.get_logger().warning(self.message)

    def _to(self, state: int) -> None:
        """Change the state; answers to a request count only in the states ASKED and ON after it."""
        if state != _ON:
            self._number += 1
        self._state, self._since_ns = state, self._clock.now_ns()
