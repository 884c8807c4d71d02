# SPDX-License-Identifier: Apache-2.0
"""Byte layouts, names and units of the ATI NETCANOEM board (ATI manual 9610-05-1030, section 4).

An identifier is base << 4 | opcode; everything is big-endian; requests and replies share their
identifiers and differ in length.
"""

from __future__ import annotations

import math
import struct

from ..samples import FORCE_STATUS_BITS

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

AXES = 6
SATURATED = 32767
#: Voltages that READ_DIAGNOSTIC returns [ADC counts], by their indices.
DIAGNOSTICS = {0: "mid supply", 2: "thermistor", 3: "power", 4: "DAC", 5: "ground"}

#: Bases whose sixteen identifiers do not collide with CANopen's (PDO 1 to 4, SDO, NMT and so on).
FREE_BASES = frozenset(
    (*range(0x01, 0x08), *range(0x11, 0x18), *range(0x68, 0x70), *range(0x78, 0x7E), 0x7F)
)

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

RESTARTED = 1 << 0
RESERVED_MASK = sum(1 << bit for bit in range(16) if bit not in FORCE_STATUS_BITS)

Row = tuple[float, float, float, float, float, float]


def status_names(status: int) -> list[str]:
    """Return the names of the bits set in a status word."""
    bits = [bit for bit in range(16) if status >> bit & 1]
    return [FORCE_STATUS_BITS.get(bit, f"reserved bit {bit}") for bit in bits]


def rotation(roll: float, pitch: float, yaw: float) -> tuple[tuple[float, float, float], ...]:
    """Return the matrix that turns sensor axes into handle axes; fixed x, y, z angles [rad]."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def counts_to_wrench(
    matrix: list[Row],
    newtons_per_count: float,
    newton_metres_per_count: float,
    turn: tuple[tuple[float, float, float], ...],
    sign: int,
) -> tuple[Row, ...]:
    """Return the matrix that maps six gauges to fx, fy, fz [N], tx, ty, tz [Nm] in handle axes.

    matrix: the sensor's six rows for Fx to Tz. turn: sensor axes to handle axes.
    """
    force = [[sign * newtons_per_count * x for x in row] for row in matrix[:3]]
    torque = [[sign * newton_metres_per_count * x for x in row] for row in matrix[3:]]
    return tuple(
        tuple(sum(turn[axis][k] * block[k][gauge] for k in range(3)) for gauge in range(AXES))
        for block in (force, torque)
        for axis in range(3)
    )
