# SPDX-License-Identifier: Apache-2.0
"""Base of every simulated CANopen device (CiA 301): NMT, SDO, SYNC, PDO, heartbeat, EMCY.

The object dictionary is the only configuration: each write of the master takes effect at once. Time
is passed in with every frame and every `poll`.
"""

from __future__ import annotations

from functools import partial

from canopen.sdo.exceptions import SdoAbortedError

from screw_module_ros.rig.device import SimulatedDevice
from screw_module_ros.rig.emergency import ErrorLog, register_bits
from screw_module_ros.rig.faults import CANOPEN
from screw_module_ros.rig.heartbeat import Consumer, Producer
from screw_module_ros.rig.link import OFF_BUS, Link
from screw_module_ros.rig.object_dictionary import GENERAL_ERROR, DeviceNode
from screw_module_ros.rig.pdo import TIMEOUT, TOO_LONG, TOO_SHORT, Rpdo, Tpdo
from screw_module_ros.rig.pdo_rules import ID_MASK, RPDO, TPDO, check_pdo_write
from screw_module_ros.rig.port import Handler

INITIALISING, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F

HEARTBEAT_LOST = 0x8130
BUS_OFF_RECOVERED = 0x8140
SYNC_LENGTH = 0x8240

_START, _STOP, _ENTER_PRE_OPERATIONAL, _RESET_NODE, _RESET_COMMUNICATION = 1, 2, 128, 129, 130
_NMT_ID = 0x000
_SDO_REQUEST, _HEARTBEAT = 0x600, 0x700
_COMMUNICATION_AREA = range(0x1000, 0x2000)
_STATE_AFTER_LOSS = {0: PRE_OPERATIONAL, 2: STOPPED}
_PDO_INDEX = 0x1FF
_BOOT_NS = 20_000_000
"""Time without communication after a reset."""
_DIGITAL_IO = 0x00000191
"""Object 1000 of a device for CiA 401."""


class CanopenDevice(SimulatedDevice):
    """One node on the bus.

    name: in faults and reports; link: its cable; node_id: 1..127; eds: its EDS file.
    """

    FAULTS = CANOPEN
    unpowered = mute_heartbeat = mute_pdos = deaf_pdos = silent_sdo = False
    refuse_guards = wrong_profile = False

    def __init__(self, name: str, link: Link, node_id: int, eds: str):
        super().__init__(name, link)
        self.node_id = node_id
        self.node = DeviceNode(node_id, eds, self.send)
        self.state = INITIALISING
        self.operational = False
        self.errors = ErrorLog(self.node, self.send, self._may_send_emcy)
        self._boot_at_ns: int | None = None
        self._started = False
        self._producer = Producer(self.node)
        self._consumer = Consumer(self.node)
        self._rpdos = [Rpdo(self, i - RPDO.start) for i in self._indices(RPDO)]
        self._tpdos = [Tpdo(self, i - TPDO.start) for i in self._indices(TPDO)]
        self._on_sync_tpdos: list[Tpdo] = []
        self._event_tpdos: list[Tpdo] = []
        self.node.checks.append(partial(check_pdo_write, self.node))
        self.node.checks.append(self._check_refusals)
        self.node.sources[0x1000, 0] = self._device_type
        self.node.changed = self._configured

    def poll(self, now_ns: int) -> None:
        """Run the timers: boot, heartbeats, deadlines, event-driven PDOs, faults that end."""
        super().poll(now_ns)
        if not self._started:
            self._started = True
            self._boot(now_ns)
        elif self._boot_at_ns is not None:
            if now_ns >= self._boot_at_ns and not self.unpowered:
                self._boot(now_ns)
            return
        if self._producer.due(now_ns) and not self.mute_heartbeat:
            self.send(_HEARTBEAT + self.node_id, bytes((self.state,)))
        if self._consumer.deadlines:
            for node_id in self._consumer.expired(now_ns):
                self._heartbeat_lost(node_id)
        for rpdo in self._rpdos:
            if rpdo.deadline_ns and rpdo.expired(now_ns):
                self.connection_lost(TIMEOUT)
        if self.operational and not self.mute_pdos:
            for tpdo in self._event_tpdos:
                tpdo.poll(now_ns)

    def send(self, can_id: int, data: bytes) -> None:
        """Put a frame on the device's cable."""
        self.link.send(can_id, data)

    # What a profile adds.

    def written(self, now_ns: int) -> None:
        """React to objects that the master has changed, by RPDO or by SDO."""

    def connection_lost(self, code: int) -> None:
        """React to a silent master: EMCY here; a drive also stops."""
        self.errors.report(code)

    def connection_back(self, code: int) -> None:
        """React to the return of the master."""
        self.errors.resolve(code)

    def state_changed(self, old: int, new: int) -> None:
        """React to a change of the NMT state."""

    def restarted(self) -> None:
        """Restart the application: after power-on and NMT reset node."""

    # Faults.

    def leave_bus(self, _size: float) -> None:
        """Lose the bus, as a CAN controller with too many errors does."""
        self.link.start(OFF_BUS)

    def return_to_bus(self) -> None:
        """Recover from bus-off."""
        self.link.end(OFF_BUS)
        self.errors.report(BUS_OFF_RECOVERED)
        self.errors.resolve(BUS_OFF_RECOVERED)

    def restart(self, _size: float) -> None:
        """Reset in mid-run."""
        self.reset(self.now_ns)

    def send_emcy(self, code: int) -> None:
        """Send an EMCY frame without an error."""
        self.errors.emit(code, register_bits(code) if code > 0xFF else 0)

    def _device_type(self) -> int:
        return _DIGITAL_IO if self.wrong_profile else self.node.variable(0x1000, 0).default

    # PDO owner.

    def length_error(self, code: int, data: bytes) -> None:
        """Report an RPDO of the wrong length, or with code 0 the end of that error."""
        del data
        if code:
            self.errors.report(code)
        else:
            self.errors.resolve(TOO_SHORT)
            self.errors.resolve(TOO_LONG)

    # Frames.

    def _on_nmt(self, data: bytes, now_ns: int) -> None:
        if len(data) != 2 or data[1] not in (0, self.node_id) or self._boot_at_ns is not None:
            return
        self.now_ns = now_ns
        command = data[0]
        if command == _START:
            self._enter(OPERATIONAL)
        elif command == _STOP:
            self._enter(STOPPED)
        elif command == _ENTER_PRE_OPERATIONAL:
            self._enter(PRE_OPERATIONAL)
        elif command in (_RESET_NODE, _RESET_COMMUNICATION):
            self.reset(now_ns, whole=command == _RESET_NODE)

    def _on_sync(self, data: bytes, now_ns: int) -> None:
        if not self.operational:
            return
        self.now_ns = now_ns
        if data:
            self.errors.report(SYNC_LENGTH)
            return
        for rpdo in self._rpdos:
            if rpdo.synchronous:
                rpdo.on_sync(now_ns)
        if not self.mute_pdos:
            for tpdo in self._on_sync_tpdos:
                tpdo.on_sync(now_ns)

    def _on_sdo(self, data: bytes, now_ns: int) -> None:
        self.now_ns = now_ns
        if self.state in (OPERATIONAL, PRE_OPERATIONAL) and not self.silent_sdo:
            self.node.on_sdo(data, now_ns)

    def _on_heartbeat(self, node_id: int, _data: bytes, now_ns: int) -> None:
        self.now_ns = now_ns
        if self._consumer.heard(node_id, now_ns):
            self.connection_back(HEARTBEAT_LOST)

    # States.

    def reset(self, now_ns: int, whole: bool = True) -> None:
        """Reset for a moment and boot with default objects: all, or the communication area."""
        if whole:
            self.node.restore()
        else:
            self.node.restore(_COMMUNICATION_AREA.start, _COMMUNICATION_AREA.stop - 1)
        self._enter(INITIALISING)
        self._consumer.reset()
        for rpdo in self._rpdos:
            rpdo.disarm()
        if whole:
            self.errors.reset()
            self.restarted()
        self._boot_at_ns = now_ns + _BOOT_NS
        self.link.listen({})

    def _boot(self, now_ns: int) -> None:
        self._boot_at_ns = None
        self._refresh()
        self._producer.refresh(now_ns)
        self.send(_HEARTBEAT + self.node_id, b"\x00")
        self._enter(PRE_OPERATIONAL)

    def _enter(self, state: int) -> None:
        old, self.state = self.state, state
        self.operational = state == OPERATIONAL
        if old == state:
            return
        self.state_changed(old, state)
        if self.operational:
            for tpdo in self._tpdos:
                if tpdo.valid and not self.mute_pdos:
                    tpdo.start(self.now_ns)

    def _heartbeat_lost(self, node_id: int) -> None:
        self.connection_lost(HEARTBEAT_LOST)
        fallback = _STATE_AFTER_LOSS.get(self.node.value(0x1029, 1))
        if self.operational and fallback is not None:
            self._enter(fallback)

    # Configuration.

    def _configured(self, index: int) -> None:
        """Apply a write to `index`."""
        if index in _COMMUNICATION_AREA:
            self._refresh(index)
            self._producer.refresh(self.now_ns)
        else:
            self.written(self.now_ns)

    def _refresh(self, index: int | None = None) -> None:
        """Compile the communication objects; `index` limits it to the PDO that was written."""
        number = None if index is None or index < RPDO.start else index & _PDO_INDEX
        for pdos in (self._rpdos, self._tpdos):
            for position, pdo in enumerate(pdos):
                if number is None or number == position:
                    pdo.refresh()
        self._on_sync_tpdos = [p for p in self._tpdos if p.valid and p.synchronous]
        self._event_tpdos = [p for p in self._tpdos if p.valid and not p.synchronous]
        self._consumer.refresh()
        self.link.listen(self._handlers())

    def _handlers(self) -> dict[int, Handler]:
        handlers: dict[int, Handler] = {
            self.node.value(0x1005) & ID_MASK: self._on_sync,
            _SDO_REQUEST + self.node_id: self._on_sdo,
        }
        for rpdo in self._rpdos:
            if rpdo.valid:
                handlers[rpdo.can_id] = rpdo.receive
        for node_id in self._consumer.watched:
            handlers[_HEARTBEAT + node_id] = partial(self._on_heartbeat, node_id)
        return handlers | {_NMT_ID: self._on_nmt}

    def _indices(self, area: range) -> list[int]:
        return [index for index in self.node.object_dictionary if index in area]

    def _may_send_emcy(self) -> bool:
        return self.state in (OPERATIONAL, PRE_OPERATIONAL)

    def _check_refusals(self, index: int, subindex: int, _value: int) -> None:
        guards = ((0x1016, 1), (0x1016, 2), (0x1017, 0), (0x1400, 5))
        if self.refuse_guards and (index, subindex) in guards:
            raise SdoAbortedError(GENERAL_ERROR)
