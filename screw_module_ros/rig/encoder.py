# SPDX-License-Identifier: Apache-2.0
"""Simulated rotary encoder (CiA 406, device type 2: multi-turn absolute rotary encoder).

Position 6004 counts from the world's motor count: direction is bit 0 of 6000; the resolution of
6001 and the range of 6002 hold only with bit 2 of 6000, else the physical ones of 6501 and 6502;
6003 presets the position. The position wraps at the range, not at 2^32.
"""

from __future__ import annotations

import random
from ctypes import c_int32

from screw_module_ros.plant.world import World
from screw_module_ros.profiles import ANY_ENCODER, Profile
from screw_module_ros.rig.canopen_device import CanopenDevice
from screw_module_ros.rig.faults import ENCODER
from screw_module_ros.rig.link import Link
from screw_module_ros.rig.object_dictionary import (
    INVALID_VALUE,
    VALUE_TOO_HIGH,
    VALUE_TOO_LOW,
    require,
)

_ALARM_CODES = {0x0001: 0x7300, 0x1000: 0x7305}
"""Bit of object 6503 -> error code of its EMCY."""

_LARGEST_RANGE = 1 << 32
_COUNTS_PER_TURN = 20_000
"""Of the world's motor count."""


class SimulatedEncoder(CanopenDevice):
    """The encoder on the screw's motor.

    link: its cable; node_id: CANopen node id; world: gives `encoder_count`; make: of the encoder.
    """

    FAULTS = ENCODER
    frozen: int | None = None
    noise = 0.0
    position_alarm = index_alarm = warnings = 0

    def __init__(self, link: Link, node_id: int, world: World, profile: Profile = ANY_ENCODER):
        super().__init__("encoder", link, node_id, "encoder.eds", profile)
        self._world = world
        self._parameters = 0
        self._offset = 0
        self._spike = 0
        self._random = random.Random(node_id)
        node = self.node
        self._resolution = node.value(0x6501)
        self._reversed = 1 << max(0, self.traits.reversed_bit)
        self._scaled_by = 1 << self.traits.scaling_bit if self.traits.scaling_bit >= 0 else 0
        counts = self.traits.parameters.get("counts_per_turn", _COUNTS_PER_TURN)
        self._physical_scale = (counts, _COUNTS_PER_TURN)
        self._scale, self._range = self._physical_scale, self._physical_range()
        node.sources[0x6004, 0] = self.position
        node.sources[0x6500, 0] = lambda: self._parameters
        node.sources[0x6503, 0] = lambda: self.alarms
        node.sources[0x6505, 0] = lambda: self.warnings
        node.sources[0x6509, 0] = lambda: c_int32(self._offset).value
        node.sources[0x6200, 0] = lambda: node.value(0x1800, 5)
        node.sinks[0x6003, 0] = self._preset
        node.sinks[0x6200, 0] = self._cyclic_timer
        node.checks.append(self._check_write)

    @property
    def alarms(self) -> int:
        """Object 6503."""
        return self.position_alarm | self.index_alarm

    def position(self) -> int:
        """Return object 6004."""
        if self.frozen is not None:
            return self.frozen
        position = self._scaled() + self._offset + self._spike
        self._spike = 0
        if self.noise:
            position += round(self._random.gauss(0.0, self.noise))
        return position % self._range

    def written(self, now_ns: int) -> None:
        """Apply operating parameters that the master has changed."""
        parameters = self.node.value(0x6000)
        self._parameters = parameters & (self._reversed | self._scaled_by)
        if parameters & self._scaled_by:
            self._scale = (self.node.value(0x6001), self._resolution)
            self._range = self.node.value(0x6002)
        else:
            self._scale, self._range = self._physical_scale, self._physical_range()

    def restarted(self) -> None:
        """Come back with the defaults; the preset is kept, as in an EEPROM."""
        self.frozen = None
        self.written(self.now_ns)

    def _scaled(self) -> int:
        count = self._world.encoder_count
        if self._parameters & self._reversed:
            count = -count
        units, steps = self._scale
        return count * units // steps

    def _physical_range(self) -> int:
        turns = self.node.optional(0x6502, 0, 0)
        return self._resolution * turns or _LARGEST_RANGE

    def _preset(self, value: int) -> None:
        self._offset = (value - self._scaled()) % self._range

    def _cyclic_timer(self, value: int) -> None:
        """Object 6200 is another name for the event timer of TPDO1."""
        self.node.set_data(0x1800, 5, value.to_bytes(2, "little"))

    def _check_write(self, index: int, _subindex: int, value: int) -> None:
        if index == 0x6000:
            require(not value & ~(self._reversed | self._scaled_by), INVALID_VALUE)
        if index in (0x6001, 0x6002):
            require(value, VALUE_TOO_LOW)
            most = self._resolution if index == 0x6001 else self._physical_range()
            require(value <= most, VALUE_TOO_HIGH)
        if index == 0x6003:
            require(value >= 0, VALUE_TOO_LOW)
            require(value < self._range, VALUE_TOO_HIGH)

    # Faults.

    def refresh(self) -> None:
        """Report the alarms that a fault has set, and those that are gone."""
        info = self.alarms.to_bytes(2, "little") + self.warnings.to_bytes(2, "little")
        for bit, code in _ALARM_CODES.items():
            if self.alarms & bit:
                self.errors.report(code, info)
            else:
                self.errors.resolve(code)

    def freeze(self, _size: float) -> None:
        """Report the present position from here on."""
        self.frozen = self.position()

    def jump(self, counts: float) -> None:
        """Move the reported position."""
        self._offset = (self._offset + round(counts)) % self._range

    def spike_once(self, counts: float) -> None:
        """Report one position that is off by `counts`."""
        self._spike = round(counts)

    def wrap_soon(self, counts: float) -> None:
        """Move the reported position to `counts` below its wrap."""
        self._preset(self._range - round(counts))

    def warn(self, bit: int) -> None:
        """Set a bit of object 6505."""
        self.warnings |= 1 << bit
