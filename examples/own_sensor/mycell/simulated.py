# SPDX-License-Identifier: Apache-2.0
"""The simulated load cell, from its manual and not from its driver."""

from __future__ import annotations

import struct
from typing import Any

from screw_module_ros.rig.device import SimulatedDevice
from screw_module_ros.rig.faults import CABLE, SIZE, Fault, Size

_LARGEST = 32767
_BOOT_NS = 50_000_000
_READ_ONLY, _ABSENT = 0x06010002, 0x06020000


class SimulatedLoadCell(SimulatedDevice):
    """Fx, Fy, Fz in 0.01 N and Tx, Ty, Tz in 0.001 Nm; silent until NMT start.

    objects: what SDO reads, by index and sub-index. link: its cable; physics: the world and its
    time; profile: the node id stands in its settings.
    """

    FAULTS = CABLE | {
        "overload": Fault("an axis is beyond its range", "overloaded", SIZE,
                          size=Size("axis", 0, 0, 5)),
        "freeze": Fault("the values stop changing", "stuck", start="freeze"),
        "reset": Fault("it restarts: boot-up, all settings gone", start="restart"),
    }  # fmt: skip
    overloaded: int | None = None
    stuck: tuple[int, ...] | None = None

    def __init__(self, link: Any, physics: Any, profile: Any):
        super().__init__("force_sensor", link)
        self._node = profile.force_sensor.settings["node_id"]
        self._physics = physics
        self._number = 0
        self._booting_ns = 0
        self.objects = {(0x1000, 0): 404}
        for axis in range(1, 7):
            self.objects |= {(0x6131, axis): 0x00210000 if axis < 4 else 0x00250000,
                             (0x6132, axis): 2 if axis < 4 else 3}  # fmt: skip
        self._lose_settings()
        link.listen({0x000: self._on_nmt, 0x080: self._on_sync, 0x600 + self._node: self._on_sdo})

    def poll(self, now_ns: int) -> None:
        """End faults; send the boot-up when it is due."""
        super().poll(now_ns)
        if self._booting_ns and now_ns >= self._booting_ns:
            self._booting_ns = 0
            self.link.send(0x700 + self._node, b"\0")

    def counts(self) -> tuple[int, ...]:
        """Return the six values as its converter gives them."""
        if self.stuck is not None:
            return self.stuck
        fx, fy, fz, tx, ty, tz = self._physics.world.wrench()
        values = [100.0 * force for force in (fx, fy, fz)]
        values += [1000.0 * torque for torque in (tx, ty, tz)]
        return tuple(max(-_LARGEST, min(_LARGEST, round(value))) for value in values)

    def freeze(self, _size: float) -> None:
        """Show the present values from here on."""
        self.stuck = self.counts()

    def restart(self, _size: float = 0.0) -> None:
        """Begin anew, as after a dip of its supply."""
        self._lose_settings()
        self._booting_ns = self.now_ns + _BOOT_NS

    def _lose_settings(self) -> None:
        self._operational = False
        self.objects |= {(0x1800, 2): 255, (0x1801, 2): 255}  # by a clock that it does not have

    def _on_nmt(self, data: bytes, now_ns: int) -> None:
        command, node = data[0], data[1]
        if node not in (0, self._node) or self._booting_ns:
            return
        if command in (0x81, 0x82):
            self.now_ns = now_ns
            self.restart()
        else:
            self._operational = command == 0x01

    def _on_sync(self, _data: bytes, now_ns: int) -> None:
        if not self._operational or self._booting_ns:
            return
        self._physics.look(now_ns)
        self._number = self._number + 1 & 0xFF
        fx, fy, fz, tx, ty, tz = self.counts()
        bits = 0 if self.overloaded is None else 1 << self.overloaded
        first = struct.pack("<3hBB", fx, fy, fz, bits, self._number)
        second = struct.pack("<3hB", tx, ty, tz, self._number)
        for number, frame in ((0x1800, first), (0x1801, second)):
            if self.objects[number, 2] == 1:
                self.link.send((number - 0x17FF) * 0x100 + 0x80 + self._node, frame)

    def _on_sdo(self, data: bytes, _now_ns: int) -> None:
        """Answer one expedited transfer."""
        if self._booting_ns:
            return
        command, index, sub = struct.unpack_from("<BHB", data)
        known = (index, sub) in self.objects
        if command == 0x40 and known:
            self._say(0x43, index, sub, self.objects[index, sub])
        elif command == 0x2F and sub == 2 and known:
            self.objects[index, sub] = data[4]
            self._say(0x60, index, sub, 0)
        elif command & 0xE0 in (0x20, 0x40):
            self._say(0x80, index, sub, _READ_ONLY if known else _ABSENT)

    def _say(self, command: int, index: int, sub: int, value: int) -> None:
        self.link.send(0x580 + self._node, struct.pack("<BHBI", command, index, sub, value))
