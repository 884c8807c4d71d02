# SPDX-License-Identifier: Apache-2.0
"""Hashes of the recorder's metadata in a bag: configuration, parameters, calibration identities.

Each value has its own SHA-256, so that `session verify` can name an altered one. The bag has the
values twice, in metadata.yaml and in the last MCAP file; the messages also name their calibration.
The hashes detect accidents and manual edits, but not forgery.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping

from .audit import byte_order

Sections = Mapping[str, Mapping[str, str]]

HASHES = "hashes"
PARAMETERS, CALIBRATION = "parameters", "calibration"
NO_ANSWER = "no answer"  # in place of the parameters of a node that did not answer


def sealed(sections: Sections) -> dict[str, str]:
    """Return the hash of every value, under `section: name`."""
    return {
        f"{section}: {name}": f"sha256:{hashlib.sha256(value.encode()).hexdigest()}"
        for section, values in sections.items()
        if section != HASHES
        for name, value in values.items()
    }


def broken(noted: Sections, inside: Sections | None) -> Iterator[str]:
    """Yield a sentence for each value that does not match its hash or the values `inside`.

    noted: from metadata.yaml. inside: from the last file, None if it is cut off.
    """
    hashes = noted.get(HASHES, {})
    found = sealed(noted)
    for name in sorted({*hashes, *found}):
        if name not in hashes:
            yield f"{name}: has no hash: it was added, or recorded by an older version"
        elif name not in found:
            yield f"{name}: was recorded and is missing now"
        elif found[name] != hashes[name]:
            yield f"{name}: was altered: it does not match its recorded hash"
    if inside is not None:
        for name in sorted({*noted, *inside}):
            if dict(noted.get(name, {})) != dict(inside.get(name, {})):
                yield f"{name}: metadata.yaml and the last file of the bag differ"
    for node, values in noted.get(PARAMETERS, {}).items():
        if values == NO_ANSWER:
            yield f"{PARAMETERS}: {node}: the node did not report its parameters"


def disowned(noted: Sections, newest: Mapping[str, bytes]) -> Iterator[str]:
    """Yield a sentence for each topic whose last message does not name the recorded calibration.

    newest: the last message (CDR) of each topic.
    """
    for topic, identity in noted.get(CALIBRATION, {}).items():
        if topic in newest and not _holds(newest[topic], identity):
            yield f"{CALIBRATION}: {topic}: its messages name another one than {identity!r}"


def _holds(data: bytes, text: str) -> bool:
    """Whether a CDR message contains exactly this string, with its length and final zero."""
    content = text.encode() + b"\0"
    return len(content).to_bytes(4, byte_order(data)) + content in data
