# SPDX-License-Identifier: Apache-2.0
"""Faults of one device's cable, which change, delay or drop its frames.

They affect only frames that this device sends or receives; other devices on a shared bus continue
undisturbed. Several faults may be active at once; each processes the output of the one before.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import NamedTuple

from screw_module_ros.rig.port import Handler, Link

Frame = tuple[int, bytes]

_LONGEST = 8
_PADDING = b"\xaa"
_OTHER_NODE = 0x40
"""Flipping this bit turns a frame of ours into one of a node that does not exist."""
OFF_BUS = "off_bus"
"""Not in the table of faults: with it a device's controller leaves the bus."""
_DEAF = {"cable_out", "deaf", OFF_BUS}
_FLOOD_ID = 0x001
"""Highest priority below NMT; no device uses it."""
_FLOOD_FRAME = b"\xff" * _LONGEST
_LARGEST_BURST = 200  # frames of a flood per `poll`
_MS = 1_000_000
_HOLD_NS = 5 * _MS  # longest wait of a frame for the one with which it changes places


class FrameFault(NamedTuple):
    """Effect of a frame fault, and the meaning of its value."""

    text: str
    unit: str = ""
    default: float = 0.0
    low: float = 0.0
    high: float = 0.0


FRAME_FAULTS = {
    "cable_out": FrameFault("nothing goes out and nothing comes in"),
    "mute": FrameFault("nothing goes out"),
    "deaf": FrameFault("nothing comes in"),
    "drop": FrameFault("frames it sends are lost at random", "share", 0.5, 0.0, 1.0),
    "drop_in": FrameFault("frames it should hear are lost at random", "share", 0.5, 0.0, 1.0),
    "truncate": FrameFault("frames lose their last bytes", "bytes", 1, 1, 8),
    "lengthen": FrameFault("frames shorter than 8 bytes grow", "bytes", 1, 1, 8),
    "garbage": FrameFault("payloads are random, of the right length"),
    "duplicate": FrameFault("every frame comes twice"),
    "reorder": FrameFault("frames change places in pairs"),
    "delay": FrameFault("frames come late", "ms", 3.0, 0.0, 1000.0),
    "wrong_id": FrameFault("frames carry the id of a node that does not exist"),
    "foreign_ids": FrameFault("each frame is followed by a random one of a node that is not there"),
    "flood": FrameFault("a babbling device fills the bus", "frames/ms", 8, 1, _LARGEST_BURST),
}


class FrameFaults:
    """The faults that are active on one link; `seed` makes the random ones repeatable."""

    def __init__(self, link: Link, seed: int):
        self._link = link
        self._random = random.Random(seed)
        self._values: dict[str, float] = {}
        self._held: Frame | None = None
        self._held_ns = 0
        self._late: list[tuple[int, Frame]] = []
        self._flooded_ns = 0

    def start(self, name: str, value: float) -> None:
        """Start the fault `name`; value: its size, in the unit of `FRAME_FAULTS`."""
        self._values[name] = value
        self._flooded_ns = self._link.port.now_ns
        self._link.mangle(self)

    def stop(self, name: str) -> None:
        """End the fault `name`; after the last one, send the delayed frames."""
        self._values.pop(name, None)
        if self._values:
            self._link.mangle(self)
        else:
            self._link.mangle(None)
            self._release(all_of_them=True)

    def send(self, can_id: int, data: bytes) -> None:
        """Pass a frame of the device through the active faults to the bus."""
        frames = [(can_id, bytes(data))]
        for name, value in tuple(self._values.items()):
            change = _CHANGES.get(name)
            if change is not None:
                frames = [result for frame in frames for result in change(self, frame, value)]
        for frame in frames:
            self._link.port.send(*frame)

    def incoming(self, handler: Handler) -> Handler | None:
        """Return the handler behind the active faults, None if no frame reaches the device."""
        if not _DEAF.isdisjoint(self._values):
            return None
        share = self._values.get("drop_in", 0.0)
        if not share:
            return handler

        def sometimes(data: bytes, now_ns: int) -> None:
            if self._random.random() >= share:
                handler(data, now_ns)

        return sometimes

    def poll(self, now_ns: int) -> None:
        """Send frames whose delay is over, and the flood's frames since the last call."""
        if not self._values:
            return
        self._link.port.now_ns = now_ns
        self._release()
        rate = self._values.get("flood", 0.0)
        count = min(int(rate * (now_ns - self._flooded_ns) / _MS), _LARGEST_BURST)
        if count > 0:
            self._flooded_ns = now_ns
            for _ in range(count):
                self._link.port.send(_FLOOD_ID, _FLOOD_FRAME)

    def _release(self, all_of_them: bool = False) -> None:
        port = self._link.port
        late, self._late = self._late, []
        for due_ns, frame in late:
            if all_of_them or due_ns <= port.now_ns:
                port.send(*frame)
            else:
                self._late.append((due_ns, frame))
        if self._held and (all_of_them or port.now_ns - self._held_ns > _HOLD_NS):
            frame, self._held = self._held, None
            port.send(*frame)

    def _nothing(self, _frame: Frame, _value: float) -> list[Frame]:
        return []

    def _drop(self, frame: Frame, value: float) -> list[Frame]:
        return [] if self._random.random() < value else [frame]

    def _truncate(self, frame: Frame, value: float) -> list[Frame]:
        return [(frame[0], frame[1][: max(0, len(frame[1]) - int(value))])]

    def _lengthen(self, frame: Frame, value: float) -> list[Frame]:
        return [(frame[0], (frame[1] + _PADDING * int(value))[:_LONGEST])]

    def _garbage(self, frame: Frame, _value: float) -> list[Frame]:
        return [(frame[0], self._random.randbytes(len(frame[1])))]

    def _duplicate(self, frame: Frame, _value: float) -> list[Frame]:
        return [frame, frame]

    def _reorder(self, frame: Frame, _value: float) -> list[Frame]:
        if self._held is None:
            self._held, self._held_ns = frame, self._link.port.now_ns
            return []
        earlier, self._held = self._held, None
        return [frame, earlier]

    def _delay(self, frame: Frame, value: float) -> list[Frame]:
        self._late.append((self._link.port.now_ns + int(value * _MS), frame))
        return []

    def _wrong_id(self, frame: Frame, _value: float) -> list[Frame]:
        return [(frame[0] ^ _OTHER_NODE, frame[1])]

    def _foreign_ids(self, frame: Frame, _value: float) -> list[Frame]:
        return [frame, (frame[0] ^ _OTHER_NODE, self._random.randbytes(_LONGEST))]


_Change = Callable[[FrameFaults, Frame, float], "list[Frame]"]

_CHANGES: dict[str, _Change] = {
    "cable_out": FrameFaults._nothing,
    OFF_BUS: FrameFaults._nothing,
    "mute": FrameFaults._nothing,
    "drop": FrameFaults._drop,
    "truncate": FrameFaults._truncate,
    "lengthen": FrameFaults._lengthen,
    "garbage": FrameFaults._garbage,
    "duplicate": FrameFaults._duplicate,
    "reorder": FrameFaults._reorder,
    "delay": FrameFaults._delay,
    "wrong_id": FrameFaults._wrong_id,
    "foreign_ids": FrameFaults._foreign_ids,
}
