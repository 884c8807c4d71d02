# SPDX-License-Identifier: Apache-2.0
"""The wire format: the subset of the rosbridge v2 protocol that roslibjs games need.

Source: ROSBRIDGE_PROTOCOL.md, version 2.1.0, of rosbridge_suite. It reads subscribe, unsubscribe,
advertise, unadvertise, publish and call_service, and writes publish, service_response and status.
Only JSON, without fragments or compression. NaN and infinite numbers are written as null.
"""

from __future__ import annotations

import json
from typing import Any, NamedTuple

from ..settings import shown

LONGEST_NAME = 200  # characters of a topic, service, type or id
_DEEPEST = 12  # nesting of a message's content


class ProtocolError(ValueError):
    """A client's text is invalid; the message names the problem and the way out.

    id: of the operation if it has one, for the answer.
    """

    def __init__(self, text: str, id: str | None = None):
        super().__init__(text)
        self.id = id


class Subscribe(NamedTuple):
    """Request for a topic's newest message, at most every `throttle` [s]; kind: type or empty."""

    topic: str
    kind: str
    throttle: float
    id: str | None


class Unsubscribe(NamedTuple):
    """End of a subscription."""

    topic: str
    id: str | None


class Advertise(NamedTuple):
    """Announcement that the client will publish, or (`off`) that it stops."""

    topic: str
    kind: str
    off: bool
    id: str | None


class Publish(NamedTuple):
    """A message for a topic."""

    topic: str
    content: dict
    id: str | None


class Call(NamedTuple):
    """A call of a service; kind: its type, or empty."""

    service: str
    arguments: dict
    kind: str
    id: str | None


Operation = Subscribe | Unsubscribe | Advertise | Publish | Call


def parsed(text: str) -> Operation:
    """Return the operation in a text. Raises ProtocolError."""
    try:
        content = json.loads(text, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise ProtocolError(f"this is no JSON: {' '.join(str(error).split())[:80]}") from None
    if not isinstance(content, dict):
        raise ProtocolError("a JSON object with the key op is wanted")
    id = content.get("id")
    if id is not None and not (isinstance(id, str) and len(id) <= LONGEST_NAME):
        raise ProtocolError(f"id: a text of at most {LONGEST_NAME} characters is wanted")
    read = _READERS.get(content.get("op") if isinstance(content.get("op"), str) else None)
    if read is None:
        raise ProtocolError(
            f"op = {shown(content.get('op'))}: one of {', '.join(_READERS)} is wanted", id
        )
    try:
        return read(content, id)
    except ProtocolError as error:
        raise ProtocolError(str(error), id) from None


def _subscribe(content: dict, id: str | None) -> Subscribe:
    throttle = content.get("throttle_rate", 0)
    if isinstance(throttle, bool) or not isinstance(throttle, (int, float)):
        raise ProtocolError("throttle_rate: a number of milliseconds is wanted")
    if not 0 <= throttle <= 3_600_000:
        raise ProtocolError("throttle_rate: 0 to 3600000 ms is wanted")
    if content.get("compression", "none") not in ("none", None):
        raise ProtocolError(
            f"compression = {shown(content['compression'])}: only plain JSON is sent; ask for none"
        )
    return Subscribe(_name(content, "topic"), _kind(content), throttle * 1e-3, id)


def _unsubscribe(content: dict, id: str | None) -> Unsubscribe:
    return Unsubscribe(_name(content, "topic"), id)


def _advertise(content: dict, id: str | None) -> Advertise:
    return Advertise(_name(content, "topic"), _kind(content), False, id)


def _unadvertise(content: dict, id: str | None) -> Advertise:
    return Advertise(_name(content, "topic"), "", True, id)


def _publish(content: dict, id: str | None) -> Publish:
    return Publish(_name(content, "topic"), _object(content, "msg"), id)


def _call(content: dict, id: str | None) -> Call:
    return Call(_name(content, "service"), _object(content, "args"), _kind(content), id)


_READERS = {
    "subscribe": _subscribe,
    "unsubscribe": _unsubscribe,
    "advertise": _advertise,
    "unadvertise": _unadvertise,
    "publish": _publish,
    "call_service": _call,
}


def _name(content: dict, key: str) -> str:
    name = content.get(key)
    if not isinstance(name, str) or not 0 < len(name) <= LONGEST_NAME:
        raise ProtocolError(f"{key}: a name of at most {LONGEST_NAME} characters is wanted")
    return name


def _kind(content: dict) -> str:
    """Return the type as `package/msg/Name` or `package/srv/Name`, or as it was given."""
    kind = content.get("type") or ""
    if not isinstance(kind, str) or len(kind) > LONGEST_NAME:
        raise ProtocolError(f"type: a name of at most {LONGEST_NAME} characters is wanted")
    return kind


def _object(content: dict, key: str) -> dict:
    value = content.get(key) or {}
    if not isinstance(value, dict):
        raise ProtocolError(f"{key}: an object of field names and values is wanted")
    if _depth(value) > _DEEPEST:
        raise ProtocolError(f"{key}: nested deeper than {_DEEPEST} levels")
    return value


def _depth(value: Any) -> int:
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return 1 + max(map(_depth, inner), default=0)


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no JSON: write null")


def same_kind(asked: str, has: str) -> bool:
    """Return whether a type is meant: `pkg/Name` (ROS 1, roslibjs) or `pkg/msg/Name`."""
    package, _, name = has.partition("/")
    return asked in ("", has, f"{package}/{name.rpartition('/')[2]}")


def publication(topic: str, content: str) -> str:
    """Return the text that carries a message, whose content is JSON already."""
    return f'{{"op":"publish","topic":{json.dumps(topic)},"msg":{content}}}'


def service_response(service: str, id: str | None, values: Any, result: bool) -> str:
    """Return the answer to a call; values: the response's fields, or what went wrong."""
    answer = {"op": "service_response", "service": service, "values": values, "result": result}
    return _text(answer, id)


def status(level: str, sentence: str, id: str | None = None) -> str:
    """Return a status message; level: error, warning, info or none."""
    return _text({"op": "status", "level": level, "msg": sentence}, id)


def _text(content: dict, id: str | None) -> str:
    if id is not None:
        content["id"] = id
    return json.dumps(content, allow_nan=False, separators=(",", ":"))
