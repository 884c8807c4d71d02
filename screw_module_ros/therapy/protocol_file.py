# SPDX-License-Identifier: Apache-2.0
"""Protocols as YAML files, with strict checks, as they determine forces on a patient.

A missing or unknown key or a value out of range is refused with a message that names it.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from ..resources import resource_path
from ..settings import SettingError, parse, read, read_text
from .protocol import Protocol

SHIPPED = ("evaluation", "clock_adaptive", "elevator", "reach_3d")
"""Protocols that come with the package."""


def load_protocol(name: str | Path) -> Protocol:
    """Return a protocol: a packaged one by its name, or a YAML file by its path.

    Raises SettingError naming file, key and problem.
    """
    return parse_protocol(protocol_text(name), str(name))


def protocol_text(name: str | Path) -> str:
    """Return a protocol's YAML, name as in `load_protocol`. Raises SettingError."""
    file = resource_path(f"params/therapy/{name}.yaml") if str(name) in SHIPPED else Path(name)
    if str(name) not in SHIPPED and not file.is_file():
        raise SettingError(
            f"no protocol {str(name)!r}: name a YAML file, or one of {', '.join(SHIPPED)}"
        )
    return read_text(file)


def sha256(text: str) -> str:
    """Return the SHA-256 of a protocol's YAML, its identity in records, as hexadecimal."""
    return hashlib.sha256(text.encode()).hexdigest()


def parse_protocol(text: str, name: str) -> Protocol:
    """Return the protocol of a YAML text; name: for messages. Raises SettingError."""
    try:
        return read_protocol(parse(text, "it"))
    except ValueError as error:
        raise SettingError(f"protocol {name}: {error}") from None


def read_protocol(content: Any) -> Protocol:
    """Return the protocol of a file's content. Raises ValueError naming the wrong key."""
    return read(Protocol, content).validated()
