# SPDX-License-Identifier: Apache-2.0
"""Maps the channels of a file to topics, from the readable records.

A channel is declared in the first chunk that needs it, and again in the index at the file's end. If
damage has destroyed both, the bag's other files have the declaration (a topic has the same channel
in all files), or metadata.yaml, which lists the topics in the order of their channels.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from mcap.records import Channel, Schema

from .definitions import UNKNOWN, Definition, Definitions
from .errors import DefinitionError
from .metadata import TopicLine
from .scan import Outside


class Declared(NamedTuple):
    """A channel with its schema."""

    channel: Channel
    schema: Schema

    @property
    def text(self) -> str:
        """The definition of its type."""
        return self.schema.data.decode(errors="replace")


Declarations = dict[int, Declared]  # by the channel's id


class Gatherer:
    """Joins schemas and channels to declarations."""

    def __init__(self) -> None:
        self.found: Declarations = {}
        self._schemas: dict[int, Schema] = {}

    def take(self, schemas: Iterable[Schema], channels: Iterable[Channel]) -> None:
        """Add declarations; a later one replaces an earlier one of the same id."""
        self._schemas.update((schema.id, schema) for schema in schemas)
        for channel in channels:
            if channel.schema_id in self._schemas:
                self.found[channel.id] = Declared(channel, self._schemas[channel.schema_id])

    def take_outside(self, records: Iterable[Outside]) -> None:
        """Add declarations from outside of chunks."""
        for found in records:
            if isinstance(found.record, Schema):
                self.take([found.record], ())
            elif isinstance(found.record, Channel):
                self.take((), [found.record])


def resolved(
    own: Mapping[int, Declared],
    others: Mapping[int, Declared],
    topics: Sequence[TopicLine],
    used: Iterable[int],
) -> Declarations:
    """Return a file's channels: its `own`, and the best substitute for undeclared ones.

    others: of the bag's other files. topics: of metadata.yaml. used: channel ids of messages.
    """
    found = dict(own)
    known = {**others, **own}
    if any(known[n].channel.topic != t.name for n, t in enumerate(topics, 1) if n in known):
        topics = ()  # the list was sorted: its order is not that of the channels
    for number in used:
        if number in found:
            continue
        if number in others:
            best = others[number]
        elif 0 < number <= len(topics):
            best = _from_noted(number, topics[number - 1])
        else:
            name = f"/unknown/channel_{number}"
            best = _from_noted(number, TopicLine(name, "unknown_msgs/msg/Unknown", "", "[]", 0))
        found[number] = _adopted(best, found)
    return found


def _from_noted(number: int, topic: TopicLine) -> Declared:
    definition = _installed(topic)
    schema = Schema(number, definition.text.encode(), definition.encoding, topic.type)
    metadata = {"offered_qos_profiles": topic.qos, "topic_type_hash": topic.type_hash}
    return Declared(Channel(number, topic.name, "cdr", metadata, schema.id), schema)


def _adopted(new: Declared, known: Mapping[int, Declared]) -> Declared:
    """Return `new` with the known schema of its type, or with its own under a free id."""
    schemas = {declared.schema.name: declared.schema for declared in known.values()}
    schema = schemas.get(new.schema.name)
    if schema is None:
        # From the top, as lost declarations of this file have low ids (from 1).
        used = {schema.id for schema in schemas.values()}
        free = next(number for number in range(0xFFFF, 0, -1) if number not in used)
        schema = Schema(free, new.schema.data, new.schema.encoding, new.schema.name)
    old = new.channel
    return Declared(
        Channel(old.id, old.topic, old.message_encoding, old.metadata, schema.id), schema
    )


def _installed(topic: TopicLine) -> Definition:
    """Return the installed definition if it has the recorded type hash, else UNKNOWN."""
    try:
        found = Definitions().find(topic.type)
    except (DefinitionError, UnicodeDecodeError):
        return UNKNOWN
    return found if found.type_hash == topic.type_hash else UNKNOWN
