# SPDX-License-Identifier: Apache-2.0
"""Simulated rotary encoder (CiA 406, device type 2: multi-turn absolute rotary encoder).

Position 6004 counts from the world's motor count: direction is bit 0 of 6000; the resolution of
6001 and the range of 6002 hold only with bit 2 of 6000, else the physical ones of 6501 and 6502;
6003 presets the position. The position wraps at the range, not at 2^32.
"""

from __future__ import annotations

import random

from canopen.sdo.exceptions import SdoAbortedError

from screw_module_ros.rig.canopen_device import CanopenDevice
from screw_module_ros.rig.device_faults import add_common_faults
from screw_module_ros.rig.faults import Fault
from screw_module_ros.rig.object_dictionary import (
    INVALID_VALUE,
    VALUE_TOO_HIGH,
    VALUE_TOO_LOW,
)
from screw_module_ros.rig.physics import PlantInterface
from screw_module_ros.rig.port import Link

POSITION_ALARM, INDEX_ALARM = 0x0001, 0x1000
POSITION_ERROR_CODE, INDEX_ERROR_CODE = 0x7300, 0x7305

_REVERSED, _SCALED = 0x0001, 0x0004
_KNOWN_PARAMETERS = _REVERSED | _SCALED
_LARGEST_RANGE = 1 << 32
_MOST_COUNTS = 1e9


class SimulatedEncoder(CanopenDevice):
    """The encoder on the screw's motor.

    link: its cable; node_id: CANopen node id; world: gives `encoder_count`.
    """

    def __init__(self, link: Link, node_id: int, world: PlantInterface):
        super().__init__("encoder", link, node_id, "encoder.eds")
        self._world = world
        self._parameters = 0
        self._offset = 0
        self._frozen: int | None = None
        self._spike = 0
        self._noise = 0.0
        self._random = random.Random(node_id)
        self.alarms = self.warnings = 0
        node = self.node
        self._resolution = node.value(0x6501)
        self._scale, self._range = (1, 1), self._physical_range()
        node.sources[0x6004, 0] = self.position
        node.sources[0x6500, 0] = lambda: self._parameters
        node.sources[0x6503, 0] = lambda: self.alarms
        node.sources[0x6505, 0] = lambda: self.warnings
        node.sources[0x6509, 0] = lambda: _signed(self._offset)
        node.sources[0x6200, 0] = lambda: node.value(0x1800, 5)
        node.sinks[0x6003, 0] = self._preset
        node.sinks[0x6200, 0] = self._cyclic_timer
        node.checks.append(self._check_write)
        add_common_faults(self)
        self._add_faults()

    def position(self) -> int:
        """Return object 6004."""
        if self._frozen is not None:
            return self._frozen
        position = self._scaled() + self._offset + self._spike
        self._spike = 0
        if self._noise:
            position += round(self._random.gauss(0.0, self._noise))
        return position % self._range

    def written(self, now_ns: int) -> None:
        """Apply operating parameters that the master has changed."""
        parameters = self.node.value(0x6000)
        self._parameters = parameters & _KNOWN_PARAMETERS
        if parameters & _SCALED:
            self._scale = (self.node.value(0x6001), self._resolution)
            self._range = self.node.value(0x6002)
        else:
            self._scale, self._range = (1, 1), self._physical_range()

    def restarted(self) -> None:
        """Come back with the defaults; the preset is kept, as in an EEPROM."""
        self._frozen = None
        self._spike = 0
        self.written(self.now_ns)

    def _scaled(self) -> int:
        count = self._world.encoder_count
        if self._parameters & _REVERSED:
            count = -count
        units, steps = self._scale
        return count * units // steps

    def _physical_range(self) -> int:
        return self._resolution * self.node.value(0x6502)

    def _preset(self, value: int) -> None:
        self._offset = (value - self._scaled()) % self._range

    def _cyclic_timer(self, value: int) -> None:
        """Object 6200 is another name for the event timer of TPDO1."""
        self.node.set_data(0x1800, 5, value.to_bytes(2, "little"))

    def _check_write(self, index: int, _subindex: int, value: int) -> None:
        if index == 0x6000 and value & ~_KNOWN_PARAMETERS:
            raise SdoAbortedError(INVALID_VALUE)
        if index == 0x6001 and not 1 <= value <= self._resolution:
            raise SdoAbortedError(VALUE_TOO_HIGH if value else VALUE_TOO_LOW)
        if index == 0x6002 and not 1 <= value <= self._physical_range():
            raise SdoAbortedError(VALUE_TOO_HIGH if value else VALUE_TOO_LOW)
        if index == 0x6003 and not 0 <= value < self._range:
            raise SdoAbortedError(VALUE_TOO_HIGH if value > 0 else VALUE_TOO_LOW)

    # Faults.

    def _add_faults(self) -> None:
        add, counts = self.faults.add, ("counts", 5000.0, -_MOST_COUNTS, _MOST_COUNTS)
        add("freeze", Fault("the position stops changing", self._freeze, self._unfreeze))
        add("jump", Fault("the position moves and stays away", self._jump, None, *counts))
        add("spike", Fault("one position is wrong", self._spike_once, None, *counts))
        add(
            "noise",
            Fault(
                "the position is noisy",
                lambda value: setattr(self, "_noise", value),
                lambda: setattr(self, "_noise", 0.0),
                "counts, standard deviation",
                20.0,
                0.0,
                1e6,
            ),
        )
        near = "the position jumps to just below its wrap"
        add("near_rollover", Fault(near, self._near, None, "counts below", 2000.0, 1.0, 1e7))
        add("position_error", self._alarm("alarm bit 0, EMCY 7300", POSITION_ALARM, 0x7300))
        add("index_lost", self._alarm("alarm bit 12, EMCY 7305", INDEX_ALARM, INDEX_ERROR_CODE))
        add(
            "warning",
            Fault("a bit of 6505 is set", self._warn, self._unwarn, "bit number", 0.0, 0.0, 15.0),
        )

    def _freeze(self, _value: float) -> None:
        self._frozen = self.position()

    def _unfreeze(self) -> None:
        self._frozen = None

    def _jump(self, value: float) -> None:
        self._offset = (self._offset + round(value)) % self._range

    def _spike_once(self, value: float) -> None:
        self._spike = round(value)

    def _near(self, value: float) -> None:
        self._preset(self._range - round(value))

    def _warn(self, value: float) -> None:
        self.warnings |= 1 << int(value)

    def _unwarn(self) -> None:
        self.warnings = 0

    def _alarm(self, text: str, bit: int, code: int) -> Fault:
        def start(_value: float) -> None:
            self.alarms |= bit
            info = self.alarms.to_bytes(2, "little") + self.warnings.to_bytes(2, "little")
            self.errors.report(code, info)

        def stop() -> None:
            self.alarms &= ~bit
            self.errors.resolve(code)

        return Fault(text, start, stop)


def _signed(value: int) -> int:
    return value - _LARGEST_RANGE if value >= _LARGEST_RANGE // 2 else value
