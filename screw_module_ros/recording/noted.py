# SPDX-License-Identifier: Apache-2.0
"""Reads metadata.yaml with checks of every part, as it may be damaged or edited."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from ..settings import SettingError, parse
from .audit import Counts
from .bag import AUDIT, METADATA_FILE, PREFIX, STATE
from .errors import BagReadError
from .files import read_text
from .metadata import TopicLine, decoded

_LIMIT = 2 * 2**20  # B; the parameters of all nodes take about 50 kB


class Noted(NamedTuple):
    """The content of metadata.yaml.

    topics: as listed, in the order of their channel ids (1, 2, ...). files: their names. custom:
    custom_data of the recorder and of others.
    """

    topics: tuple[TopicLine, ...] = ()
    files: tuple[str, ...] = ()
    custom: Mapping[str, str] = {}

    @property
    def state(self) -> str:
        """State of the recording, by the recorder; empty if another program wrote the bag."""
        return self.custom.get(STATE, "")

    @property
    def sections(self) -> dict[str, dict[str, str]]:
        """The recorder's sections without prefix; an unreadable one is empty."""
        return {name: _strings(text) for name, text in own(self.custom).items()}

    def audit(self, topic: str) -> Counts:
        """Return the recorder's last counts of a topic, zeros if they cannot be read."""
        values = decoded(self.custom.get(AUDIT, "")).get(topic)
        if not isinstance(values, dict):
            return Counts()
        return Counts(**{k: v for k, v in values.items() if k in Counts._fields and type(v) is int})


def read_noted(folder: Path) -> Noted:
    """Read metadata.yaml of the bag in `folder`. Raises BagReadError."""
    content = parsed(read_text(folder / METADATA_FILE, _LIMIT), METADATA_FILE)
    if not isinstance(content, dict):
        raise BagReadError(f"{METADATA_FILE} is no mapping")
    return noted_from(content.get("rosbag2_bagfile_information"))


def parsed(text: str, name: str) -> Any:
    """Return the content of a YAML text; name: for messages. Raises BagReadError."""
    try:
        return parse(text, name)
    except SettingError as error:
        raise BagReadError(str(error)) from None


def noted_from(information: Any) -> Noted:
    """Return the content of the mapping `information`. Raises BagReadError for missing keys."""
    if not isinstance(information, dict):
        raise BagReadError(f"{METADATA_FILE} has no rosbag2_bagfile_information")
    custom = information.get("custom_data")
    custom = custom if isinstance(custom, dict) else {}
    files = _list(information.get("relative_file_paths"))
    return Noted(
        tuple(_topic(line) for line in _list(information.get("topics_with_message_count"))),
        tuple(str(name) for name in files),
        {key: value for key, value in custom.items() if _is_text(key) and _is_text(value)},
    )


def _topic(line: Any) -> TopicLine:
    line = line if isinstance(line, dict) else {}
    topic = line.get("topic_metadata")
    topic = topic if isinstance(topic, dict) else {}
    name, kind, count = topic.get("name"), topic.get("type"), line.get("message_count")
    if not (_is_text(name) and _is_text(kind) and type(count) is int):
        raise BagReadError(f"{METADATA_FILE} has a topic without a name, a type or a count")
    qos = topic.get("offered_qos_profiles") or []
    text = qos if _is_text(qos) else yaml.safe_dump(qos, sort_keys=False).rstrip("\n")
    return TopicLine(name, kind, str(topic.get("type_description_hash") or ""), text, count)


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _is_text(value: Any) -> bool:
    """Whether this is a string that can be encoded."""
    return isinstance(value, str) and _writable(value)


def _writable(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _strings(text: str) -> dict[str, str]:
    values = {str(key): str(value) for key, value in decoded(text).items()}
    return values if all(map(_writable, [*values, *values.values()])) else {}


def own(custom: Mapping[str, Any]) -> dict[str, Any]:
    """Return the recorder's own entries of `custom`, without their prefix."""
    return {
        key.removeprefix(PREFIX): value
        for key, value in custom.items()
        if key.startswith(PREFIX) and key not in (STATE, AUDIT)
    }
