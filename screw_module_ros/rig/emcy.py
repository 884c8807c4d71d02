# SPDX-License-Identifier: Apache-2.0
"""Errors of a simulated device: error register, history and EMCY (CiA 301, section 7.2.7).

Objects 1001 (register), 1003 (history, newest first), 1014 (COB-ID). A frame goes out when an error
appears and, with code 0000, when one goes; an error that lasts is reported once.
"""

from __future__ import annotations

import struct
from functools import partial

from screw_module_ros.rig.object_dictionary import (
    INVALID_VALUE,
    NO_DATA,
    ObjectDictionary,
    Send,
    require,
)
from screw_module_ros.rig.pdo import ID_MASK, INVALID_BIT

_HISTORY = 0x1003
_LONGEST_HISTORY = 8
_FRAME = struct.Struct("<HB5s")
_BIT_OF_CLASS = {0x2: 0x02, 0x3: 0x04, 0x4: 0x08, 0x8: 0x10, 0xF: 0x80}
"""First digit of an error code -> bit of the error register: current, voltage, temperature,
communication, manufacturer."""


class ErrorLog:
    """The errors of one device; send: takes (CAN id, payload) while the NMT state allows EMCY.

    active: the present error codes, oldest first.
    """

    def __init__(self, node: ObjectDictionary, send: Send):
        self._node = node
        self._send = send
        self.active: list[int] = []
        self._history: list[int] = []
        node.sources[0x1001, 0] = self._register
        node.sources[_HISTORY, 0] = lambda: len(self._history)
        for number in range(1, _LONGEST_HISTORY + 1):
            node.sources[_HISTORY, number] = partial(self._entry, number)
        node.checks.append(self._check_write)

    def report(self, code: int, info: bytes = b"") -> None:
        """Report a new error; ignore one that is already reported."""
        if code not in self.active:
            self.active.append(code)
            self._history = [code, *self._history][:_LONGEST_HISTORY]
            self._emit(code, self._register(), info)

    def resolve(self, code: int) -> None:
        """Report the end of an error; ignore one that was not reported."""
        if code in self.active:
            self.active.remove(code)
            self._emit(0, self._register())

    def resolve_all(self) -> None:
        """Clear every present error, with one EMCY 0000."""
        if self.active:
            self.active.clear()
            self._emit(0, 0)

    def restart(self) -> None:
        """Restart without errors and without a frame."""
        self.active.clear()
        self._history.clear()

    def pretend(self, code: int) -> None:
        """Send the frame of an error that is not there."""
        self._emit(code, _register_bits(code) if code > 0xFF else 0)

    def _emit(self, code: int, register: int, info: bytes = b"") -> None:
        cob_id = self._node.value(0x1014)
        if not cob_id & INVALID_BIT:
            self._send(cob_id & ID_MASK, _FRAME.pack(code, register, info))

    def _register(self) -> int:
        bits = 0
        for code in self.active:
            bits |= _register_bits(code)
        return bits

    def _entry(self, number: int) -> int:
        require(number <= len(self._history), NO_DATA)
        return self._history[number - 1]

    def _check_write(self, index: int, _subindex: int, value: int) -> None:
        if index == _HISTORY:
            require(value == 0, INVALID_VALUE)
            self._history.clear()


def _register_bits(code: int) -> int:
    """Return the bits of the error register that an error code sets."""
    return 0x01 | _BIT_OF_CLASS.get(code >> 12, 0)
