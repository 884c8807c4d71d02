# SPDX-License-Identifier: Apache-2.0
"""Heartbeat of a simulated device, both ways (CiA 301, section 7.2.8.3.2).

Producer: object 1017. Consumer: object 1016, one entry for each watched node; a timer is armed by
the first heartbeat received, not by the write, and after a loss by the next one.
"""

from __future__ import annotations

from canopen.sdo.exceptions import SdoAbortedError

from screw_module_ros.rig.object_dictionary import INCOMPATIBLE_PARAMETER, DeviceNode

_CONSUMER = 0x1016
_PRODUCER = 0x1017
_MS = 1_000_000


class Producer:
    """Schedules the heartbeats of a device."""

    def __init__(self, node: DeviceNode):
        self._node = node
        self._period_ns = 0
        self._due_ns = 0

    def refresh(self, now_ns: int) -> None:
        """Read the period again; the first heartbeat follows at once."""
        period_ns = self._node.value(_PRODUCER) * _MS
        if period_ns != self._period_ns:
            self._period_ns = period_ns
            self._due_ns = now_ns

    def due(self, now_ns: int) -> bool:
        """Return whether a heartbeat has to go out now; those missed meanwhile are skipped."""
        if not self._period_ns or now_ns < self._due_ns:
            return False
        self._due_ns += self._period_ns * ((now_ns - self._due_ns) // self._period_ns + 1)
        return True


class Consumer:
    """Watches other nodes' heartbeats."""

    def __init__(self, node: DeviceNode):
        self._node = node
        self._limits_ns: dict[int, int] = {}
        self._deadlines_ns: dict[int, int] = {}
        self._lost: set[int] = set()
        node.checks.append(self._check_write)

    @property
    def watched(self) -> tuple[int, ...]:
        """The node ids that are watched."""
        return tuple(self._limits_ns)

    @property
    def deadlines(self) -> dict[int, int]:
        """Node id -> when its heartbeat is overdue [ns], for the timers that are armed."""
        return self._deadlines_ns

    def refresh(self) -> None:
        """Read the entries again; a timer goes on if its entry is still there."""
        count = self._node.value(_CONSUMER, 0)
        entries = [self._node.value(_CONSUMER, number + 1) for number in range(count)]
        self._limits_ns = {
            entry >> 16 & 0xFF: (entry & 0xFFFF) * _MS for entry in entries if _used(entry)
        }
        kept = self._limits_ns
        self._deadlines_ns = {i: due for i, due in self._deadlines_ns.items() if i in kept}
        self._lost &= set(kept)

    def heard(self, node_id: int, now_ns: int) -> bool:
        """Arm or restart the timer of a node. True when its heartbeat had been lost."""
        self._deadlines_ns[node_id] = now_ns + self._limits_ns[node_id]
        if node_id not in self._lost:
            return False
        self._lost.discard(node_id)
        return True

    def expired(self, now_ns: int) -> list[int]:
        """Return the nodes whose heartbeat has just been lost."""
        lost = [node_id for node_id, due in self._deadlines_ns.items() if now_ns >= due]
        for node_id in lost:
            del self._deadlines_ns[node_id]
            self._lost.add(node_id)
        return lost

    def reset(self) -> None:
        """Disarm every timer."""
        self._deadlines_ns.clear()
        self._lost.clear()

    def _check_write(self, index: int, subindex: int, value: int) -> None:
        """Refuse a second entry for one node, as CiA 301 asks."""
        if index != _CONSUMER or not _used(value):
            return
        for number in range(1, self._node.value(_CONSUMER, 0) + 1):
            other = self._node.value(_CONSUMER, number)
            if number != subindex and _used(other) and (other ^ value) >> 16 == 0:
                raise SdoAbortedError(INCOMPATIBLE_PARAMETER)


def _used(entry: int) -> bool:
    return bool(entry & 0xFFFF) and 0 < entry >> 16 & 0xFF < 0x80
