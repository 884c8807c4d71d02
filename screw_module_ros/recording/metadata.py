# SPDX-License-Identifier: Apache-2.0
"""metadata.yaml of a bag, version 9 as in rosbag2 of Jazzy.

The text is composed key by key in rosbag2's order: the recorder writes it about once a second, and
a YAML library would take more time than the recording itself.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

VERSION = 9
DISTRIBUTION = "jazzy"
NOT_YET = 2**63 - 1  # rosbag2's start time of a bag without messages
_INFINITE = (9_223_372_036, 854_775_807)  # rmw's infinite duration [s, ns]


class Qos(NamedTuple):
    """Quality of service that one publisher offers, in rosbag2's terms.

    deadline, lifespan, lease: (seconds, nanoseconds); the default is infinite.
    """

    reliability: str = "reliable"
    durability: str = "volatile"
    history: str = "unknown"
    depth: int = 0
    deadline: tuple[int, int] = _INFINITE
    lifespan: tuple[int, int] = _INFINITE
    liveliness: str = "automatic"
    lease: tuple[int, int] = _INFINITE
    avoid_ros_namespace_conventions: bool = False

    def as_yaml(self) -> str:
        """Return one entry of a YAML list."""
        return "\n".join(
            (
                f"- history: {self.history}",
                f"  depth: {self.depth}",
                f"  reliability: {self.reliability}",
                f"  durability: {self.durability}",
                *_duration("deadline", self.deadline),
                *_duration("lifespan", self.lifespan),
                f"  liveliness: {self.liveliness}",
                *_duration("liveliness_lease_duration", self.lease),
                "  avoid_ros_namespace_conventions: "
                + ("true" if self.avoid_ros_namespace_conventions else "false"),
            )
        )


def _duration(name: str, value: tuple[int, int]) -> tuple[str, ...]:
    return (f"  {name}:", f"    sec: {value[0]}", f"    nsec: {value[1]}")


def qos_yaml(offers: Sequence[Qos]) -> str:
    """Return the offers of a topic's publishers as rosbag2's YAML list."""
    return "\n".join(offer.as_yaml() for offer in offers) if offers else "[]"


class TopicLine(NamedTuple):
    """One topic of the bag: name, type, hash, offers as YAML, number of messages."""

    name: str
    type: str
    type_hash: str
    qos: str
    messages: int


class FileLine(NamedTuple):
    """One file of the bag: name, first and last log time [ns since the epoch], messages."""

    name: str
    start_time: int
    end_time: int
    messages: int


def information(
    topics: Sequence[TopicLine], files: Sequence[FileLine], custom: Mapping[str, str]
) -> str:
    """Return the bag's information as YAML, without the key `rosbag2_bagfile_information`."""
    filled = [file for file in files if file.messages]
    start = min((file.start_time for file in filled), default=NOT_YET)
    end = max((file.end_time for file in filled), default=NOT_YET)
    lines = [
        f"version: {VERSION}",
        "storage_identifier: mcap",
        "duration:",
        f"  nanoseconds: {end - start}",
        "starting_time:",
        f"  nanoseconds_since_epoch: {start}",
        f"message_count: {sum(file.messages for file in files)}",
        "topics_with_message_count:" if topics else "topics_with_message_count: []",
        *(_topic(topic) for topic in topics),
        'compression_format: ""',
        'compression_mode: ""',
        "relative_file_paths:",
        *(f"  - {_quoted(file.name)}" for file in files),
        "files:",
        *(_file(file) for file in files),
        "custom_data:" if custom else "custom_data: ~",
        *(f"  {_quoted(key)}: {_quoted(value)}" for key, value in custom.items()),
        f"ros_distro: {DISTRIBUTION}",
    ]
    return "\n".join(lines) + "\n"


def document(text: str) -> str:
    """Return the content of metadata.yaml from the text of `information`."""
    return "rosbag2_bagfile_information:\n" + _indented(text, 2)


def _topic(topic: TopicLine) -> str:
    offers = " []" if topic.qos == "[]" else "\n" + _indented(topic.qos, 8).rstrip("\n")
    return "\n".join(
        (
            "  - topic_metadata:",
            f"      name: {_quoted(topic.name)}",
            f"      type: {_quoted(topic.type)}",
            "      serialization_format: cdr",
            f"      offered_qos_profiles:{offers}",
            f"      type_description_hash: {_quoted(topic.type_hash)}",
            f"    message_count: {topic.messages}",
        )
    )


def _file(file: FileLine) -> str:
    start = file.start_time if file.messages else NOT_YET
    duration = file.end_time - file.start_time if file.messages else 0
    return "\n".join(
        (
            f"  - path: {_quoted(file.name)}",
            "    starting_time:",
            f"      nanoseconds_since_epoch: {start}",
            "    duration:",
            f"      nanoseconds: {duration}",
            f"    message_count: {file.messages}",
        )
    )


def _indented(text: str, by: int) -> str:
    return "".join(f"{' ' * by}{line}\n" for line in text.splitlines())


def decoded(text: str) -> dict[str, Any]:
    """Return the JSON object in `text`, empty if there is none."""
    try:
        values = json.loads(text)
    except (TypeError, ValueError, RecursionError):
        return {}
    return values if isinstance(values, dict) else {}


def _quoted(text: str) -> str:
    """Return a double-quoted YAML scalar; YAML includes JSON's escapes."""
    return json.dumps(text)
