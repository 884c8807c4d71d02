# SPDX-License-Identifier: Apache-2.0
"""Decodes whole bags with rosbags: messages, or every field of a topic as an array over time."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.highlevel import AnyReader

from .bag import BagError


class BagMessage(NamedTuple):
    """One message of a bag.

    topic, type: as recorded. log_time: time of reception [ns since the epoch]. message: decoded,
    with fields as attributes and arrays of numbers as numpy arrays.
    """

    topic: str
    type: str
    log_time: int
    message: Any


@contextmanager
def _reader(path: Path | str) -> Iterator[AnyReader]:
    """Open a bag folder or .mcap file with rosbags. Raises BagError if it cannot be read."""
    if not Path(path).exists():
        raise BagError(f"there is no bag {path}")
    try:
        with AnyReader([Path(path)]) as reader:
            yield reader
    except BagError:
        raise
    except Exception as error:  # rosbags raises various exceptions on a damaged bag
        hint = f"if it is cut off or damaged, run: session recover {path}"
        raise BagError(f"cannot read {path} as a bag: {error}; {hint}") from None


def topics(path: Path | str) -> dict[str, str]:
    """Return the type of each topic of the bag, by name."""
    with _reader(path) as reader:
        return {each.topic: str(each.msgtype) for each in reader.connections}


def read_bag(path: Path | str, names: Collection[str] | None = None) -> Iterator[BagMessage]:
    """Yield the decoded messages of the topics `names` (all by default) in order of log time.

    Raises BagError when the bag cannot be read, is damaged or lacks a topic.
    """
    with _reader(path) as reader:
        known = {each.topic for each in reader.connections}
        if missing := sorted(set(names or ()) - known):
            held = ", ".join(sorted(known))
            raise BagError(f"{path} holds no {', '.join(missing)}; it holds: {held}")
        chosen = [each for each in reader.connections if names is None or each.topic in names]
        for each, log_time, data in reader.messages(chosen) if chosen else ():
            kind = str(each.msgtype)
            yield BagMessage(each.topic, kind, log_time, reader.deserialize(data, kind))


def calibrations(path: Path | str) -> dict[str, str]:
    """Return the calibration that the last message of each topic names, by topic."""
    newest = {}
    with _reader(path) as reader:
        named = [each for each in reader.connections if "string calibration" in each.msgdef.data]
        for each, _, data in reader.messages(named) if named else ():
            newest[each.topic] = each.msgtype, data
        return {
            topic: found
            for topic, (kind, data) in newest.items()
            if isinstance(found := getattr(reader.deserialize(data, kind), "calibration", 0), str)
        }


def columns(path: Path | str, topic: str) -> dict[str, np.ndarray]:
    """Return every field of `topic` as an array over the messages, in order of log time.

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
