# SPDX-License-Identifier: Apache-2.0
"""One bus of the rig, and the cable of each device on it.

A `RigPort` reads frames and passes each to the devices that listen to its id: one dictionary lookup
per frame. A `Link` is a device's own cable and carries its frame faults, so that they affect only
this device of a shared bus. A link without faults costs one attribute test per frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

import can

from screw_module_ros.clock import Clock

Handler = Callable[[bytes, int], None]
"""Handler of a frame: called with the payload and the present time [ns]."""


class Mangler(Protocol):
    """Changes the frames of one link; see `frame_faults`."""

    def send(self, can_id: int, data: bytes) -> None:
        """Pass a frame of the device through the active faults to the bus."""

    def incoming(self, handler: Handler) -> Handler | None:
        """Return the handler behind the active faults, None if no frame reaches the device."""


class Link:
    """The cable between one device and its port."""

    def __init__(self, port: RigPort):
        self.port = port
        self.mangler: Mangler | None = None
        self.handlers: dict[int, Handler] = {}
        port.links.append(self)

    def listen(self, handlers: dict[int, Handler]) -> None:
        """Replace the device's handlers: frame id -> handler."""
        self.handlers = handlers
        self.port.rebuild()

    def send(self, can_id: int, data: bytes) -> None:
        """Send a frame of the device, through the faults of its cable if there are any."""
        if self.mangler is None:
            self.port.send(can_id, data)
        else:
            self.mangler.send(can_id, data)

    def mangle(self, mangler: Mangler | None) -> None:
        """Set the faults of the cable; None removes them."""
        self.mangler = mangler
        self.port.rebuild()

    def received(self) -> dict[int, Handler]:
        """Return the handlers behind the faults of the cable."""
        if self.mangler is None:
            return self.handlers
        wrapped = {can_id: self.mangler.incoming(h) for can_id, h in self.handlers.items()}
        return {can_id: handler for can_id, handler in wrapped.items() if handler is not None}


class RigPort:
    """One bus: frames in by id, frames out, counters.

    bus: any python-can bus; the caller closes it. clock: that of the other ends of the bus.
    around: frame id -> handlers called before and after every device's own.
    """

    def __init__(self, bus: can.BusABC, clock: Clock):
        self.bus = bus
        self._arrivals = clock.arrivals(bus)
        self.links: list[Link] = []
        self.around: dict[int, tuple[Handler | None, Handler | None]] = {}
        self.now_ns = 0
        self.frames_in = self.frames_out = self.ignored = 0
        self.receive_errors = self.send_errors = 0
        self._table: dict[int, tuple[Handler, ...]] = {}
        self._messages: dict[int, can.Message] = {}

    def plug(self) -> Link:
        """Return the cable of a further device."""
        return Link(self)

    def fileno(self) -> int | None:
        """Return the file descriptor to select on, None if the interface has none."""
        try:
            number = self.bus.fileno()
        except NotImplementedError:
            return None
        return number if number >= 0 else None

    def rebuild(self) -> None:
        """Recompute which handlers a frame id goes to."""
        tables = [link.received() for link in self.links]
        table: dict[int, tuple[Handler, ...]] = {}
        for can_id in set(self.around).union(*tables):
            before, after = self.around.get(can_id, (None, None))
            devices = [handlers[can_id] for handlers in tables if can_id in handlers]
            table[can_id] = _present((before, *devices, after))
        self._table = table

    @property
    def lost(self) -> int:
        """Frames that members of the bus have lost because they did not read."""
        return getattr(self.bus, "lost", 0)

    def expects(self) -> bool:
        """Return whether a frame may be waiting; lock step does not foresee frames of foreign
        processes.
        """
        return self._arrivals.expects()

    def receive(self, now_ns: int) -> bool:
        """Handle the next waiting frame without blocking; return whether there was one."""
        self.now_ns = now_ns
        try:
            message = self._arrivals.receive(0)
        except (can.CanError, OSError, ValueError):
            self.receive_errors += 1
            return False
        if message is None:
            return False
        self.frames_in += 1
        handlers = self._table.get(message.arbitration_id)
        if handlers is None or _unsupported(message):
            self.ignored += 1
            return True
        data = bytes(message.data)
        for handler in handlers:
            handler(data, now_ns)
        return True

    def send(self, can_id: int, data: bytes) -> None:
        """Send one frame now; a bus that refuses it is counted, as on a real device."""
        message = self._messages.get(can_id)
        if message is None:
            message = can.Message(arbitration_id=can_id, is_extended_id=False)
            self._messages[can_id] = message
        message.data = bytearray(data)
        message.dlc = len(data)
        try:
            self.bus.send(message)
        except (can.CanError, OSError):
            self.send_errors += 1
        else:
            self._arrivals.sent()
            self.frames_out += 1


def _present(handlers: Iterable[Handler | None]) -> tuple[Handler, ...]:
    return tuple(handler for handler in handlers if handler is not None)


def _unsupported(message: can.Message) -> bool:
    """Return whether no simulated device answers this kind of frame."""
    return (
        message.is_extended_id or message.is_remote_frame or message.is_error_frame or message.is_fd
    )
