# SPDX-License-Identifier: Apache-2.0
"""Simulated six-axis force/torque sensor (ATI NETCANOEM, manual 9610-05-1030).

Frame id = base << 4 | opcode, payloads big-endian. A request and its replies share ids; they differ
in length, except for 0x6 and 0xC. The port drops the sensor's own frames, because a sensor that
received its own replies to these two would answer itself for ever.
"""

from __future__ import annotations

import math
import struct
from functools import partial

from screw_module_ros.compiled import compiled
from screw_module_ros.plant.sensor import advanced, normal_pair, seeded
from screw_module_ros.rig.device import SimulatedDevice
from screw_module_ros.rig.faults import FORCE_SENSOR
from screw_module_ros.rig.link import OFF_BUS, Link
from screw_module_ros.rig.physics import Physics
from screw_module_ros.rig.port import Handler

from .transducer_calibration import CALIBRATIONS, ZERO_OFFSETS

READ_GAUGES, GAUGES_ODD, READ_MATRIX, READ_SERIAL, SET_CALIBRATION = 0x0, 0x1, 0x2, 0x5, 0x6
READ_COUNTS, READ_UNITS, READ_DIAGNOSTICS, RESET, READ_FIRMWARE = 0x7, 0x8, 0x9, 0xC, 0xF

WATCHDOG, BAD_CALIBRATION, CAN_ERROR, ANY_ERROR = 1 << 0, 1 << 6, 1 << 14, 1 << 15
FAULT_BITS = 0x59FC
"""Bits 2 to 8, 11, 12 and 14: the sensor's values are unusable."""

LARGEST_COUNT = 32767

CONVERTER_NOISE = 1.0
"""Of the electronics themselves [counts, standard deviation], whatever the world does or however it
stands still. CHOSEN: thesis 5.2.4 calls the sensor noisy without a figure, the manual gives none; a
16-bit converter flickers by about a count. The plant's noise of 7 counts comes on top."""

_SERIAL = b"FT-SIM01"
_FIRMWARE = struct.pack(">BBH", 1, 2, 34)
_DIAGNOSTICS = {0: 2048, 2: 1870, 3: 2730, 4: 2047, 5: 1}
"""Index -> ADC counts: mid-supply of the gauges, thermistor, power, DAC, ground."""
_EVEN = struct.Struct(">Hhhh")
_ODD = struct.Struct(">hhh")
_PAIR = struct.Struct(">ff")
_COUNTS = struct.Struct(">II")
_BOOT_NS = 50_000_000
_GAUGES = 6
_QUIET = (0.0,) * _GAUGES


class SimulatedForceSensor(SimulatedDevice):
    """The sensor between handle and carriage.

    link: its cable; base_id: base of its frame ids, 0x01 to 0x7F, and the seed of its noise;
    physics: world and its time. converter_noise: see `CONVERTER_NOISE`, may be set at any time.
    """

    FAULTS = FORCE_SENSOR
    injected_status = 0
    saturated: int | None = None
    bias = drift = noise = 0.0
    stuck: list[int] | None = None
    only_first_frame = False
    _zeros: tuple[float, ...] = ZERO_OFFSETS

    def __init__(self, link: Link, base_id: int, physics: Physics):
        super().__init__("force_sensor", link)
        self.status = 0
        self.converter_noise = CONVERTER_NOISE
        self._base = base_id << 4
        self._physics = physics
        self._calibration = CALIBRATIONS[0]
        self._silent_until_ns = 0
        self._seeds = seeded(base_id)
        flicker(self._seeds, 0)  # compiles now, not in the first tick
        self._drift_from_ns = 0
        self.link.listen(self._handlers())

    def gauges(self, now_ns: int) -> list[int]:
        """Return the six gauges at now_ns [counts], rounded and limited as the ADC does."""
        if self.stuck is not None:
            return self.stuck
        fx, fy, fz, *torques = self._physics.world.wrench()
        fz += self.bias + self.drift * (now_ns - self._drift_from_ns) * 1e-9
        raw = self._counts((fx, fy, fz, *torques))
        noise = math.hypot(self.converter_noise, self.noise)
        numbers = flicker(self._seeds, now_ns) if noise else _QUIET
        shown = zip(raw, numbers, self._zeros, strict=True)
        values = [value + noise * number + zero for value, number, zero in shown]
        counts = [max(-LARGEST_COUNT, min(LARGEST_COUNT, round(value))) for value in values]
        if self.saturated is not None:
            counts[self.saturated] = LARGEST_COUNT
        return counts

    def _counts(self, wrench: tuple[float, ...]) -> list[float]:
        """Return what the sensor shows of a wrench [N, Nm] without noise and zeros [counts]."""
        return self._calibration.gauges(wrench)

    # Requests.

    def _handlers(self) -> dict[int, Handler]:
        """Return a handler for each opcode; only a request of the right length is answered."""
        requests: dict[int, tuple[int, Handler]] = {
            READ_GAUGES: (0, self._read_gauges),
            READ_MATRIX: (1, self._read_matrix),
            READ_SERIAL: (0, partial(self._read_constant, READ_SERIAL)),
            SET_CALIBRATION: (1, self._set_calibration),
            READ_COUNTS: (0, partial(self._read_constant, READ_COUNTS)),
            READ_UNITS: (0, partial(self._read_constant, READ_UNITS)),
            READ_DIAGNOSTICS: (1, self._read_diagnostics),
            RESET: (0, self._reset),
            READ_FIRMWARE: (0, partial(self._read_constant, READ_FIRMWARE)),
        }
        return {
            self._base | opcode: partial(self._answer, length, answer)
            for opcode, (length, answer) in requests.items()
        }

    def _answer(self, length: int, answer: Handler, data: bytes, now_ns: int) -> None:
        if len(data) == length and now_ns >= self._silent_until_ns:
            answer(data, now_ns)

    def _send(self, opcode: int, payload: bytes) -> None:
        self.link.send(self._base | opcode, payload)

    def _read_gauges(self, _data: bytes, now_ns: int) -> None:
        self._physics.look(now_ns)
        sg = self.gauges(now_ns)
        status = self.status | self.injected_status
        if status & FAULT_BITS:
            status |= ANY_ERROR
        self._send(READ_GAUGES, _EVEN.pack(status, sg[0], sg[2], sg[4]))
        if not self.only_first_frame:
            self._send(GAUGES_ODD, _ODD.pack(sg[1], sg[3], sg[5]))

    def _read_matrix(self, data: bytes, _now_ns: int) -> None:
        if data[0] < _GAUGES:
            row = self._calibration.matrix[data[0]]
            for part in range(3):
                self._send(READ_MATRIX + part, _PAIR.pack(*row[2 * part : 2 * part + 2]))

    def _read_constant(self, opcode: int, _data: bytes, _now_ns: int) -> None:
        """Answer with what stays the same until another calibration is set."""
        chosen = self._calibration
        payloads = {
            READ_SERIAL: _SERIAL,
            READ_COUNTS: _COUNTS.pack(chosen.force_counts, chosen.torque_counts),
            READ_UNITS: bytes((chosen.force_unit, chosen.torque_unit)),
            READ_FIRMWARE: _FIRMWARE,
        }
        self._send(opcode, payloads[opcode])

    def _set_calibration(self, data: bytes, _now_ns: int) -> None:
        calibration = CALIBRATIONS.get(data[0])
        if calibration is None:
            self.status |= BAD_CALIBRATION
        else:
            self.status &= ~BAD_CALIBRATION
            self._calibration = calibration
        self._send(SET_CALIBRATION, data)

    def _read_diagnostics(self, data: bytes, _now_ns: int) -> None:
        if data[0] in _DIAGNOSTICS:
            self._send(READ_DIAGNOSTICS, _DIAGNOSTICS[data[0]].to_bytes(2, "big"))

    def _reset(self, _data: bytes, now_ns: int) -> None:
        self._send(RESET, b"")
        self.restart(now_ns)

    def restart(self, now_ns: int, cause: int = 0) -> None:
        """Restart with the first calibration, silent for a moment; cause: status bit to set."""
        self._calibration = CALIBRATIONS[0]
        self.status = cause
        self._silent_until_ns = now_ns + _BOOT_NS

    # Faults.

    def set_status_bit(self, bit: int) -> None:
        """Set a bit of the status word that no reset clears."""
        self.injected_status |= 1 << bit

    def begin_drift(self, _size: float) -> None:
        """Let the drift begin at zero."""
        self._drift_from_ns = self.now_ns

    def freeze(self, _size: float) -> None:
        """Report the present gauges from here on."""
        self.stuck = self.gauges(self.now_ns)

    def watchdog_reset(self, _size: float) -> None:
        """Restart as after a hang."""
        self.restart(self.now_ns, WATCHDOG)

    def return_to_bus(self) -> None:
        """Recover from bus-off."""
        self.link.end(OFF_BUS)
        self.status |= CAN_ERROR


def flicker(seeds: tuple[int, int], now_ns: int) -> tuple[float, ...]:
    """Return six standard normal numbers, the same at each call within a microsecond."""
    return compiled(six_normal)(*advanced(*seeds, _GAUGES * (now_ns // 1000)))


def six_normal(first: int, second: int) -> tuple[float, float, float, float, float, float]:
    """Return six standard normal numbers from this state of the generator."""
    n1, n2, first, second = normal_pair(first, second)
    n3, n4, first, second = normal_pair(first, second)
    n5, n6, first, second = normal_pair(first, second)
    return n1, n2, n3, n4, n5, n6
