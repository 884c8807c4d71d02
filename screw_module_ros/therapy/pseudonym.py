# SPDX-License-Identifier: Apache-2.0
"""Pseudonyms and the folders named after them: the only identification of patients here.

No name, no date of birth, no free text: who belongs to a pseudonym is written down elsewhere.
"""

from __future__ import annotations

import os
import re
import secrets
from pathlib import Path

ALPHABET = "23456789ABCDEFGHJKMNPQRSTVWXYZ"
"""Digits and capitals without those that are taken for one another: 0 O, 1 I L, U V."""
LENGTH = 5
PATTERN = re.compile(rf"P-[{ALPHABET}]{{{LENGTH}}}")
PRIVATE_FOLDER, PRIVATE_FILE = 0o700, 0o600


class PseudonymError(ValueError):
    """A text that is no pseudonym; the message names the format and the way out, not the text.

    The text may be a person's name, which must not get into a log.
    """


def new_pseudonym() -> str:
    """Return a random pseudonym, like P-7K3QX, one of 24 million."""
    return "P-" + "".join(secrets.choice(ALPHABET) for _ in range(LENGTH))


def checked_pseudonym(text: str) -> str:
    """Return a pseudonym unchanged. Raises PseudonymError on anything else."""
    if not isinstance(text, str) or not PATTERN.fullmatch(text):
        raise PseudonymError(
            f"that is no pseudonym: P- and {LENGTH} of {ALPHABET} are wanted, like P-7K3QX; no "
            "names, no free text (new pseudonyms come from `session new`)"
        )
    return text


def patient_folder(root: Path, pseudonym: str) -> Path:
    """Return the patient's folder below `root`, made if it is not there, for the owner alone.

    Raises PseudonymError, and OSError where it cannot be made or be kept private.
    """
    folder = root / checked_pseudonym(pseudonym)
    for each in (root, folder):
        each.mkdir(mode=PRIVATE_FOLDER, parents=True, exist_ok=True)
    folder.chmod(PRIVATE_FOLDER)
    return folder


def write_private(file: Path, content: bytes) -> None:
    """Write a file that only its owner can read, whole or not at all. Raises OSError."""
    part = file.with_name(f".{file.name}.part")
    part.unlink(missing_ok=True)
    descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, PRIVATE_FILE)
    with os.fdopen(descriptor, "wb") as stream:
        os.fchmod(stream.fileno(), PRIVATE_FILE)  # whatever the umask takes away or leaves
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    part.replace(file)
