# SPDX-License-Identifier: Apache-2.0
"""Short quotations of any value, for error messages.

`repr` of a foreign value may take minutes and hundreds of megabytes: nested lists of the same
lists, a text of a million characters, an integer that Python refuses to print.
"""

from __future__ import annotations

import reprlib
from typing import Any

LONGEST = 80
"""Length of a quotation [characters]."""
_BITS = 4 * LONGEST


class _Short(reprlib.Repr):
    """Reads three levels with four entries each, and only the shown part of a text."""

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
    """Return `repr` of a value, cut to 80 characters, without reading the whole value."""
    text = _short.repr(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def named(key: Any) -> str:
    """Return a key for a message: a string without quotes, anything else as `quoted`."""
    if not isinstance(key, str):
        return quoted(key)
    return key if len(key) <= LONGEST else f"{key[: LONGEST - 3]}..."
