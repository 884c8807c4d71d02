# SPDX-License-Identifier: Apache-2.0
"""Pseudonyms, the only identification of patients here, and the folders named after them.

There are no names, dates of birth or free texts: the list of patients and pseudonyms is kept
elsewhere.
"""

from __future__ import annotations

import re
import secrets
from datetime import datetime, timezone
from pathlib import Path

from ..files import PRIVATE_FOLDER

ALPHABET = "23456789ABCDEFGHJKMNPQRSTVWXYZ"
"""Digits and capitals without easily confused ones: 0 O, 1 I L, U."""
LENGTH = 5
_FORM = rf"P-[{ALPHABET}]{{{LENGTH}}}"
NAMED_DATE = "%Y_%m_%d-%H_%M_%S"
"""Date in a name: in UTC, with a Z behind it, so that names sort and say one moment."""
PATTERN = re.compile(rf"(?=.*[2-9]){_FORM}")
"""With a digit: else a name of five letters would be one."""


class PseudonymError(ValueError):
    """The text is not a pseudonym. The message names the format, but not the text.

    The text may be a person's name, which must not appear in a log.
    """


def new_pseudonym() -> str:
    """Return a random pseudonym, like P-7K3QX, one of 19 million."""
    while True:
        made = "P-" + "".join(secrets.choice(ALPHABET) for _ in range(LENGTH))
        if PATTERN.fullmatch(made):
            return made


def checked_pseudonym(text: str) -> str:
    """Return a valid pseudonym unchanged. Raises PseudonymError for any other text."""
    if not isinstance(text, str) or not PATTERN.fullmatch(text):
        raise PseudonymError(
            f"not a pseudonym: the form is P- and {LENGTH} of {ALPHABET} with a digit, like "
            "P-7K3QX; no names, no free text (`session new` makes new pseudonyms)"
        )
    return text


def date_in_name() -> str:
    """Return the present time as the names of bags and of the folders of runs have it."""
    return f"{datetime.now(timezone.utc):{NAMED_DATE}Z}"


def owner(bag: str) -> str:
    """Return the pseudonym with which the name of a session's bag begins, empty without one."""
    first, _, rest = bag.partition("_")
    return first if rest and PATTERN.fullmatch(first) else ""


def patient_folder(root: Path, pseudonym: str) -> Path:
    """Make and return the patient's folder below `root`, which only the owner can read.

    Bags of older versions may have a pseudonym without a digit. Raises PseudonymError, and OSError
    if it cannot be made private.
    """
    if not (isinstance(pseudonym, str) and re.fullmatch(_FORM, pseudonym)):
        checked_pseudonym(pseudonym)
    folder = root / pseudonym
    for each in (root, folder):
        each.mkdir(mode=PRIVATE_FOLDER, parents=True, exist_ok=True)
    folder.chmod(PRIVATE_FOLDER)
    return folder
