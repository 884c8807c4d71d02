# SPDX-License-Identifier: Apache-2.0
"""Base of every simulated CANopen device (CiA 301): NMT, SDO, SYNC, PDO, heartbeat, EMCY.

The object dictionary is the only configuration: each write of the master takes effect at once. Time
is passed in with every frame and every `poll`.
"""

from __future__ import annotations

from functools import partial

from screw_module_ros.profiles import Profile, key_of
from screw_module_ros.rig.device import SimulatedDevice
from screw_module_ros.rig.emcy import ErrorLog
from screw_module_ros.rig.faults import CANOPEN
from screw_module_ros.rig.link import OFF_BUS, Link
from screw_module_ros.rig.object_dictionary import (
    GENERAL_ERROR,
    INCOMPATIBLE_PARAMETER,
    INVALID_VALUE,
    ObjectDictionary,
    require,
)
from screw_module_ros.rig.pdo import ID_MASK, RPDO, TPDO, Rpdo, Tpdo, check_pdo_write
from screw_module_ros.rig.port import Handler

INITIALISING, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
HEARTBEAT_LOST, BUS_OFF_RECOVERED, SYNC_LENGTH = 0x8130, 0x8140, 0x8240

_START, _STOP, _ENTER_PRE_OPERATIONAL, _RESET_NODE, _RESET_COMMUNICATION = 1, 2, 128, 129, 130
_NMT_ID = 0x000
_SDO_REQUEST, _HEARTBEAT = 0x600, 0x700
_ALL_OBJECTS, _COMMUNICATION_AREA = range(0x10000), range(0x1000, 0x2000)
_CONSUMER, _PRODUCER = 0x1016, 0x1017
_STATE_AFTER_LOSS = {0: PRE_OPERATIONAL, 2: STOPPED}
_GUARDS = ((_CONSUMER, 1), (_CONSUMER, 2), (_PRODUCER, 0), (0x1400, 5))
_DIGITAL_IO = 0x00000191
"""Object 1000 of a device for CiA 401."""
_MS = 1_000_000
_BOOT_NS = 20 * _MS
"""Time without communication after a reset."""


class CanopenDevice(SimulatedDevice):
    """One node on the bus.

    name: in faults and reports; link: its cable; node_id: 1..127; eds: its EDS file; make: how it
    differs from that.
    """

    FAULTS = CANOPEN
    unpowered = mute_heartbeat = mute_pdos = deaf_pdos = silent_sdo = False
    refuse_guards = wrong_profile = False
    _hung = False

    def __init__(self, name: str, link: Link, node_id: int, eds: str, profile: Profile):
        super().__init__(name, link)
        self.node_id = node_id
        self.traits = profile.simulated
        self.node = node = ObjectDictionary(
            node_id, eds, profile.objects, self.send, self._configured
        )
        self.state = INITIALISING
        self.operational = False
        self.errors = ErrorLog(node, self._send_emcy)
        self._boot_at_ns: int | None = 0
        self._beat_ns = self._next_beat_ns = self._sync_length = 0
        self._watched_ns: dict[int, int] = {}  # node id -> longest time between its heartbeats
        self._deadlines_ns: dict[int, int] = {}  # of the watches that are armed
        self._lost: set[int] = set()
        node.checks.append(self._check)
        node.sources[0x1000, 0] = self._device_type
        self._rpdos = [Rpdo(self, i) for i in node.object_dictionary if i in RPDO]
        self._tpdos = [Tpdo(self, i) for i in node.object_dictionary if i in TPDO]
        self._on_sync_tpdos: list[Tpdo] = []
        self._event_tpdos: list[Tpdo] = []

    def poll(self, now_ns: int) -> None:
        """Run the timers: boot, heartbeats, deadlines, event-driven PDOs, faults that end."""
        super().poll(now_ns)
        if self._boot_at_ns is not None:
            if now_ns >= self._boot_at_ns and not self.unpowered:
                self._boot()
            return
        if self._hung:
            return
        if self._beat_ns and now_ns >= self._next_beat_ns:
            self._beat()
        for node_id, due_ns in (*self._deadlines_ns.items(),):
            if now_ns >= due_ns:
                self._heartbeat_lost(node_id)
        for rpdo in self._rpdos:
            if rpdo.deadline_ns and now_ns >= rpdo.deadline_ns:
                rpdo.expire()
        if self.operational and not self.mute_pdos:
            for tpdo in self._event_tpdos:
                tpdo.poll(now_ns)

    def send(self, can_id: int, data: bytes) -> None:
        """Put a frame on the device's cable."""
        self.link.send(can_id, data)

    def _send_emcy(self, can_id: int, data: bytes) -> None:
        if self.state in (OPERATIONAL, PRE_OPERATIONAL) and not self._hung:
            self.send(can_id, data)

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

    # Heartbeats (CiA 301, section 7.2.8.3.2): a node's first one arms its watch, not the write.

    def _beat(self) -> None:
        """Send the heartbeat that is due; those missed meanwhile are skipped."""
        late_ns = self.now_ns - self._next_beat_ns
        self._next_beat_ns += self._beat_ns * (late_ns // self._beat_ns + 1)
        if not self.mute_heartbeat:
            self.send(_HEARTBEAT + self.node_id, bytes((self.state,)))

    def _on_heartbeat(self, node_id: int, _data: bytes, now_ns: int) -> None:
        self.now_ns = now_ns
        self._deadlines_ns[node_id] = now_ns + self._watched_ns[node_id]
        if node_id in self._lost:
            self._lost.discard(node_id)
            self.connection_back(HEARTBEAT_LOST)

    def _heartbeat_lost(self, node_id: int) -> None:
        del self._deadlines_ns[node_id]
        self._lost.add(node_id)
        self.connection_lost(HEARTBEAT_LOST)
        fallback = _STATE_AFTER_LOSS.get(self.node.value(0x1029, 1))
        if self.operational and fallback is not None:
            self._enter(fallback)

    def _refresh_heartbeats(self) -> None:
        """Read 1016 and 1017 again; a watch goes on, a new period begins with a heartbeat."""
        entries = [entry for _, entry in self._watches()]
        self._watched_ns = {entry >> 16 & 0xFF: (entry & 0xFFFF) * _MS for entry in entries}
        kept = self._watched_ns
        self._deadlines_ns = {i: due for i, due in self._deadlines_ns.items() if i in kept}
        self._lost &= set(kept)
        beat_ns = self.node.value(_PRODUCER) * _MS
        if beat_ns != self._beat_ns:
            self._beat_ns, self._next_beat_ns = beat_ns, self.now_ns

    def _watches(self) -> list[tuple[int, int]]:
        """Return the subindices and values of the entries of 1016 that are used."""
        numbers = range(1, self.node.optional(_CONSUMER, 0, 0) + 1)
        entries = [(number, self.node.value(_CONSUMER, number)) for number in numbers]
        return [(number, entry) for number, entry in entries if _watches_a_node(entry)]

    # Frames.

    def _on_nmt(self, data: bytes, now_ns: int) -> None:
        if len(data) != 2 or data[1] not in (0, self.node_id):
            return
        self.now_ns = now_ns
        command = data[0]
        if self._hung and command not in (_RESET_NODE, _RESET_COMMUNICATION):
            return
        if command == _START:
            self._enter(OPERATIONAL)
        elif command == _STOP:
            self._enter(STOPPED)
        elif command == _ENTER_PRE_OPERATIONAL:
            self._enter(PRE_OPERATIONAL)
        elif command in (_RESET_NODE, _RESET_COMMUNICATION):
            self._reset(whole=command == _RESET_NODE)

    def _on_sync(self, data: bytes, now_ns: int) -> None:
        if not self.operational:
            return
        self.now_ns = now_ns
        if len(data) != self._sync_length:
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
            self.node.on_sdo(data)

    # States.

    def _reset(self, whole: bool) -> None:
        """Reset for a moment and boot with default objects: all, or the communication area."""
        self._hung = False
        self.node.restore(_ALL_OBJECTS if whole else _COMMUNICATION_AREA)
        self._enter(INITIALISING)
        self._deadlines_ns.clear()
        self._lost.clear()
        for rpdo in self._rpdos:
            rpdo.disarm()
        if whole:
            self.errors.restart()
            self.restarted()
        self._boot_at_ns = self.now_ns + _BOOT_NS
        self.link.listen({})

    def _boot(self) -> None:
        self._boot_at_ns = None
        self._refresh()
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

    # Configuration.

    def _check(self, index: int, subindex: int, value: int) -> None:
        """Refuse what CiA 301 does not allow: two watches of one node, for instance."""
        if index == _CONSUMER and _watches_a_node(value):
            others = [entry for number, entry in self._watches() if number != subindex]
            unique = all((entry ^ value) >> 16 for entry in others)
            require(unique, INCOMPATIBLE_PARAMETER)
        check_pdo_write(self.node, index, subindex, value)
        types = self.traits.transmission_types
        is_type = subindex == 2 and (index in RPDO or index in TPDO)
        require(not (types and is_type) or value in types, INVALID_VALUE)
        require(not self.refuse_guards or (index, subindex) not in _GUARDS, GENERAL_ERROR)

    def own_deadline_ns(self) -> int:
        """Return the maker's own deadline for commands [ns], 0 = none."""
        cycle, count = self.traits.cycle_object, self.traits.deadline_object
        if not cycle:
            return 0
        return self.node.value(*key_of(cycle)) * self.node.value(*key_of(count)) * 1000

    def _configured(self, index: int) -> None:
        """Apply a write to `index`."""
        own = (self.traits.cycle_object, self.traits.deadline_object)
        if index in [key_of(key)[0] for key in own if key]:
            self._refresh()
        elif index in _COMMUNICATION_AREA:
            self._refresh(index)
        else:
            self.written(self.now_ns)

    def _refresh(self, index: int | None = None) -> None:
        """Compile the communication objects; of the PDOs the one that was written, None = all."""
        for pdo in (*self._rpdos, *self._tpdos):
            if index in (None, *pdo.indices):
                pdo.refresh()
        self._on_sync_tpdos = [p for p in self._tpdos if p.valid and p.synchronous]
        self._event_tpdos = [p for p in self._tpdos if p.valid and not p.synchronous]
        self._refresh_heartbeats()
        self._sync_length = 1 if self.node.optional(0x1019, 0, 0) else 0  # a counter in SYNC
        self.link.listen(self._handlers())

    def _handlers(self) -> dict[int, Handler]:
        handlers: dict[int, Handler] = {
            self.node.value(0x1005) & ID_MASK: self._on_sync,
            _SDO_REQUEST + self.node_id: self._on_sdo,
        }
        handlers |= {rpdo.can_id: rpdo.receive for rpdo in self._rpdos if rpdo.valid}
        for node_id in self._watched_ns:
            handlers[_HEARTBEAT + node_id] = partial(self._on_heartbeat, node_id)
        return handlers | {_NMT_ID: self._on_nmt}

    def _device_type(self) -> int:
        return _DIGITAL_IO if self.wrong_profile else self.node.variable(0x1000, 0).default or 0

    # Faults.

    def return_to_bus(self) -> None:
        """Recover from bus-off."""
        self.link.end(OFF_BUS)
        self.errors.report(BUS_OFF_RECOVERED)
        self.errors.resolve(BUS_OFF_RECOVERED)

    def hang(self, _size: float) -> None:
        """Answer and send nothing until a reset; the application treats its master as lost."""
        self._hung = True
        self.connection_lost(HEARTBEAT_LOST)
        self._enter(PRE_OPERATIONAL)
        self.link.listen({_NMT_ID: self._on_nmt})

    def restart(self, _size: float) -> None:
        """Reset in mid-run."""
        self._reset(whole=True)

    def send_emcy(self, code: int) -> None:
        """Send an EMCY frame without an error."""
        self.errors.pretend(code)


def _watches_a_node(entry: int) -> bool:
    """Return whether an entry of 1016 has a node id and a time."""
    return bool(entry & 0xFFFF) and 0 < entry >> 16 & 0xFF < 0x80
