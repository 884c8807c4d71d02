# SPDX-License-Identifier: Apache-2.0
"""Process data of a simulated device, as the master configured it (CiA 301, section 7.2.2).

After every write to it a PDO is read from the object dictionary and compiled into one `struct` and
a few functions. So a wrong mapping of the master takes effect as on a real device, and the cyclic
path stays short.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Protocol

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
from canopen.sdo.exceptions import SdoAbortedError

from screw_module_ros.rig.object_dictionary import DeviceNode
from screw_module_ros.rig.pdo_rules import (
    COB_ID,
    EVENT_TIMER,
    ID_MASK,
    INHIBIT_TIME,
    INVALID_BIT,
    MAPPING_OFFSET,
    TRANSMISSION_TYPE,
)

TOO_SHORT = 0x8210
TOO_LONG = 0x8220
TIMEOUT = 0x8250

_LAST_CYCLIC = 240
_MS = 1_000_000
_INHIBIT_UNIT = 100_000
_CODES = {
    BOOLEAN: "B",
    INTEGER8: "b",
    INTEGER16: "h",
    INTEGER32: "i",
    UNSIGNED8: "B",
    UNSIGNED16: "H",
    UNSIGNED32: "I",
    REAL32: "f",
}


class Owner(Protocol):
    """The device a PDO belongs to."""

    node: DeviceNode
    operational: bool
    deaf_pdos: bool

    def send(self, can_id: int, data: bytes) -> None:
        """Put a frame on the bus."""

    def length_error(self, code: int, data: bytes) -> None:
        """Report an RPDO of the wrong length; code 0 = the next good one."""

    def written(self, now_ns: int) -> None:
        """React to objects that an RPDO has changed."""

    def connection_back(self, code: int) -> None:
        """React to an RPDO that comes again after its deadline."""


def _mapping(node: DeviceNode, index: int) -> tuple[struct.Struct, list[tuple[int, int]]]:
    entries = [node.value(index, number + 1) for number in range(node.value(index, 0))]
    keys = [(entry >> 16, entry >> 8 & 0xFF) for entry in entries]
    codes = [_CODES[node.variable(*key).data_type] for key in keys]
    return struct.Struct("<" + "".join(codes)), keys


class Tpdo:
    """One transmit PDO; `number` counts from 0."""

    def __init__(self, owner: Owner, number: int):
        self._owner = owner
        self._index = 0x1800 + number
        self._last = b""
        self._sent_ns = self._syncs = 0
        self.refresh()

    def refresh(self) -> None:
        """Read the configuration again."""
        node = self._owner.node
        cob_id = node.value(self._index, COB_ID)
        self.can_id = cob_id & ID_MASK
        self.kind = node.value(self._index, TRANSMISSION_TYPE)
        self._inhibit_ns = node.value(self._index, INHIBIT_TIME) * _INHIBIT_UNIT
        self._event_ns = node.value(self._index, EVENT_TIMER) * _MS
        self._struct, keys = _mapping(node, self._index + MAPPING_OFFSET)
        self._sources = [_source(node, key) for key in keys]
        self.valid = not cob_id & INVALID_BIT and bool(keys)
        self.synchronous = self.kind <= _LAST_CYCLIC

    def start(self, now_ns: int) -> None:
        """Start at NMT start: SYNCs count from now, and an event-driven PDO is sent once."""
        self._syncs = 0
        if not self.synchronous:
            self._transmit(self.pack(), now_ns)

    def pack(self) -> bytes:
        """Return the present payload."""
        return self._struct.pack(*[source() for source in self._sources])

    def on_sync(self, now_ns: int) -> None:
        """Count one SYNC and send when it is the PDO's turn; type 0 sends what has changed."""
        self._syncs += 1
        if self._syncs < self.kind:
            return
        self._syncs = 0
        data = self.pack()
        if self.kind or data != self._last:
            self._transmit(data, now_ns)

    def poll(self, now_ns: int) -> None:
        """Send an event-driven PDO whose event timer ran out or whose content has changed."""
        waited = now_ns - self._sent_ns
        if waited < self._inhibit_ns:
            return
        data = self.pack()
        if data != self._last or (self._event_ns and waited >= self._event_ns):
            self._transmit(data, now_ns)

    def _transmit(self, data: bytes, now_ns: int) -> None:
        self._last = data
        self._sent_ns = now_ns
        self._owner.send(self.can_id, data)


class Rpdo:
    """One receive PDO; `number` counts from 0."""

    def __init__(self, owner: Owner, number: int):
        self._owner = owner
        self._index = 0x1400 + number
        self._held: bytes | None = None
        self._bad_length = self._late = False
        #: when the deadline timer (sub-index 5) runs out [ns], 0 = not armed
        self.deadline_ns = 0
        self.refresh()

    def refresh(self) -> None:
        """Read the configuration again; a timer set to zero or a PDO switched off is disarmed."""
        node = self._owner.node
        cob_id = node.value(self._index, COB_ID)
        self.can_id = cob_id & ID_MASK
        self.synchronous = node.value(self._index, TRANSMISSION_TYPE) <= _LAST_CYCLIC
        self._event_ns = node.value(self._index, EVENT_TIMER) * _MS
        self._struct, keys = _mapping(node, self._index + MAPPING_OFFSET)
        self._sinks = [_sink(node, key) for key in keys]
        self.valid = not cob_id & INVALID_BIT and bool(keys)
        if not (self.valid and self._event_ns):
            self.deadline_ns = 0

    def receive(self, data: bytes, now_ns: int) -> None:
        """Process a frame: refuse a short one, truncate a long one, report both."""
        owner = self._owner
        if not owner.operational or owner.deaf_pdos:
            return
        size = self._struct.size
        if len(data) < size:
            self._bad_length = True
            owner.length_error(TOO_SHORT, data)
            return
        if len(data) > size:
            self._bad_length = True
            owner.length_error(TOO_LONG, data)
            data = data[:size]
        elif self._bad_length:
            self._bad_length = False
            owner.length_error(0, data)
        self.deadline_ns = now_ns + self._event_ns if self._event_ns else 0
        if self._late:
            self._late = False
            owner.connection_back(TIMEOUT)
        if self.synchronous:
            self._held = data
        else:
            self._apply(data, now_ns)

    def on_sync(self, now_ns: int) -> None:
        """Apply a synchronous PDO that has arrived since the last SYNC."""
        if self._held is not None:
            data, self._held = self._held, None
            self._apply(data, now_ns)

    def expired(self, now_ns: int) -> bool:
        """Return True once after a missed deadline; the next frame arms it again."""
        if not self.deadline_ns or now_ns < self.deadline_ns:
            return False
        self.deadline_ns = 0
        self._late = True
        return True

    def disarm(self) -> None:
        """Clear the deadline and a held frame, as a reset does."""
        self.deadline_ns = 0
        self._held = None
        self._late = self._bad_length = False

    def _apply(self, data: bytes, now_ns: int) -> None:
        for sink, value in zip(self._sinks, self._struct.unpack(data), strict=True):
            sink(value)
        self._owner.written(now_ns)


def _source(node: DeviceNode, key: tuple[int, int]) -> Callable[[], int]:
    source = node.sources.get(key)
    return source if source is not None else lambda: node.value(*key)


def _sink(node: DeviceNode, key: tuple[int, int]) -> Callable[[int], None]:
    sink = node.sinks.get(key)
    if sink is not None:
        return sink
    variable = node.variable(*key)

    def store(value: int) -> None:
        try:
            node.set_data(*key, variable.encode_raw(value))
        except SdoAbortedError:
            pass  # the device ignores a refused value: a PDO has no answer

    return store
