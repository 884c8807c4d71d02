# SPDX-License-Identifier: Apache-2.0
"""Samples from drivers to laws, commands from laws to drives: SI units, stamps in integer ns.

The drivers convert all units: no raw sensor word passes beyond them. Every sample carries the
number of the tick of its request. All nodes that poll or send SYNC tick at whole multiples of their
period of CLOCK_MONOTONIC. So the tick number of an instant is the same in every process of a
machine, and samples of different devices are aligned without a clock server.
"""

from __future__ import annotations

from typing import NamedTuple

SEQUENCE_MASK = 0xFFFFFFFF
_HALF_RANGE = 0x80000000

#: Bits of the force sensor's status word (ATI NETCANOEM, manual 9610-05-1030).
FORCE_STATUS_BITS = {
    0: "watchdog reset",
    1: "DAC/ADC check too high",
    2: "DAC/ADC check too low",
    3: "artificial analog ground out of range",
    4: "supply too high",
    5: "supply too low",
    6: "bad active calibration",
    7: "EEPROM failure",
    8: "invalid configuration",
    11: "sensor temperature too high",
    12: "sensor temperature too low",
    14: "CAN bus error",
    15: "any error",
}
#: Those of them that make a sample unusable.
FORCE_FAULT_BITS = (2, 3, 4, 5, 6, 7, 8, 11, 12, 14)
FORCE_FAULT_MASK = sum(1 << bit for bit in FORCE_FAULT_BITS)
FORCE_RESTARTED = 1 << 0
FORCE_RESERVED_MASK = sum(1 << bit for bit in range(16) if bit not in FORCE_STATUS_BITS)


def force_status_names(status: int) -> list[str]:
    """Return the names of the bits set in a status word of the force sensor."""
    bits = [bit for bit in range(16) if status >> bit & 1]
    return [FORCE_STATUS_BITS.get(bit, f"reserved bit {bit}") for bit in bits]


class EncoderReading(NamedTuple):
    """One position of the vertical module's motor-side encoder.

    sequence: tick number, modulo 2^32.
    monotonic_ns: acquisition (when the SYNC went out) on CLOCK_MONOTONIC [ns].
    stamp_ns: the same instant on the system clock [ns since the epoch].
    count: encoder count, unwrapped [counts].
    position: nut height above the bottom of travel, up positive [m].
    velocity: backward difference of position after the encoder's `velocity_cutoff` filter [m/s].
    homed: position is absolute.
    homings: how many there were; with another number position has another origin.
    """

    sequence: int
    monotonic_ns: int
    stamp_ns: int
    count: int  # type: ignore[assignment]  # hides the tuple's method
    position: float
    velocity: float
    homed: bool
    homings: int = 0


class ForceReading(NamedTuple):
    """One wrench of the patient on the robot, in the handle frame, tare removed.

    sequence: tick number, modulo 2^32.
    monotonic_ns: time of the request, on CLOCK_MONOTONIC [ns].
    stamp_ns: the same instant on the system clock [ns since the epoch].
    fx, fy, fz: force [N], fz up positive.
    tx, ty, tz: torque [Nm].
    status: the sensor's status word (ATI NETCANOEM), 0 = healthy.
    """

    sequence: int
    monotonic_ns: int
    stamp_ns: int
    fx: float
    fy: float
    fz: float
    tx: float
    ty: float
    tz: float
    status: int


class DriveReading(NamedTuple):
    """One cyclic answer of a CiA 402 drive.

    monotonic_ns: arrival on CLOCK_MONOTONIC [ns].
    statusword: object 6041.
    position: object 6064, unwrapped, with the robot's sign [m of the nut, or rad of a joint];
        relative to the drive's own zero, not homed.
    torque: object 6077 on the motor shaft, with the robot's sign [Nm].
    """

    monotonic_ns: int
    statusword: int
    position: float
    torque: float


class Command(NamedTuple):
    """One force command of the vertical controller, as the drive needs it.

    sequence: tick number of the encoder sample that it answers, modulo 2^32.
    monotonic_ns: acquisition of that sample on CLOCK_MONOTONIC [ns].
    force: up positive, after the controller's limits [N].
    mode: of the controller, constant of `control.modes`.
    activation: number of the controller's activation.
    """

    sequence: int
    monotonic_ns: int
    force: float
    mode: int
    activation: int


def sequence_gap(previous: int, current: int) -> int:
    """Return how many ticks are missing between two sequence numbers, modulo 2^32.

    0 = the very next one, n > 0 = n samples are missing, -1 = the same one again, below -1 = older.
    """
    return ((current - previous - 1 + _HALF_RANGE) & SEQUENCE_MASK) - _HALF_RANGE
