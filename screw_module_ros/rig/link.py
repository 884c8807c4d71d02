# SPDX-License-Identifier: Apache-2.0
"""The cable between one simulated device and its bus, with the faults of its frames.

They affect only frames that this device sends or receives; other devices on a shared bus continue
undisturbed. Several faults may be active at once; each changes the frames that the one before let
through. The table of these faults, with units and ranges, is `faults.CABLE`.
"""

from __future__ import annotations

import random
import zlib

from screw_module_ros.rig.port import Handler, RigPort

UNPLUGGED = "adapter_out"
"""The fault of the bus and not of the device: it ends for all who reach the bus."""
OFF_BUS = "off_bus"
"""Not in the table of faults: with it a device's controller leaves the bus."""
LARGEST_BURST = 200.0
"""Frames of a flood per `poll`."""

_LONGEST = 8
_PADDING = b"\xaa"
_OTHER_NODE = 0x40
"""Flipping this bit turns a frame of ours into one of a node that does not exist."""
_DEAF = {"cable_out", "deaf", OFF_BUS}
_FLOOD_ID = 0x001
"""Highest priority below NMT; no device uses it."""
_FLOOD_FRAME = b"\xff" * _LONGEST
_MS = 1_000_000
_HOLD_NS = 5 * _MS  # longest wait of a frame for the one with which it changes places

Frame = tuple[int, bytes]


class Link:
    """The cable of one device.

    port: its bus; device: its name, the seed of the random faults. faults: the active ones, oldest
    first, with their sizes.
    """

    def __init__(self, port: RigPort, device: str):
        self.port = port
        self._handlers: dict[int, Handler] = {}
        self.faults: dict[str, float] = {}
        self._random = random.Random(zlib.crc32(device.encode()))
        self._held: Frame | None = None
        self._late: list[tuple[int, Frame]] = []
        self._flooded_ns = 0
        port.members.append(self.received)

    def listen(self, handlers: dict[int, Handler]) -> None:
        """Replace the device's handlers: frame id -> handler."""
        self._handlers = handlers
        self.port.rebuild()

    def received(self) -> dict[int, Handler]:
        """Return the handlers that frames reach."""
        return self._handlers if _DEAF.isdisjoint(self.faults) else {}

    def send(self, can_id: int, data: bytes) -> None:
        """Send a frame of the device, through the faults if there are any."""
        if not self.faults:
            self.port.send(can_id, data)
            return
        frames = [(can_id, bytes(data))]
        for fault, size in self.faults.items():
            frames = [changed for frame in frames for changed in self._changed(fault, size, frame)]
        for frame in frames:
            self.port.send(*frame)

    def start(self, fault: str, size: float = 0.0) -> None:
        """Begin a fault; size: in the unit of `faults.CABLE`."""
        self.faults[fault] = size
        self._flooded_ns = self.port.now_ns
        if fault == UNPLUGGED:
            self.port.plug(False)
        self.port.rebuild()

    def end(self, fault: str) -> None:
        """End a fault; after the last one, send the frames that were held back."""
        self.faults.pop(fault, None)
        if fault == UNPLUGGED:
            self.port.plug(True)
        self.port.rebuild()
        if not self.faults:
            self._release(all_of_them=True)

    def poll(self, now_ns: int) -> None:
        """Send frames whose delay is over, and the flood's frames since the last call.

        Only faults hold frames back: without any there is nothing to do.
        """
        self.port.now_ns = now_ns
        self._release()
        rate = self.faults.get("flood", 0.0)
        count = int(min(rate * (now_ns - self._flooded_ns) / _MS, LARGEST_BURST))
        if count > 0:
            self._flooded_ns = now_ns
            for _ in range(count):
                self.port.send(_FLOOD_ID, _FLOOD_FRAME)

    def _release(self, all_of_them: bool = False) -> None:
        late, self._late = self._late, []
        for due_ns, frame in late:
            if all_of_them or due_ns <= self.port.now_ns:
                self.port.send(*frame)
            else:
                self._late.append((due_ns, frame))
        if self._held and (all_of_them or self.port.now_ns - self._held_ns > _HOLD_NS):
            frame, self._held = self._held, None
            self.port.send(*frame)

    def _changed(self, fault: str, size: float, frame: Frame) -> list[Frame]:
        """Return what a fault makes of a frame that the device sends."""
        can_id, data = frame
        match fault:
            case "cable_out" | "mute" | "off_bus":
                return []
            case "drop":
                return [] if self._random.random() < size else [frame]
            case "truncate":
                return [(can_id, data[: max(0, len(data) - int(size))])]
            case "lengthen":
                return [(can_id, (data + _PADDING * int(size))[:_LONGEST])]
            case "garbage":
                return [(can_id, self._random.randbytes(len(data)))]
            case "duplicate":
                return [frame, frame]
            case "reorder":
                return self._swapped(frame)
            case "delay":
                self._late.append((self.port.now_ns + int(size * _MS), frame))
                return []
            case "wrong_id":
                return [(can_id ^ _OTHER_NODE, data)]
            case "foreign_ids":
                return [frame, (can_id ^ _OTHER_NODE, self._random.randbytes(_LONGEST))]
        return [frame]  # deaf and flood leave it as it is

    def _swapped(self, frame: Frame) -> list[Frame]:
        if self._held is None:
            self._held, self._held_ns = frame, self.port.now_ns
            return []
        earlier, self._held = self._held, None
        return [frame, earlier]
