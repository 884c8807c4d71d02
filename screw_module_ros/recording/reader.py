# SPDX-License-Identifier: Apache-2.0
"""Reads bags for figures, reports and audits, with rosbags as decoder.

`columns` is for figures: every field of a topic as an array over time. `read_bag` yields decoded
messages. `raw_messages` yields them as bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from .bag import PREFIX
from .errors import BagReadError
from .metadata import decoded
from .noted import read_noted


class BagMessage(NamedTuple):
    """One message of a bag.

    topic, type: as recorded. log_time: time of reception [ns since the epoch]. message: decoded,
    with fields as attributes and arrays of numbers as numpy arrays.
    """

    topic: str
    type: str
    log_time: int
    message: Any


class RawMessage(NamedTuple):
    """One message of a bag as CDR bytes; `log_time` in ns since the epoch."""

    topic: str
    type: str
    log_time: int
    data: bytes


class TopicSummary(NamedTuple):
    """Type, number of messages and ros2msg definition of one topic."""

    type: str
    messages: int
    definition: str


@contextmanager
def open_bag(path: Path | str) -> Iterator[AnyReader]:
    """Open the bag folder (or .mcap file) `path` with rosbags' reader.

    Raises BagReadError if it is not a readable bag.
    """
    path = Path(path)
    try:
        reader = AnyReader([path])
        reader.open()
    except Exception as error:  # rosbags raises various exceptions on a damaged bag
        if not path.exists():
            raise BagReadError(f"there is no bag {path}") from None
        hint = f"; if it was cut off, run: session recover {path}"
        raise BagReadError(f"cannot read {path} as a bag: {error}{hint}") from None
    try:
        yield reader
    finally:
        reader.close()


def topics(path: Path | str) -> dict[str, TopicSummary]:
    """Return the summary of each topic of the bag, by name."""
    with open_bag(path) as reader:
        return {
            c.topic: TopicSummary(c.msgtype, c.msgcount, str(c.msgdef.data))
            for c in reader.connections
        }


def metadata(path: Path | str) -> dict[str, Any]:
    """Return the recorder's metadata of a bag folder: state, audit, configuration and so on.

    Keys are without the recorder's prefix. A bag of rosbag2 gives an empty dict. Raises
    BagReadError.
    """
    try:
        custom = read_noted(Path(path)).custom
    except BagReadError as error:
        raise BagReadError(f"cannot read {path}: {error}") from None
    return {
        key.removeprefix(PREFIX): decoded(value) if value[:1] == "{" else value
        for key, value in custom.items()
        if key.startswith(PREFIX)
    }


def raw_messages(path: Path | str, names: Collection[str] | None = None) -> Iterator[RawMessage]:
    """Yield the messages of the topics `names` (all by default) in order of log time.

    Raises BagReadError as `read_bag` does.
    """
    with open_bag(path) as reader:
        for connection, log_time, data in _messages(reader, path, names):
            yield RawMessage(connection.topic, connection.msgtype, log_time, data)


def read_bag(path: Path | str, names: Collection[str] | None = None) -> Iterator[BagMessage]:
    """Yield the decoded messages of the topics `names` (all by default) in order of log time.

    Raises BagReadError when the bag cannot be read, is damaged or lacks a topic.
    """
    with open_bag(path) as reader:
        decode = reader.deserialize
        for connection, log_time, data in _messages(reader, path, names):
            kind = connection.msgtype
            yield BagMessage(connection.topic, kind, log_time, decode(data, kind))


def columns(path: Path | str, topic: str) -> dict[str, np.ndarray]:
    """Return every field of `topic` as an array over the messages, in order of log time.

    Nested fields have dotted names (`position.x`); arrays of numbers with constant length become
    two-dimensional; texts become arrays of objects. `log_time` is added [ns since the epoch]. Units
    as in the message definitions (SI). Raises BagReadError if the bag lacks the topic.
    """
    times: list[int] = []
    messages: list[Any] = []
    for _, _, log_time, message in read_bag(path, [topic]):
        times.append(log_time)
        messages.append(message)
    found = {"log_time": np.array(times, dtype=np.int64)}
    if messages:
        for name, get in _getters(messages[0]):
            found[name] = _array([get(message) for message in messages])
    return found


def _getters(sample: Any, prefix: str = "") -> Iterator[tuple[str, Callable[[Any], Any]]]:
    """Yield (dotted name, getter) of every plain field of a message like `sample`."""
    for field in fields(sample):
        if field.name.startswith("__") or field.name.isupper():
            continue
        name = f"{prefix}{field.name}"
        value = getattr(sample, field.name)
        if is_dataclass(value):
            yield from ((n, _through(field.name, g)) for n, g in _getters(value, f"{name}."))
        else:
            yield name, attrgetter(field.name)


def _through(name: str, get: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda message: get(getattr(message, name))


def _array(values: list[Any]) -> np.ndarray:
    first = values[0]
    if isinstance(first, np.ndarray) and len({value.shape for value in values}) == 1:
        return np.stack(values)
    if isinstance(first, (bool, int, float)):
        return np.array(values)
    found = np.empty(len(values), dtype=object)
    found[:] = values
    return found


def _messages(
    reader: AnyReader, path: Path | str, names: Collection[str] | None
) -> Iterator[tuple[Connection, int, bytes]]:
    found = reader.messages(_chosen(reader, path, names))
    while True:
        try:
            message = next(found, None)
        except Exception as error:  # a damaged chunk: what its decompression stumbles over
            hint = f"run: session recover {path}"
            raise BagReadError(f"cannot read {path}, it is damaged: {error}; {hint}") from None
        if message is None:
            return
        yield message


def _chosen(reader: AnyReader, path: Path | str, names: Collection[str] | None) -> list[Connection]:
    if names is None:
        return list(reader.connections)
    missing = set(names) - {connection.topic for connection in reader.connections}
    if missing:
        known = ", ".join(sorted(connection.topic for connection in reader.connections))
        raise BagReadError(f"{path} holds no {', '.join(sorted(missing))}; it holds: {known}")
    return [connection for connection in reader.connections if connection.topic in names]
