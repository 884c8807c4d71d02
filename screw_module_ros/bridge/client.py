# SPDX-License-Identifier: Apache-2.0
"""One client of the bridge: its subscriptions, its calls, and the texts to send to it.

It speaks the subset of the rosbridge v2 protocol that roslibjs games need (source:
ROSBRIDGE_PROTOCOL.md, version 2.1.0, of rosbridge_suite), as JSON without fragments or compression.
Only a few answers are queued; of a topic the client gets only the newest message, of the kept ones
(`rights.KEPT`) each. In the other direction too the newest counts: of what a client publishes
faster than it may, the newest message of each topic goes out as soon as it may. Everything happens
in the server's thread, and nothing here waits for it.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from ..settings import shown
from .rights import (
    ACTION,
    ANSWER,
    CALL,
    PUBLISH,
    SILENT,
    STOP,
    SUBSCRIBE,
    Denied,
    Place,
    Rights,
    pressed,
)
from .settings import Limits

_MOST_ANSWERS = 64
_MOST_CALLS = 8
_LONGEST_THROTTLE_MS = 3_600_000
_EARLY = 0.5  # share of the sampling period by which a poll may be early


class Gateway(Protocol):
    """Access to the robots for clients."""

    def poll(self) -> None:
        """Take what the robots have sent."""

    def begin(self, topic: str) -> int:
        """Return the number of the last message that a new subscriber does not get."""

    def after(self, topic: str, number: int) -> list[tuple[int, str]]:
        """Return what came after a message, with its numbers, as JSON: the newest, or each one."""

    def publish(self, topic: str, content: dict) -> None:
        """Publish. Raises ValueError."""

    async def call(self, service: str, arguments: dict) -> dict:
        """Call a service; return its response. Raises ValueError, ServiceError."""

    def act(self, robot: str, page: str, action: str, refused: bool = False) -> None:
        """Keep what a person did at the page of a role, for the bag of the robot's session."""


class ServiceError(RuntimeError):
    """A service did not answer, or failed; the message says which."""


class CutOff(Exception):
    """The bridge disconnects a client; the message says why."""


class Allowance:
    """A token bucket: `rate` a second on average [1/s], `burst` at once; times in ns."""

    def __init__(self, rate: float, burst: float, now_ns: int):
        self._rate, self._burst = rate, burst
        self._left, self._at_ns = burst, now_ns

    def take(self, now_ns: int) -> bool:
        """Return whether one more is allowed now, and count it if so."""
        gained = (now_ns - self._at_ns) * 1e-9 * self._rate
        self._left, self._at_ns = min(self._burst, self._left + gained), now_ns
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


@dataclass
class Subscription:
    """A topic as the client spells it; number: of the last message sent; due_ns: of the next."""

    name: str
    period_ns: int
    number: int
    due_ns: int = 0


class Client:
    """Executes a client's texts, and returns the texts to send. Times are arguments.

    role: of its token. wake: called when there is something to send.
    """

    def __init__(
        self, role: str, rights: Rights, gateway: Gateway, limits: Limits, now_ns: int,
        wake: Callable[[], None] = lambda: None,
    ):  # fmt: skip
        self.role = role
        self._rights, self._gateway, self._limits, self._wake = rights, gateway, limits, wake
        self._allowed = Allowance(limits.messages, limits.burst, now_ns)
        self._bearable = Allowance(limits.flood, limits.flood, now_ns)
        self._has_told_excess = False
        self._held: dict[str, dict] = {}  # by topic the newest publish that had to wait
        self._topics: dict[str, Subscription] = {}
        self._answers: deque[str] = deque()
        self._calls: set[asyncio.Task] = set()

    def take(self, text: str, now_ns: int) -> None:
        """Execute a text; what is wrong with it becomes an answer. Raises CutOff for a flood."""
        if not self._bearable.take(now_ns):
            raise CutOff(f"more than {self._limits.flood:g} messages a second: connect again")
        op: dict[str, Any] = {}
        try:
            op = _parsed(text)
            _check(op)
            self._carry_out(op, now_ns)
        except (Denied, ValueError, RecursionError) as error:
            self._refuse(op, error)

    def texts(self, now_ns: int) -> list[str]:
        """Return the texts to send now: answers, and what is new in each topic that is due.

        Publishes what had to wait.
        """
        self._publish_held(now_ns)
        texts = list(self._answers)
        self._answers.clear()
        for topic, wanted in self._topics.items():
            news = self._gateway.after(topic, wanted.number) if now_ns >= wanted.due_ns else []
            if news:
                wanted.number, wanted.due_ns = news[-1][0], now_ns + wanted.period_ns
            name = json.dumps(wanted.name)
            texts += [f'{{"op":"publish","topic":{name},"msg":{text}}}' for _, text in news]
        return texts

    @property
    def subscribed(self) -> frozenset[str]:
        """Full names of its subscribed topics."""
        return frozenset(self._topics)

    def _carry_out(self, op: dict, now_ns: int) -> None:
        """Carry out an operation; hold or refuse it in excess. Raises Denied, ValueError."""
        if self._allowed.take(now_ns) or _is_stop(op):
            self.OPERATIONS[op["op"]](self, op)
            return
        excess = f"more than {self._limits.messages:g} messages a second"
        if op["op"] != "publish":
            raise Denied(f"{excess}: this one was not carried out; send it again")
        self._held[self._place(op, PUBLISH, "topic").full] = op
        if not self._has_told_excess:
            self._has_told_excess = True
            what = f"{excess}: of each topic the newest counts, the others are dropped"
            self._put({"op": "status", "level": "warning", "msg": what}, op)

    def _publish_held(self, now_ns: int) -> None:
        """Publish the newest message of each topic that had to wait, as far as is allowed now."""
        for topic in list(self._held):
            if not self._allowed.take(now_ns):
                return
            op = self._held.pop(topic)
            try:
                self._publish(op)
            except (Denied, ValueError) as error:
                self._refuse(op, error)

    def _refuse(self, op: dict, error: Exception) -> None:
        """Answer an operation that was not carried out."""
        why = " ".join(str(error).split())
        if op.get("op") == "call_service":  # its caller waits for a response, not a status
            self._respond(op, why, False)
        else:
            self._put({"op": "status", "level": "error", "msg": why}, op)

    # Operations ----------------------------------------------------------------------------

    def _subscribe(self, op: dict) -> None:
        place = self._place(op, SUBSCRIBE, "topic")
        throttle = op.get("throttle_rate", 0)
        if type(throttle) not in (int, float) or not 0 <= throttle <= _LONGEST_THROTTLE_MS:
            raise ValueError(f"throttle_rate: 0 to {_LONGEST_THROTTLE_MS} ms is wanted")
        if op.get("compression") not in ("none", None):
            raise ValueError("compression: only plain JSON is sent; ask for none")
        period = max(throttle * 1e-3, 1.0 / self._limits.rate) - _EARLY / self._limits.rate
        # With the client's own spelling of the name: roslibjs compares names.
        self._topics[place.full] = Subscription(
            op["topic"], round(period * 1e9), self._gateway.begin(place.full)
        )

    def _unsubscribe(self, op: dict) -> None:
        self._topics.pop(self._place(op, SUBSCRIBE, "topic").full, None)

    def _advertise(self, op: dict) -> None:
        self._place(op, PUBLISH, "topic")

    def _publish(self, op: dict) -> None:
        place = self._place(op, PUBLISH, "topic")
        self._held.pop(place.full, None)  # it is older
        content = op.get("msg") or {}
        if place.name == ACTION:
            self._gateway.act(place.robot, self.role, pressed(self.role, content))
            return
        self._gateway.publish(place.full, content)
        if place.name == ANSWER:
            self._gateway.act(place.robot, self.role, "answer")

    def _call(self, op: dict) -> None:
        arguments = op.get("args") or {}
        if not isinstance(arguments, dict):
            raise ValueError("args: an object of field names and values is wanted")
        place = self._place(op, CALL, "service", arguments)
        # Calls that wait for a node that hangs must not prevent the stop.
        if place.name != STOP and len(self._calls) >= _MOST_CALLS:
            raise Denied(f"{_MOST_CALLS} calls are under way: wait for their answers")
        call = asyncio.ensure_future(self._answer(op, place, arguments))
        self._calls.add(call)
        call.add_done_callback(self._calls.discard)

    OPERATIONS = {
        "subscribe": _subscribe,
        "unsubscribe": _unsubscribe,
        "advertise": _advertise,
        "unadvertise": _advertise,
        "publish": _publish,
        "call_service": _call,
    }

    def _place(self, op: dict, verb: str, key: str, arguments: dict | None = None) -> Place:
        """Return the topic or service that an operation names in `key`. Raises Denied."""
        name, kind = op.get(key), op.get("type") or ""
        if not isinstance(name, str) or not isinstance(kind, str):
            raise ValueError(f"{key}, type: names are wanted")
        return self._rights.may(self.role, verb, name, kind, arguments)

    async def _answer(self, op: dict, place: Place, arguments: dict) -> None:
        values: Any
        try:
            values, result = await self._gateway.call(place.full, arguments), True
        except Exception as error:  # whatever it is: the caller waits for a response
            values, result = str(error) or type(error).__name__, False
        self._respond(op, values, result)
        if not place.name.endswith(SILENT):
            self._gateway.act(place.robot, self.role, *_action(place, arguments, values, result))

    def _respond(self, op: dict, values: Any, result: bool) -> None:
        service = op.get("service") if isinstance(op.get("service"), str) else ""
        answer = {"op": "service_response", "service": service, "values": values, "result": result}
        self._put(answer, op)

    def _put(self, answer: dict, op: dict) -> None:
        """Queue an answer to an operation, with its id."""
        if isinstance(op.get("id"), str):
            answer["id"] = op["id"]
        if len(self._answers) >= _MOST_ANSWERS:
            self._answers.popleft()  # a client that asks but does not read
        self._answers.append(json.dumps(answer, allow_nan=False, separators=(",", ":")))
        self._wake()


def _parsed(text: str) -> dict[str, Any]:
    """Return the JSON object of a text. Raises ValueError."""
    try:
        op = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"this is no JSON: {str(error)[:80]}") from None
    if not isinstance(op, dict):
        raise ValueError("a JSON object with the key op is wanted")
    return op


def _check(op: dict[str, Any]) -> None:
    """Raise ValueError unless it is a known operation, and all its texts are Unicode."""
    try:
        json.dumps(op, ensure_ascii=False).encode()
    except UnicodeEncodeError:  # ROS could not send it
        raise ValueError("half of a surrogate pair is no text") from None
    if not isinstance(op.get("id", ""), (str, type(None))):
        raise ValueError("id: a text is wanted")
    name = op.get("op")
    if not isinstance(name, str) or name not in Client.OPERATIONS:
        raise ValueError(f"op = {shown(name)}: one of {', '.join(Client.OPERATIONS)} is wanted")


def _is_stop(op: dict[str, Any]) -> bool:
    """Return whether it asks for the software stop, which is never too much."""
    return op["op"] == "call_service" and str(op.get("service")).endswith(STOP)


def _action(place: Place, arguments: dict, values: Any, result: bool) -> tuple[str, bool]:
    """Return what a call was for, without its values, and whether it was refused."""
    what = place.name.rpartition("/")[2]
    if not result:
        return what, True
    if what == "set_parameters":
        named = " ".join(each["name"] for each in arguments["parameters"])
        return f"set {named}", not all(each["successful"] for each in values["results"])
    return what, not values["success"]


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is no JSON: write null")
