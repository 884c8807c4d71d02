# SPDX-License-Identifier: Apache-2.0
"""Protocol of the ATI NETCANOEM board (ATI manual 9610-05-1030, section 4): layouts and dialogue.

An identifier is base << 4 | opcode; everything is big-endian; requests and replies share their
identifiers and differ in length.
"""

from __future__ import annotations

import math
import struct
import threading
from collections.abc import Callable
from typing import NamedTuple

from ..can_io.port import Port
from .errors import NotAnswering, NotConfigured, WrongDevice
from .force_base import AXES, Row

READ_GAUGES = 0x0
READ_GAUGES_SECOND = 0x1
READ_MATRIX = 0x2
READ_SERIAL = 0x5
SET_CALIBRATION = 0x6
READ_COUNTS_PER_UNIT = 0x7
READ_UNIT_CODES = 0x8
READ_DIAGNOSTIC = 0x9
RESET = 0xC
READ_FIRMWARE = 0xF

#: First reply to READ_GAUGES: status, gauges 0, 2, 4. Second: gauges 1, 3, 5.
GAUGES_FIRST = struct.Struct(">Hhhh")
GAUGES_SECOND = struct.Struct(">hhh")
MATRIX_PART = struct.Struct(">ff")
COUNTS_PER_UNIT = struct.Struct(">II")
DIAGNOSTIC = struct.Struct(">H")
FIRMWARE = struct.Struct(">BBH")
SERIAL_BYTES = 8

SATURATED = 32767
#: More counts per unit are a negative number or an erased memory: all forces would read as zero.
_MOST_COUNTS = 0x7FFFFFFF
#: Voltages that READ_DIAGNOSTIC returns [ADC counts], by their indices.
DIAGNOSTICS = {0: "mid supply", 2: "thermistor", 3: "power", 4: "DAC", 5: "ground"}

_POUND_FORCE = 4.4482216152605
_KILOGRAM_FORCE = 9.80665
_INCH = 0.0254
#: Newtons and newton metres in one unit, by the codes READ_UNIT_CODES returns.
FORCE_UNITS = {
    1: _POUND_FORCE,
    2: 1.0,
    3: 1000.0 * _POUND_FORCE,
    4: 1000.0,
    5: _KILOGRAM_FORCE,
}
TORQUE_UNITS = {
    1: _POUND_FORCE * _INCH,
    2: _POUND_FORCE * 12.0 * _INCH,
    3: 1.0,
    4: 0.001,
    5: _KILOGRAM_FORCE * 0.01,
    6: 1000.0,
}


class SensorIdentity(NamedTuple):
    """Identity and units of the sensor.

    serial: eight characters. firmware: major.minor.build. counts_per_force, counts_per_torque:
    counts per unit. force_unit [N] and torque_unit [Nm]: size of that unit.
    """

    serial: str = ""
    firmware: str = ""
    counts_per_force: float = 0
    counts_per_torque: float = 0
    force_unit: float = 1.0
    torque_unit: float = 1.0

    @property
    def text(self) -> str:
        """Identity as text, for messages and hardware_id."""
        return f"ATI NETCANOEM, serial {self.serial or 'unknown'}, firmware {self.firmware}"


def in_units(matrix: list[Row], sensor: SensorIdentity) -> list[Row]:
    """Return the matrix that maps six gauges to fx, fy, fz [N], tx, ty, tz [Nm] in sensor axes.

    matrix: the sensor's six rows for Fx to Tz, in counts.
    """
    newtons = sensor.force_unit / sensor.counts_per_force
    newton_metres = sensor.torque_unit / sensor.counts_per_torque
    units = [newtons] * 3 + [newton_metres] * 3
    return [tuple(unit * x for x in row) for unit, row in zip(units, matrix, strict=True)]


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

    def _ask_one(self, opcode: int, length: int, payload: bytes = b"") -> bytes:
        return self.ask(opcode, payload, {opcode: length})[0]

    def serial(self) -> str:
        """Return the serial number; raises as `ask`."""
        data = self._ask_one(READ_SERIAL, SERIAL_BYTES)
        return data.decode("ascii", "replace").strip("\0 ")

    def firmware(self) -> str:
        """Return the firmware version; raises as `ask`."""
        return "{}.{}.{}".format(*FIRMWARE.unpack(self._ask_one(READ_FIRMWARE, FIRMWARE.size)))

    def diagnostic(self, index: int) -> int:
        """Return one diagnostic voltage [ADC counts]; raises as `ask`."""
        data = self._ask_one(READ_DIAGNOSTIC, DIAGNOSTIC.size, bytes([index]))
        return DIAGNOSTIC.unpack(data)[0]

    def set_calibration(self, index: int) -> None:
        """Make calibration `index` the active one.

        Raises NotConfigured when the sensor reports another one as active; otherwise as `ask`.
        """
        (active,) = self._ask_one(SET_CALIBRATION, 1, bytes([index]))
        if active != index:
            raise NotConfigured(
                f"{self.label}: calibration {index} was asked for, {active} is active"
            )

    def reset(self) -> None:
        """Restart the board and wait until it answers again; raises NotAnswering, BusError."""
        self._port.send(self._base | RESET, b"")
        self.serial()

    def identify(self) -> SensorIdentity:
        """Return identity and units of the sensor.

        Raises WrongDevice for unknown units or implausible counts; otherwise as `ask`.
        """
        codes = self._ask_one(READ_UNIT_CODES, 2)
        force, torque = FORCE_UNITS.get(codes[0]), TORQUE_UNITS.get(codes[1])
        if force is None or torque is None:
            raise WrongDevice(
                f"{self.label} counts in units that are not known: force code {codes[0]}, torque "
                f"code {codes[1]}; calibrate it in N (2) and Nm (3)"
            )
        told = self._ask_one(READ_COUNTS_PER_UNIT, COUNTS_PER_UNIT.size)
        per_force, per_torque = counts = COUNTS_PER_UNIT.unpack(told)
        if not all(0 < each <= _MOST_COUNTS for each in counts):
            raise WrongDevice(f"{self.label} says {counts} counts per unit: no active calibration?")
        return SensorIdentity(
            self.serial(), self.firmware(), per_force, per_torque, force, torque
        )

    def matrix(self) -> list[Row]:
        """Return the active calibration matrix, six rows for Fx to Tz over six gauges.

        Raises WrongDevice when a number is not finite; otherwise as `ask`.
        """
        rows = [self._row(axis) for axis in range(AXES)]
        if not all(math.isfinite(x) for row in rows for x in row) or not all(map(any, rows)):
            raise WrongDevice(f"{self.label}: the active calibration matrix makes no sense: {rows}")
        return rows

    def _row(self, axis: int) -> Row:
        size = MATRIX_PART.size
        replies = {READ_MATRIX + part: size for part in range(3)}
        parts = self.ask(READ_MATRIX, bytes([axis]), replies)
        if self._repeated:
            # The second reply may still come, and it does not say of which row it is. The board
            # answers in order: after another answer nothing is left for the next row.
            self.serial()
        return tuple(x for part in parts for x in MATRIX_PART.unpack(part))


def _collector(
    found: dict[int, bytes], code: int, length: int
) -> Callable[[bytes, int], None]:
    def collect(data: bytes, _arrival_ns: int) -> None:
        if len(data) == length:
            found[code] = bytes(data)

    return collect
