# SPDX-License-Identifier: Apache-2.0
"""Emergencies by name (CiA 301 table 26, CiA 402-2 table of error codes, object 1001 bits).

`emcy_codes.csv` holds the names of codes and of whole groups: a group's low digits are zeros.
"""

from __future__ import annotations

import csv
import struct
from typing import NamedTuple

from ..resources import resource_path

_LAYOUT = struct.Struct("<HB5s")
_SHORTEST = 2  # bytes of the code
with resource_path("devices/emcy_codes.csv").open(newline="") as _file:
    _NAMES = {int(row["code"], 16): row["name"] for row in csv.DictReader(_file)}

_REGISTER_BITS = (
    "generic", "current", "voltage", "temperature",
    "communication", "device profile", "reserved", "manufacturer",
)  # fmt: skip


class Emergency(NamedTuple):
    """One emergency message: error code, error register (object 1001), five vendor bytes."""

    code: int
    register: int
    vendor: bytes

    @property
    def is_reset(self) -> bool:
        """Whether the message reports the end of an error."""
        return self.code & 0xFF00 == 0

    @property
    def text(self) -> str:
        """Code, name, register and vendor data as text."""
        parts = [f"0x{self.code:04X} {code_name(self.code)}"]
        if names := [name for bit, name in enumerate(_REGISTER_BITS) if self.register >> bit & 1]:
            parts.append(f"register: {', '.join(names)}")
        if any(self.vendor):
            parts.append(f"vendor data {self.vendor.hex(' ')}")
        return "; ".join(parts)


def decode(data: bytes) -> Emergency | None:
    """Return the emergency in `data`, None when `data` has not even a code.

    CiA 301 wants 8 bytes. Of a shorter frame what is there counts, the rest is zero.
    """
    if len(data) < _SHORTEST:
        return None
    return Emergency(*_LAYOUT.unpack(data[: _LAYOUT.size].ljust(_LAYOUT.size, b"\0")))


def code_name(code: int) -> str:
    """Return the name of an error code, or of its group if the code has no name."""
    for group in (code, code & 0xFFF0, code & 0xFF00, code & 0xF000 or code):
        if group in _NAMES:  # 0x0100 to 0x0FFF are of no group: 0x0000 does not name them
            return _NAMES[group]
    return "unknown error"
