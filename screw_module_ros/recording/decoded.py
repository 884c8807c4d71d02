# SPDX-License-Identifier: Apache-2.0
"""Decodes whole bags: messages, or every field of a topic as an array over time.

The records are read by `records.File`, as for every other command; rosbags decodes their content.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from .bag import BagError, Message, Topic
from .bag_files import files_of
from .records import File, chosen


class BagMessage(NamedTuple):
    """One message of a bag.

    topic, type: as recorded. log_time: time of reception [ns since the epoch]. message: decoded,
    with fields as attributes and arrays of numbers as numpy arrays.
    """

    topic: str
    type: str
    log_time: int
    message: Any


@cache
def _store(kind: str, text: str, encoding: str) -> Any:
    """Return what decodes messages of a type by its definition; bags of one version share it."""
    store = get_typestore(Stores.EMPTY)
    types = get_types_from_idl(text) if encoding == "ros2idl" else get_types_from_msg(text, kind)
    store.register(types)
    return store


def _decoded(topic: Topic, data: bytes) -> Any:
    """Return a message by the definition in its bag."""
    definition = topic.definition
    store = _store(topic.type, definition.text, definition.encoding)
    return store.deserialize_cdr(data, topic.type)


def _messages(
    path: Path | str,
    wanted: Callable[[Topic], bool] | None,
    remarks: list[str] | None,
    held: dict[str, Topic],
    by_index: bool = False,
) -> Iterator[tuple[Topic, Message]]:
    """Yield messages; `held` gets all topics. Raises BagError where the bag is damaged."""
    for file in map(File, files_of(path)):
        for found in file.indexed(wanted) if by_index else file.messages(wanted):
            if file.problems:
                break
            yield found
        if file.problems:
            raise BagError(
                f"cannot read {path} as a bag: {file.problems[0]}; if it is cut off or damaged, "
                f"run: session recover {path}"
            )
        held |= {topic.name: topic for topic in file.topics.values()}
        if remarks is not None and file.stated not in (None, file.read):
            remarks.append(
                f"{file.path.name} states {file.stated} messages and holds {file.read}: "
                f"session verify {path} tells what is missing"
            )


def topics(path: Path | str) -> dict[str, str]:
    """Return the type of each topic of the bag, by name. Raises BagError."""
    held: dict[str, Topic] = {}
    for _ in _messages(path, lambda topic: False, None, held, by_index=True):
        pass
    return {name: topic.type for name, topic in held.items()}


def read_bag(
    path: Path | str,
    names: Collection[str] | None = None,
    remarks: list[str] | None = None,
    by_index: bool = False,
) -> Iterator[BagMessage]:
    """Yield the decoded messages of the topics `names` (all by default).

    Those of one topic come in the order in which they were recorded. remarks: gets a sentence for
    each file that does not hold the number of messages that it states. by_index: read nothing but
    what the index names, so no such sentence. Raises BagError when the bag cannot be read, is
    damaged or lacks a topic.
    """
    held: dict[str, Topic] = {}
    for topic, record in _messages(path, chosen(names), remarks, held, by_index):
        try:
            message = _decoded(topic, record.data)
        except Exception as error:  # whatever a parser or a decoder stumbles over
            told = f"{path}: a message of {topic.name} cannot be decoded: {error}"
            raise BagError(told) from None
        yield BagMessage(topic.name, topic.type, record.log_time, message)
    if missing := sorted(set(names or ()) - set(held)):
        raise BagError(
            f"{path} holds no {', '.join(missing)}; it holds: {', '.join(sorted(held))}"
        )


def calibrations(path: Path | str) -> dict[str, str]:
    """Return the calibration that the last message of each topic names, by topic."""
    newest: dict[str, tuple[Topic, bytes]] = {}
    for topic, record in _messages(
        path, lambda topic: "string calibration" in topic.definition.text, None, {}
    ):
        newest[topic.name] = topic, record.data
    return {
        name: found
        for name, last in newest.items()
        if isinstance(found := getattr(_decoded(*last), "calibration", 0), str)
    }


def columns(path: Path | str, topic: str) -> dict[str, np.ndarray]:
    """Return every field of `topic` as an array over the messages, in the order of recording.

    Nested fields have dotted names (`position.x`); arrays of numbers with constant length become
    two-dimensional; texts become arrays of objects. `log_time` is added [ns since the epoch]. Units
    as in the message definitions (SI). Raises BagError if the bag lacks the topic.
    """
    found = list(read_bag(path, [topic]))
    made = {"log_time": np.array([each.log_time for each in found], dtype=np.int64)}
    if found:
        for name, get in _getters(found[0].message):
            made[name] = _array([get(each.message) for each in found])
    return made


def _getters(sample: Any, prefix: str = "") -> Iterator[tuple[str, Callable[[Any], Any]]]:
    """Yield (dotted name, getter) of every plain field of a message like `sample`."""
    inner = attrgetter(prefix.rstrip("."))(sample) if prefix else sample
    for field in fields(inner):
        if field.name.startswith("__") or field.name.isupper():
            continue
        name = f"{prefix}{field.name}"
        if is_dataclass(attrgetter(name)(sample)):
            yield from _getters(sample, f"{name}.")
        else:
            yield name, attrgetter(name)


def _array(values: list[Any]) -> np.ndarray:
    first = values[0]
    if isinstance(first, np.ndarray) and len({value.shape for value in values}) == 1:
        return np.stack(values)
    if isinstance(first, (bool, int, float)):
        return np.array(values)
    found = np.empty(len(values), dtype=object)
    found[:] = values
    return found
