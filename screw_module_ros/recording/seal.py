# SPDX-License-Identifier: Apache-2.0
"""Hashes over what the recorder notes in a bag: configuration, parameters, calibration identities.

Each value has a SHA-256 of its own, so that `session verify` can say which one was altered. The
values stand in the bag twice, in metadata.yaml and inside the last MCAP file, and what the messages
themselves say of their calibration is a third witness. All this guards against accidents and edits
by hand, not against forgery.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping

from .audit import byte_order

Sections = Mapping[str, Mapping[str, str]]

HASHES = "hashes"
PARAMETERS, CALIBRATION = "parameters", "calibration"
NO_ANSWER = "no answer"  # in place of the parameters of a node that did not tell them


def sealed(sections: Sections) -> dict[str, str]:
    """Return the hash of every value, under `section: name`."""
    return {
        f"{section}: {name}": f"sha256:{hashlib.sha256(value.encode()).hexdigest()}"
        for section, values in sections.items()
        if section != HASHES
        for name, value in values.items()
    }


def broken(noted: Sections, inside: Sections | None) -> Iterator[str]:
    """Say what in the noted values does not fit its hash, or what stands `inside`.

    noted: from metadata.yaml. inside: from the last file, None when it is cut off.
    """
    hashes = noted.get(HASHES, {})
    found = sealed(noted)
    for name in sorted({*hashes, *found}):
        if name not in hashes:
            yield f"{name}: has no hash: it was added, or recorded by an older version"
        elif name not in found:
            yield f"{name}: was noted when it was recorded and is missing now"
        elif found[name] != hashes[name]:
            yield f"{name}: was altered: it does not fit the hash it was recorded with"
    if inside is not None:
        for name in sorted({*noted, *inside}):
            if dict(noted.get(name, {})) != dict(inside.get(name, {})):
                yield f"{name}: metadata.yaml and the last file of the bag differ"
    for node, values in noted.get(PARAMETERS, {}).items():
        if values == NO_ANSWER:
            yield f"{PARAMETERS}: {node}: it did not tell its parameters"


def disowned(noted: Sections, newest: Mapping[str, bytes]) -> Iterator[str]:
    """Say which topics name another calibration in their last message than noted.

    newest: the last message (CDR) of each topic.
    """
    for topic, identity in noted.get(CALIBRATION, {}).items():
        if topic in newest and not _holds(newest[topic], identity):
            yield f"{CALIBRATION}: {topic}: its messages name another one than {identity!r}"


def _holds(data: bytes, text: str) -> bool:
    """Whether a CDR message holds exactly this string: its length, itself, and a zero."""
    content = text.encode() + b"\0"
    return len(content).to_bytes(4, byte_order(data)) + content in data
