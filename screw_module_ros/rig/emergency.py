# SPDX-License-Identifier: Apache-2.0
"""Errors of a simulated device: error register, history and EMCY (CiA 301, section 7.2.7).

Objects 1001 (register), 1003 (history, newest first), 1014 (COB-ID). A frame goes out when an error
appears and, with code 0000, when one goes; an error that lasts is reported once.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from canopen.sdo.exceptions import SdoAbortedError

from screw_module_ros.rig.object_dictionary import INVALID_VALUE, NO_DATA, DeviceNode
from screw_module_ros.rig.pdo_rules import ID_MASK, INVALID_BIT

GENERIC, CURRENT, VOLTAGE, TEMPERATURE, COMMUNICATION, PROFILE, MANUFACTURER = (
    0x01,
    0x02,
    0x04,
    0x08,
    0x10,
    0x20,
    0x80,
)

_HISTORY = 0x1003
_LONGEST_HISTORY = 8
_INFO_LENGTH = 5
_FRAME = struct.Struct("<HB5s")
_REGISTER_OF_CLASS = {
    0x2: CURRENT,
    0x3: VOLTAGE,
    0x4: TEMPERATURE,
    0x8: COMMUNICATION,
    0xF: MANUFACTURER,
}


def register_bits(code: int) -> int:
    """Return the bits of the error register that an error code sets."""
    return GENERIC | _REGISTER_OF_CLASS.get(code >> 12, 0)


class ErrorLog:
    """The errors of one device.

    send: takes (CAN id, payload); may_send: returns whether the NMT state allows EMCY.
    """

    def __init__(
        self,
        node: DeviceNode,
        send: Callable[[int, bytes], None],
        may_send: Callable[[], bool],
    ):
        self._node = node
        self._send = send
        self._may_send = may_send
        self._active: dict[int, int] = {}
        self._history: list[int] = []
        node.sources[0x1001, 0] = lambda: self.register
        node.sources[_HISTORY, 0] = lambda: len(self._history)
        for number in range(1, _LONGEST_HISTORY + 1):
            node.sources[_HISTORY, number] = self._entry(number)
        node.checks.append(self._check_write)

    @property
    def register(self) -> int:
        """Object 1001."""
        bits = 0
        for code in self._active:
            bits |= register_bits(code)
        return bits

    @property
    def active(self) -> tuple[int, ...]:
        """The codes of the errors that last, oldest first."""
        return tuple(self._active)

    def report(self, code: int, info: bytes = b"") -> None:
        """Report a new error; ignore one that is already reported."""
        if code in self._active:
            return
        self._active[code] = code
        self._history = [code, *self._history][:_LONGEST_HISTORY]
        self.emit(code, self.register, info)

    def resolve(self, code: int) -> None:
        """Report the end of an error; ignore one that was not reported."""
        if self._active.pop(code, None) is not None:
            self.emit(0, self.register)

    def resolve_all(self) -> None:
        """Clear every present error, with one EMCY 0000."""
        if self._active:
            self._active.clear()
            self.emit(0, 0)

    def reset(self) -> None:
        """Restart without errors and without a frame."""
        self._active.clear()
        self._history.clear()

    def emit(self, code: int, register: int, info: bytes = b"") -> None:
        """Send one EMCY frame, whatever the state of the errors is."""
        cob_id = self._node.value(0x1014)
        if cob_id & INVALID_BIT or not self._may_send():
            return
        frame = _FRAME.pack(code, register, info[:_INFO_LENGTH].ljust(_INFO_LENGTH, b"\0"))
        self._send(cob_id & ID_MASK, frame)

    def _entry(self, number: int) -> Callable[[], int]:
        def read() -> int:
            if number > len(self._history):
                raise SdoAbortedError(NO_DATA)
            return self._history[number - 1]

        return read

    def _check_write(self, index: int, _subindex: int, value: int) -> None:
        if index == _HISTORY:
            if value:
                raise SdoAbortedError(INVALID_VALUE)
            self._history.clear()
