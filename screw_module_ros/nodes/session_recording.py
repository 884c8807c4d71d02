# SPDX-License-Identifier: Apache-2.0
"""The recording of a therapy session: begins before it, is watched over, and ends with it.

A recording that went on would hold the next patient's movements in a bag of this one's name.
"""

from __future__ import annotations

from pathlib import Path

from rclpy.node import Node

from screw_module_ros import graph
from screw_module_ros.clock import Clock
from screw_module_ros.therapy.pseudonym import PATTERN
from screw_module_ros.therapy.recorder_watch import RecorderWatch, RecorderWatchSettings

from .recorder_client import RECORDER, RecorderClient
from .support.inbox import Inbox
from .support.topics import requested

BEGUN, REFUSED, LOST = "begun", "refused", "lost"
"""What `follow` returns."""
_HEARS_NS = 1_000_000_000  # from the recorder's answer until its subscriptions hear everybody
_LATEST_NS = 5_000_000_000  # from there until it must have subscribed to what a session needs
_OLD_NS = 3_000_000_000  # of a report that comes once a second: the recorder has gone
_NEEDED = (
    graph.ENDPOINT_STATE, graph.THERAPY_STATE, graph.THERAPY_TRIAL, graph.THERAPY_ASSISTANCE
)  # fmt: skip
"""Topics without which a bag has no session: each message counts, the first one most."""
_OFF, _ASKED, _ON = range(3)


class SessionRecording:
    """One recording at a time. told: what the recorder answered, or why the recording was lost."""

    def __init__(self, node: Node, clock: Clock):
        self.message = ""
        self._node, self._client = node, RecorderClient(node, clock)
        self._watch = RecorderWatch()
        self._phase = _OFF
        self._bag, self._bag_ns = "", 0  # that the recorder writes, and when it said so
        self._ended_ns: int | None = None

    def connect(self, inbox: Inbox) -> None:
        """Subscribe to what the recorder reports."""
        kind, name, profile = requested(graph.RECORDER_STATUS)
        self._take = inbox.subscribe(kind, name.replace("~", RECORDER), profile)

    def begin(self, settings: RecorderWatchSettings) -> None:
        """Start without a recording."""
        self._watch, self._phase, self._ended_ns = RecorderWatch(settings), _OFF, None

    @property
    def waits(self) -> bool:
        """Whether a session waits for its recording."""
        return self._phase == _ASKED

    @property
    def runs(self) -> bool:
        """Whether a session is being recorded."""
        return self._phase == _ON

    def listen(self, now_ns: int) -> None:
        """Hear what the recorder reports, also between sessions."""
        status = self._take()
        if status is not None:
            values = {value.key: value.value for value in status.values}
            records = values.get("recording") == str(True)
            self._bag, self._bag_ns = Path(values.get("bag", "")).name if records else "", now_ns
            self._watch.hear(records, status.message, now_ns)

    def of_another(self, patient: str, now_ns: int) -> str:
        """Return whose bag the recorder writes, empty unless it is that of another patient.

        The node that began that recording was killed: it would hold this patient's movements too.
        """
        owner, _, rest = self._bag.partition("_")
        is_news = now_ns - self._bag_ns < _OLD_NS
        return owner if is_news and rest and PATTERN.fullmatch(owner) and owner != patient else ""

    def hindrance(self, now_ns: int) -> str:
        """Return why no session can start now: the last one's bag is still being written."""
        if self._phase != _OFF or self._client.is_closing(now_ns):
            return "the recording of the last session is being closed: try again in a moment"
        return ""

    def ask(self, name: str) -> None:
        """Ask for a recording of this name."""
        self._phase, self._ended_ns = _ASKED, None
        self._client.start(name)

    def close(self) -> None:
        """End the recording at once: nobody follows it any more."""
        if self._phase != _OFF:
            self._phase = _OFF
            self._client.stop()

    def follow(self, in_session: bool, now_ns: int) -> str:
        """Look at the recorder; return what has happened, empty for nothing.

        in_session: the session runs or is paused; a second after its end the recording ends.
        """
        self.listen(now_ns)
        if self._phase == _OFF:
            return ""
        self._end(in_session, now_ns)
        return self._asked(now_ns) if self._phase == _ASKED else self._recorded(now_ns)

    def _asked(self, now_ns: int) -> str:
        self._client.look(now_ns)
        self.message = self._client.message
        if self._client.refused:
            self._phase = _OFF
            return REFUSED
        since_ns = self._client.since(now_ns)
        if since_ns < _HEARS_NS:
            return ""
        if missing := self._not_taken():
            return "" if since_ns < _LATEST_NS else self._useless(missing)
        self._phase = _ON
        self._watch.begin(now_ns)
        return BEGUN

    def _not_taken(self) -> str:
        """Return the names of the topics of a session that the recorder does not subscribe to."""
        here = RECORDER, self._node.get_namespace()
        taken = self._node.get_subscriptions_info_by_topic
        return ", ".join(
            name for name in _NEEDED
            if here not in [(each.node_name, each.node_namespace) for each in taken(name)]
        )  # fmt: skip

    def _useless(self, missing: str) -> str:
        self._phase = _OFF
        self.message = (
            f"not recorded: the session_recorder does not take {missing}: see its parameters "
            "topics and exclude"
        )
        self._client.stop()
        return REFUSED

    def _recorded(self, now_ns: int) -> str:
        problem = self._watch.lost(now_ns) if self._phase == _ON else ""
        if not problem:
            return ""
        self._phase, self.message = _OFF, problem
        if self._watch.silent:  # it may go on later, when nobody counts on it
            self._client.stop()
        return LOST

    def _end(self, in_session: bool, now_ns: int) -> None:
        if in_session:
            return
        self._ended_ns = now_ns if self._ended_ns is None else self._ended_ns
        if self._phase == _ON and now_ns - self._ended_ns >= _HEARS_NS:
            self._phase = _OFF
            self._client.stop()
