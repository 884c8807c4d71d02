# SPDX-License-Identifier: Apache-2.0
"""Driver of a load cell on CANopen: two frames answer SYNC, everything else is asked by SDO.

TPDO1 carries Fx, Fy, Fz, a bit for each axis that is overloaded, and the number of the sample;
TPDO2 Tx, Ty, Tz and the same number.
"""

from __future__ import annotations

import struct
from typing import Annotated, Any, NamedTuple

from screw_module_ros.devices.errors import NotAnswering, NotConfigured, WrongDevice
from screw_module_ros.devices.force_frames import FrameSensor
from screw_module_ros.devices.life import Phase
from screw_module_ros.devices.sdo import Sdo
from screw_module_ros.settings import Setting

SYNC, HEARTBEAT, TPDO1, TPDO2 = 0x080, 0x700, 0x180, 0x280
START, PRE_OPERATIONAL, RESET_COMMUNICATION = 0x01, 0x80, 0x82
FORCES, TORQUES = struct.Struct("<hhhBB"), struct.Struct("<hhhB")
DEVICE_TYPE, UNIT, DIGITS = 0x1000, 0x6131, 0x6132
NEWTON, NEWTON_METRE = 0x00210000, 0x00250000
BOOT_S = 1.0


class LoadCellSettings(NamedTuple):
    """What `settings` of the profile may say."""

    node_id: Annotated[int, Setting("node id of the amplifier", "", 1, 127)] = 5


class LoadCell(FrameSensor):
    """The driver; counters: also mixed (answers whose frames are of two samples)."""

    OWN = LoadCellSettings
    SIZES = FORCES.size, TORQUES.size
    SATURATED = 32767

    def __init__(self, port: Any, settings: Any, label: str = "force sensor", own: Any = None):
        node = own.node_id
        super().__init__(port, settings, label, own, SYNC, (TPDO1 + node, TPDO2 + node))
        self.identity = f"load cell of an example, {self.place}"
        self._sdo = Sdo(port, node, label, settings.timeout, self._on_foreign_client)
        self._boots = 0
        port.subscribe(HEARTBEAT + node, self._on_heartbeat)

    @classmethod
    def opened(cls, settings: Any, own: LoadCellSettings, open_port: Any, clock: Any) -> LoadCell:
        """Return the driver on its bus, where only one process may have this node."""
        return cls(open_port(f"node {own.node_id}"), settings, own=own)

    @property
    def place(self) -> str:
        """Its node id, for messages."""
        return f"node id {self.own.node_id}"

    def identify(self) -> list[tuple[float, ...]]:
        """Compare type and units, have both frames answer SYNC; return what one count is."""
        if not self.port.sync_producer:
            raise NotConfigured(
                f"the {self.label} is asked by SYNC: give it a bus of its own, on which "
                "can.sync_producer is true"
            )
        self._command(PRE_OPERATIONAL)
        if (kind := self._sdo.unsigned(DEVICE_TYPE) & 0xFFFF) != 404:
            raise WrongDevice(f"{self.label}: {self.place} is a device of CiA {kind}, not 404")
        rows = []
        for axis in range(6):
            wanted = NEWTON if axis < 3 else NEWTON_METRE
            if (unit := self._sdo.unsigned(UNIT, axis + 1)) != wanted:
                raise WrongDevice(f"{self.label}: axis {axis + 1} is in unit 0x{unit:08X}")
            count = 10.0 ** -self._sdo.unsigned(DIGITS, axis + 1)
            rows.append(tuple(count * (axis == other) for other in range(6)))
        for parameters in (0x1800, 0x1801):
            self._sdo.set(parameters, 2, 1, 1)  # at each SYNC
        return rows

    def start(self) -> None:
        """Deliver samples: NMT start."""
        super().start()
        self._command(START)

    def reset_device(self) -> None:
        """Reset its communication and wait until it has booted."""
        before = self._boots
        self._command(RESET_COMMUNICATION)
        if not self.port.wait_for(lambda: self._boots > before, BOOT_S):
            raise NotAnswering(f"the {self.label} ({self.place}) has not restarted")

    def values(self, *frames: bytes) -> tuple[int, tuple[float, ...] | None]:
        """Return no status and six values, none of an overloaded or a mixed answer."""
        fx, fy, fz, overloaded, number = FORCES.unpack(frames[0])
        tx, ty, tz, same = TORQUES.unpack(frames[1])
        if number != same or overloaded:
            self.counters["saturated" if overloaded else "mixed"] += 1
            return 0, None
        return 0, (fx, fy, fz, tx, ty, tz)

    def _command(self, command: int) -> None:
        self.port.send(0x000, bytes((command, self.own.node_id)))

    def _on_heartbeat(self, data: bytes, _arrival_ns: int) -> None:
        if bytes(data) != b"\0":
            return
        self._boots += 1
        if self.phase is not Phase.NEW:
            self.counters["restarts"] += 1
            self.restarted("restarted (boot-up)")

    def _on_foreign_client(self) -> None:
        if self.phase is not Phase.NEW:
            self.lose(f"{self._sdo.foreign_client} may have changed how the {self.label} measures")
