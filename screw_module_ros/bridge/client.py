# SPDX-License-Identifier: Apache-2.0
"""One client of the bridge: its subscriptions, its pending answers, its requests.

Only a few answers are queued; of each topic the client gets only the newest message. Times are
arguments, and no call waits.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

from . import rosbridge
from .budget import Budget
from .conversion import ConversionError
from .rights import STOP, Denied, Rights
from .settings import Limits

_MOST_ANSWERS = 64
_MOST_CALLS = 8
_EARLY = 0.5  # of the sampling period: a poll may be early by this share


class Gateway(Protocol):
    """Access to the robots for clients. Called from the server's thread."""

    def newest(self, topic: str) -> tuple[int, str] | None:
        """Return a topic's newest message as JSON with its number from 1, None before the first."""

    def history(self, topic: str) -> list[str]:
        """Return the last messages of a topic of `rights.KEPT` as JSON, oldest first."""

    def publish(self, topic: str, content: dict) -> None:
        """Publish. Raises ConversionError."""

    def call(self, service: str, arguments: dict, answered: Callable[[Any, bool], None]) -> None:
        """Call a service; `answered` gets its response, or a message and False, in any thread.

        Raises ConversionError.
        """


class CutOff(Exception):
    """The bridge disconnects a client; the message says why."""


class Subscription:
    """One subscribed topic: number of the last message sent, and time of the next."""

    def __init__(self, period_ns: int):
        self.period_ns = period_ns
        self.sent = 0
        self.due_ns = 0


class Client:
    """Processes a client's texts and returns the texts to send.

    role: of its token. wake: called when there is something to send. answers_from: wraps the
    callback of a service's answer, so that it runs in the thread of all other calls.
    """

    def __init__(
        self,
        role: str,
        rights: Rights,
        gateway: Gateway,
        limits: Limits,
        now_ns: int,
        wake: Callable[[], None] = lambda: None,
        answers_from: Callable[[Callable], Callable] = lambda answered: answered,
    ):
        self.role = role
        self._rights, self._gateway, self._limits = rights, gateway, limits
        self._wake, self._answers_from = wake, answers_from
        self._budget = Budget(limits, now_ns)
        self._topics: dict[str, tuple[str, Subscription]] = {}
        self._answers: deque[str] = deque()
        self._calls: set[object] = set()

    def take(self, text: str, now_ns: int) -> None:
        """Execute a text; answer an error with a status. Raises CutOff."""
        if not self._budget.spend(now_ns):
            raise CutOff(
                f"more than {self._limits.messages:g} messages a second: connect again, and send "
                "no more than the newest"
            )
        id = None
        try:
            operation = rosbridge.parsed(text)
            id = operation.id
            self._DO[type(operation)](self, operation)
        except rosbridge.ProtocolError as error:
            self._answer(rosbridge.status("error", str(error), error.id))
        except (Denied, ConversionError) as error:
            self._answer(rosbridge.status("error", str(error), id))

    def due(self, now_ns: int) -> list[str]:
        """Return the texts to send now: answers, and the newest message of each topic if new."""
        texts = list(self._answers)
        self._answers.clear()
        for topic, (name, wanted) in self._topics.items():
            if now_ns < wanted.due_ns:
                continue
            newest = self._gateway.newest(topic)
            if newest is None or newest[0] == wanted.sent:
                continue
            wanted.sent = newest[0]
            wanted.due_ns = now_ns + wanted.period_ns
            texts.append(rosbridge.publication(name, newest[1]))
        return texts

    @property
    def subscribed(self) -> frozenset[str]:
        """Full names of its subscribed topics."""
        return frozenset(self._topics)

    def _subscribe(self, wish: rosbridge.Subscribe) -> None:
        place, kind = self._rights.hears(self.role, wish.topic)
        _check_kind(wish.kind, kind, wish.topic)
        period = max(wish.throttle, 1.0 / self._limits.rate) - _EARLY / self._limits.rate
        # With the client's own spelling of the name: roslibjs compares names.
        self._topics[place.full] = (wish.topic, Subscription(round(period * 1e9)))

    def _unsubscribe(self, wish: rosbridge.Unsubscribe) -> None:
        self._topics.pop(self._rights.hears(self.role, wish.topic)[0].full, None)

    def _advertise(self, wish: rosbridge.Advertise) -> None:
        _, kind = self._rights.sends(self.role, wish.topic)
        _check_kind(wish.kind, kind, wish.topic)

    def _publish(self, wish: rosbridge.Publish) -> None:
        place, _ = self._rights.sends(self.role, wish.topic)
        self._gateway.publish(place.full, wish.content)

    def _call(self, wish: rosbridge.Call) -> None:
        try:
            place, kind = self._rights.asks(self.role, wish.service, wish.arguments)
            _check_kind(wish.kind, kind, wish.service)
            # Calls that wait for a node that hangs must not prevent the stop.
            if place.name != STOP and len(self._calls) >= _MOST_CALLS:
                raise Denied(f"{_MOST_CALLS} calls are under way: wait for their answers")
            call = object()
            self._calls.add(call)

            def answered(values: Any, result: bool) -> None:
                self._calls.discard(call)
                self._answer(rosbridge.service_response(wish.service, wish.id, values, result))

            try:
                self._gateway.call(place.full, wish.arguments, self._answers_from(answered))
            except ConversionError:
                self._calls.discard(call)
                raise
        except (Denied, ConversionError) as error:  # the caller expects a response, not a status
            text = rosbridge.service_response(wish.service, wish.id, str(error), False)
            self._answer(text)

    _DO = {
        rosbridge.Subscribe: _subscribe,
        rosbridge.Unsubscribe: _unsubscribe,
        rosbridge.Advertise: _advertise,
        rosbridge.Publish: _publish,
        rosbridge.Call: _call,
    }

    def _answer(self, text: str) -> None:
        if len(self._answers) >= _MOST_ANSWERS:
            self._answers.popleft()  # a client that asks but does not read
        self._answers.append(text)
        self._wake()


def _check_kind(asked: str, has: str, name: str) -> None:
    if not rosbridge.same_kind(asked, has):
        raise Denied(f"{name} has the type {has}, not {asked[:80]!r}")
