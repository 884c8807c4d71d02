# SPDX-License-Identifier: Apache-2.0
"""Values in error messages: short, whatever they are.

`repr` of a foreign value may take minutes and hundreds of megabytes: a list of lists of the same
lists, a text of a million characters, an integer that Python refuses to print.
"""

from __future__ import annotations

import reprlib
from typing import Any

LONGEST = 80
"""Characters of a quotation."""
_BITS = 4 * LONGEST


class _Short(reprlib.Repr):
    """Looks three levels deep at four entries each, and at no more of a text than is shown."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 3
        self.maxdict = self.maxlist = self.maxtuple = self.maxset = self.maxfrozenset = 4
        self.maxstring = self.maxother = LONGEST

    def repr_int(self, value: int, _level: int) -> str:
        if value.bit_length() > _BITS:
            return f"an integer of {value.bit_length()} bits"
        return repr(value)

    def repr_bytes(self, value: bytes, _level: int) -> str:
        return repr(value[:LONGEST])

    def repr_instance(self, value: Any, level: int) -> str:
        if isinstance(value, (float, complex, bool, type(None))):
            return repr(value)
        return super().repr_instance(value, level)


_short = _Short()


def quoted(value: Any) -> str:
    """Return `repr` of a value, cut to 80 characters and without looking at all of it."""
    text = _short.repr(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def named(key: Any) -> str:
    """Return a key for a message: a text without quotes, anything else as `quoted`."""
    if not isinstance(key, str):
        return quoted(key)
    return key if len(key) <= LONGEST else f"{key[: LONGEST - 3]}..."
