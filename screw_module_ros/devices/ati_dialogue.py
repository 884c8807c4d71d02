# SPDX-License-Identifier: Apache-2.0
"""Blocking requests to the ATI NETCANOEM board: identity, calibration, units, diagnostics."""

from __future__ import annotations

import math
import threading
from typing import NamedTuple

from ..can_io.port import Port
from . import ati
from .errors import NotAnswering, NotConfigured, WrongDevice

_MOST_COUNTS = 0x7FFFFFFF
"""More counts per unit are a negative number or an erased memory: all forces would read as zero."""


class SensorIdentity(NamedTuple):
    """Identity and units of the sensor.

    serial: eight characters. firmware: major.minor.build. counts_per_force, counts_per_torque:
    counts per unit. force_unit [N] and torque_unit [Nm]: size of that unit.
    """

    serial: str = ""
    firmware: str = ""
    counts_per_force: int = 0
    counts_per_torque: int = 0
    force_unit: float = 1.0
    torque_unit: float = 1.0

    @property
    def text(self) -> str:
        """Identity as text, for messages and hardware_id."""
        return f"ATI NETCANOEM, serial {self.serial or 'unknown'}, firmware {self.firmware}"


class Dialogue:
    """Sends one request at a time; the thread that pumps the port delivers the replies.

    base_id: high seven bits of the identifiers. timeout_s: time limit of one try [s]; two tries.
    """

    def __init__(self, port: Port, base_id: int, label: str, timeout_s: float):
        self.label = label
        self._port = port
        self._base = base_id << 4
        self._base_id = base_id
        self._timeout_s = timeout_s
        self._lock = threading.Lock()
        self._repeated = False

    def ask(self, opcode: int, payload: bytes, replies: dict[int, int]) -> list[bytes]:
        """Send one request and return its replies; replies: opcode -> expected length [byte].

        Raises NotAnswering after two tries, BusError.
        """
        found: dict[int, bytes] = {}
        listeners = [
            (self._base | code, _collector(found, code, length))
            for code, length in replies.items()
        ]
        with self._lock:
            for can_id, listener in listeners:
                self._port.subscribe(can_id, listener)
            try:
                for self._repeated in (False, True):
                    found.clear()
                    self._port.send(self._base | opcode, payload)
                    if self._port.wait_for(lambda: len(found) == len(replies), self._timeout_s):
                        return [found[code] for code in replies]
            finally:
                for can_id, listener in listeners:
                    self._port.unsubscribe(can_id, listener)
        raise NotAnswering(
            f"{self.label} (base id 0x{self._base_id:02X}) does not answer on {self._port.name} "
            f"when asked with opcode 0x{opcode:X}; check its power, cable, base id and bit rate, "
            "or start the simulated rig"
        )

    def serial(self) -> str:
        """Return the serial number; raises as `ask`."""
        (data,) = self.ask(ati.READ_SERIAL, b"", {ati.READ_SERIAL: ati.SERIAL_BYTES})
        return data.decode("ascii", "replace").strip("\0 ")

    def firmware(self) -> str:
        """Return the firmware version; raises as `ask`."""
        (data,) = self.ask(ati.READ_FIRMWARE, b"", {ati.READ_FIRMWARE: ati.FIRMWARE.size})
        return "{}.{}.{}".format(*ati.FIRMWARE.unpack(data))

    def diagnostic(self, index: int) -> int:
        """Return one diagnostic voltage [ADC counts]; raises as `ask`."""
        reply = {ati.READ_DIAGNOSTIC: ati.DIAGNOSTIC.size}
        (data,) = self.ask(ati.READ_DIAGNOSTIC, bytes([index]), reply)
        return ati.DIAGNOSTIC.unpack(data)[0]

    def set_calibration(self, index: int) -> None:
        """Make calibration `index` the active one.

        Raises NotConfigured when the sensor reports another one as active; otherwise as `ask`.
        """
        (data,) = self.ask(ati.SET_CALIBRATION, bytes([index]), {ati.SET_CALIBRATION: 1})
        if data[0] != index:
            raise NotConfigured(
                f"{self.label}: calibration {index} was asked for, {data[0]} is active"
            )

    def reset(self) -> None:
        """Restart the board and wait until it answers again; raises NotAnswering, BusError."""
        self._port.send(self._base | ati.RESET, b"")
        self.serial()

    def identify(self) -> SensorIdentity:
        """Return identity and units of the sensor.

        Raises WrongDevice for unknown units or implausible counts; otherwise as `ask`.
        """
        (data,) = self.ask(ati.READ_UNIT_CODES, b"", {ati.READ_UNIT_CODES: 2})
        force, torque = ati.FORCE_UNITS.get(data[0]), ati.TORQUE_UNITS.get(data[1])
        if force is None or torque is None:
            raise WrongDevice(
                f"{self.label} counts in units that are not known: force code {data[0]}, torque "
                f"code {data[1]}; calibrate it in N (2) and Nm (3)"
            )
        size = ati.COUNTS_PER_UNIT.size
        (data,) = self.ask(ati.READ_COUNTS_PER_UNIT, b"", {ati.READ_COUNTS_PER_UNIT: size})
        counts = ati.COUNTS_PER_UNIT.unpack(data)
        if not all(0 < each <= _MOST_COUNTS for each in counts):
            raise WrongDevice(f"{self.label} says {counts} counts per unit: no active calibration?")
        return SensorIdentity(self.serial(), self.firmware(), *counts, force, torque)

    def matrix(self) -> list[ati.Row]:
        """Return the active calibration matrix, six rows for Fx to Tz over six gauges.

        Raises WrongDevice when a number is not finite; otherwise as `ask`.
        """
        rows = [self._row(axis) for axis in range(ati.AXES)]
        if not all(math.isfinite(x) for row in rows for x in row) or not all(map(any, rows)):
            raise WrongDevice(f"{self.label}: the active calibration matrix makes no sense: {rows}")
        return rows

    def _row(self, axis: int) -> ati.Row:
        size = ati.MATRIX_PART.size
        replies = {ati.READ_MATRIX + part: size for part in range(3)}
        parts = self.ask(ati.READ_MATRIX, bytes([axis]), replies)
        if self._repeated:
            # The second reply may still come, and it does not say of which row it is. The board
            # answers in order: after another answer nothing is left for the next row.
            self.serial()
        return tuple(x for part in parts for x in ati.MATRIX_PART.unpack(part))


def _collector(found: dict[int, bytes], code: int, length: int):
    def collect(data: bytes, _arrival_ns: int) -> None:
        if len(data) == length:
            found[code] = bytes(data)

    return collect
