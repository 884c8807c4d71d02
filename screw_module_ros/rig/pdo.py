# SPDX-License-Identifier: Apache-2.0
"""Process data of a simulated device, as the master configured it (CiA 301, section 7.2.2).

After every write to it a PDO is read from the object dictionary and compiled into one `struct` and
a few functions. So a wrong mapping of the master takes effect as on a real device, and the cyclic
path stays short.

A master has to disable a PDO before it changes its id or mapping, and to clear the mapping before
it writes entries (sections 7.5.2.35 to 38): `check_pdo_write` refuses another order, which a
simulated device without these checks would hide.
"""

from __future__ import annotations

import struct
from functools import partial
from typing import TYPE_CHECKING

from canopen.objectdictionary import (
    BOOLEAN,
    INTEGER8,
    INTEGER16,
    INTEGER32,
    REAL32,
    UNSIGNED8,
    UNSIGNED16,
    UNSIGNED32,
)

from screw_module_ros.rig.object_dictionary import (
    INVALID_VALUE,
    NO_OBJECT,
    NOT_MAPPABLE,
    PDO_TOO_LONG,
    UNSUPPORTED_ACCESS,
    ObjectDictionary,
    require,
)

if TYPE_CHECKING:
    from screw_module_ros.rig.canopen_device import CanopenDevice

RPDO, TPDO = range(0x1400, 0x1600), range(0x1800, 0x1A00)
INVALID_BIT = 1 << 31
ID_MASK = 0x7FF
TOO_SHORT, TOO_LONG, TIMEOUT = 0x8210, 0x8220, 0x8250

_RPDO_MAPPING, _TPDO_MAPPING = range(0x1600, 0x1800), range(0x1A00, 0x1C00)
_MAPPING_OFFSET = 0x200
_COB_ID, _TRANSMISSION_TYPE, _INHIBIT_TIME, _EVENT_TIMER = 1, 2, 3, 5
_LAST_CYCLIC = 240
_RESERVED_TYPES = range(241, 254)
_EXTENDED_BIT = 1 << 29
_ID_BITS = 0x3FFFFFFF
_MOST_ENTRIES, _MOST_BITS = 8, 64
_LAST_DUMMY = 7
_RESTRICTED_IDS = (
    range(0x080),
    range(0x101, 0x181),
    range(0x581, 0x600),
    range(0x601, 0x680),
    range(0x6E0, 0x700),
    range(0x701, 0x800),
)
_MS = 1_000_000
_INHIBIT_UNIT = 100_000
_CODES: dict[int | None, str] = {
    BOOLEAN: "B",
    INTEGER8: "b",
    INTEGER16: "h",
    INTEGER32: "i",
    UNSIGNED8: "B",
    UNSIGNED16: "H",
    UNSIGNED32: "I",
    REAL32: "f",
}


class _Pdo:
    """What both directions share; index: of the communication parameter."""

    def __init__(self, device: CanopenDevice, index: int):
        self.index, self.indices = index, (index, index + _MAPPING_OFFSET)
        self._device = device
        self.refresh()

    def refresh(self) -> None:
        """Read the configuration again."""
        node, mapping = self._device.node, self.index + _MAPPING_OFFSET
        cob_id = node.value(self.index, _COB_ID)
        self.can_id = cob_id & ID_MASK
        self._kind = node.value(self.index, _TRANSMISSION_TYPE)
        self._event_ns = node.optional(self.index, _EVENT_TIMER, 0) * _MS
        entries = [node.value(mapping, 1 + number) for number in range(node.value(mapping, 0))]
        self._keys = [(entry >> 16, entry >> 8 & 0xFF) for entry in entries]
        codes = [_CODES[node.variable(*key).data_type] for key in self._keys]
        self._struct = struct.Struct("<" + "".join(codes))
        self.valid = not cob_id & INVALID_BIT and bool(entries)
        self.synchronous = self._kind <= _LAST_CYCLIC


class Tpdo(_Pdo):
    """One transmit PDO."""

    _last = b""
    _sent_ns = _syncs = 0

    def refresh(self) -> None:
        """Read the configuration again."""
        super().refresh()
        node = self._device.node
        self._inhibit_ns = node.optional(self.index, _INHIBIT_TIME, 0) * _INHIBIT_UNIT
        self._sources = [
            node.sources.get(key) or partial(node.value, *key) for key in self._keys
        ]

    def start(self, now_ns: int) -> None:
        """Start at NMT start: SYNCs count from now, and an event-driven PDO is sent once."""
        self._syncs = 0
        if not self.synchronous:
            self._transmit(self._pack(), now_ns)

    def on_sync(self, now_ns: int) -> None:
        """Count one SYNC and send when it is the PDO's turn; type 0 sends what has changed."""
        self._syncs += 1
        if self._syncs < self._kind:
            return
        self._syncs = 0
        data = self._pack()
        if self._kind or data != self._last:
            self._transmit(data, now_ns)

    def poll(self, now_ns: int) -> None:
        """Send an event-driven PDO whose event timer ran out or whose content has changed."""
        waited = now_ns - self._sent_ns
        if waited < self._inhibit_ns:
            return
        data = self._pack()
        if data != self._last or (self._event_ns and waited >= self._event_ns):
            self._transmit(data, now_ns)

    def _pack(self) -> bytes:
        values = []
        for source in self._sources:
            values.append(source())
        return self._struct.pack(*values)

    def _transmit(self, data: bytes, now_ns: int) -> None:
        self._last, self._sent_ns = data, now_ns
        self._device.send(self.can_id, data)


class Rpdo(_Pdo):
    """One receive PDO.

    Its deadline timer (sub-index 5) is armed by a frame, not by the write of the sub-index.
    deadline_ns: when it runs out [ns], 0 = not armed.
    """

    _held: bytes | None = None
    deadline_ns = 0

    def refresh(self) -> None:
        """Read the configuration again; a timer set to zero or a PDO switched off is disarmed."""
        super().refresh()
        self._event_ns = self._event_ns or self._device.own_deadline_ns()
        node = self._device.node
        # No object but the dummies lacks a sink.
        self._sinks = [node.sinks.get(key) or partial(node.put, *key) for key in self._keys]
        if not (self.valid and self._event_ns):
            self.deadline_ns = 0

    def receive(self, data: bytes, now_ns: int) -> None:
        """Process a frame: refuse a short one, truncate a long one, report both."""
        device, size = self._device, self._struct.size
        if not device.operational or device.deaf_pdos:
            return
        if len(data) < size:
            device.errors.report(TOO_SHORT)
            return
        if len(data) > size:
            device.errors.report(TOO_LONG)
        elif device.errors.active:
            device.errors.resolve(TOO_SHORT)
            device.errors.resolve(TOO_LONG)
        self.deadline_ns = now_ns + self._event_ns if self._event_ns else 0
        if device.errors.active:
            device.connection_back(TIMEOUT)
        if self.synchronous:
            self._held = data[:size]
        else:
            self._apply(data[:size], now_ns)

    def on_sync(self, now_ns: int) -> None:
        """Apply a synchronous PDO that has arrived since the last SYNC."""
        if self._held is not None:
            data, self._held = self._held, None
            self._apply(data, now_ns)

    def expire(self) -> None:
        """Report a missed deadline, once; the next frame arms the timer again."""
        self.deadline_ns = 0
        self._device.connection_lost(TIMEOUT)

    def disarm(self) -> None:
        """Clear the deadline and a held frame, as a reset does."""
        self.deadline_ns = 0
        self._held = None

    def _apply(self, data: bytes, now_ns: int) -> None:
        for sink, value in zip(self._sinks, self._struct.unpack(data), strict=True):
            sink(value)
        self._device.written(now_ns)


def check_pdo_write(node: ObjectDictionary, index: int, subindex: int, value: int) -> None:
    """Raise SdoAbortedError when `node` would not accept this write to a PDO parameter."""
    if index in RPDO or index in TPDO:
        _check_communication(node, index, subindex, value)
    elif index in _RPDO_MAPPING or index in _TPDO_MAPPING:
        _check_mapping(node, index, subindex, value)


def _check_communication(node: ObjectDictionary, index: int, subindex: int, value: int) -> None:
    present = node.value(index, _COB_ID)
    valid = not present & INVALID_BIT
    if subindex == _COB_ID:
        require(not value & _EXTENDED_BIT, INVALID_VALUE)
        if not value & INVALID_BIT:
            require(not valid or not (value ^ present) & _ID_BITS, INVALID_VALUE)
            require(not any(value & ID_MASK in ids for ids in _RESTRICTED_IDS), INVALID_VALUE)
    elif subindex == _TRANSMISSION_TYPE:
        require(value not in _RESERVED_TYPES, INVALID_VALUE)
    elif subindex == _INHIBIT_TIME:
        require(not valid, INVALID_VALUE)


def _check_mapping(node: ObjectDictionary, index: int, subindex: int, value: int) -> None:
    identifier = index - _MAPPING_OFFSET, _COB_ID
    may_stay = not node.variable(*identifier).writable  # it cannot be disabled, but mapped
    require(may_stay or node.value(*identifier) & INVALID_BIT, UNSUPPORTED_ACCESS)
    received = index in _RPDO_MAPPING
    if subindex:
        require(not node.value(index, 0), UNSUPPORTED_ACCESS)
        _check_entry(node, value, received)
        return
    require(value <= _MOST_ENTRIES, PDO_TOO_LONG)
    entries = [node.value(index, number) for number in range(1, value + 1)]
    for entry in entries:
        _check_entry(node, entry, received)
    require(sum(entry & 0xFF for entry in entries) <= _MOST_BITS, PDO_TOO_LONG)


def _check_entry(node: ObjectDictionary, entry: int, received: bool) -> None:
    """Raise SdoAbortedError when an entry (index, subindex, bits) cannot be mapped."""
    index, subindex, bits = entry >> 16, entry >> 8 & 0xFF, entry & 0xFF
    require(index, NO_OBJECT)
    variable = node.variable(index, subindex)
    reachable = variable.writable if received else variable.readable
    dummy = received and index <= _LAST_DUMMY
    allowed = dummy or (variable.pdo_mappable and reachable)
    require(allowed and bits == len(variable), NOT_MAPPABLE)
