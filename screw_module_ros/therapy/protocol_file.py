# SPDX-License-Identifier: Apache-2.0
"""Protocols as YAML files, with strict checks, as they determine forces on a patient.

A missing or unknown key or a value out of range is refused with a message that names it.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from ..plain_yaml import PlainYamlError, load_plain_yaml
from ..regular_file import read_regular
from ..resources import resource_path
from ..settings_mapping import from_mapping
from .protocol import Protocol

SHIPPED = ("evaluation", "clock_adaptive", "elevator", "reach_3d")
"""Protocols that come with the package."""
_LARGEST = 100_000  # bytes; the packaged files have a few thousand


class ProtocolError(ValueError):
    """A protocol file that cannot be used; the message names file, key and way out."""


def load_protocol(name: str | Path) -> Protocol:
    """Return a protocol: a packaged one by its name, or a YAML file by its path.

    Raises ProtocolError.
    """
    return parse_protocol(protocol_text(name), str(name))


def protocol_text(name: str | Path) -> str:
    """Return a protocol's YAML, name as in `load_protocol`. Raises ProtocolError."""
    file = resource_path(f"params/therapy/{name}.yaml") if str(name) in SHIPPED else Path(name)
    try:
        return read_regular(file, _LARGEST).decode("utf-8")
    except (OSError, UnicodeDecodeError):
        raise ProtocolError(
            f"no protocol {str(name)!r}: name a YAML file, or one of {', '.join(SHIPPED)}"
        ) from None


def sha256(text: str) -> str:
    """Return the SHA-256 of a protocol's YAML, its identity in records, as hexadecimal."""
    return hashlib.sha256(text.encode()).hexdigest()


def parse_protocol(text: str, name: str) -> Protocol:
    """Return the protocol of a YAML text; name: for messages. Raises ProtocolError."""
    try:
        return read_protocol(load_plain_yaml(text, aliases=True))  # circuits repeat themselves
    except PlainYamlError as error:
        raise ProtocolError(f"protocol {name}: cannot be read as YAML: {error}") from None
    except ValueError as error:
        raise ProtocolError(f"protocol {name}: {error}") from None


def read_protocol(content: Any) -> Protocol:
    """Return the protocol of a file's content. Raises ValueError naming the wrong key."""
    return from_mapping(Protocol, content).validated()
