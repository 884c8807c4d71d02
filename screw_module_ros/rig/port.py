# SPDX-License-Identifier: Apache-2.0
"""One bus of the rig, and the cable of each device on it.

A `RigPort` reads frames and hands each to the devices that listen to its id: one dictionary lookup
a frame. A `Link` is a device's own cable: frame faults sit there, so that one device of a shared
bus can go wrong alone. A healthy link costs one attribute test a frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

import can
from can.interfaces.udp_multicast import UdpMulticastBus

from screw_module_ros.can_io.echo import drop_own_frames, own_stamp
from screw_module_ros.clock import Clock

Handler = Callable[[bytes, int], None]
"""Takes the payload of a frame and the time it is handled at [ns]."""


class Mangler(Protocol):
    """What may happen to the frames of one link; see `frame_faults`."""

    def send(self, can_id: int, data: bytes) -> None:
        """Take a frame of the device and put on the bus what becomes of it."""

    def incoming(self, handler: Handler) -> Handler | None:
        """Return what reaches the device in place of `handler`, None for nothing at all."""


class Link:
    """The cable between one device and its port."""

    def __init__(self, port: RigPort):
        self.port = port
        self.mangler: Mangler | None = None
        self.handlers: dict[int, Handler] = {}
        port.links.append(self)

    def listen(self, handlers: dict[int, Handler]) -> None:
        """Replace what the device listens to: frame id -> handler."""
        self.handlers = handlers
        self.port.rebuild()

    def send(self, can_id: int, data: bytes) -> None:
        """Send a frame of the device, through the faults of its cable when there are any."""
        if self.mangler is None:
            self.port.send(can_id, data)
        else:
            self.mangler.send(can_id, data)

    def mangle(self, mangler: Mangler | None) -> None:
        """Put faults on the cable, or take them off with None."""
        self.mangler = mangler
        self.port.rebuild()

    def received(self) -> dict[int, Handler]:
        """Return the handlers that the faults of the cable leave."""
        if self.mangler is None:
            return self.handlers
        wrapped = {can_id: self.mangler.incoming(h) for can_id, h in self.handlers.items()}
        return {can_id: handler for can_id, handler in wrapped.items() if handler is not None}


class RigPort:
    """One bus: frames in by id, frames out, counters.

    bus: any python-can bus; it stays the caller's, and is not closed here. clock: what the other
    ends of the bus wait by.
    around: frame id -> handlers called before and after every device's own.
    """

    def __init__(self, bus: can.BusABC, clock: Clock):
        self.bus = bus
        self._arrivals = clock.arrivals(bus)
        self.links: list[Link] = []
        self.around: dict[int, tuple[Handler | None, Handler | None]] = {}
        self.now_ns = 0
        self.frames_in = self.frames_out = self.ignored = self.own_echoes = 0
        self.receive_errors = self.send_errors = 0
        self._stamp = bus.own_stamp = own_stamp()
        self._tag: str | None = None
        if isinstance(bus, UdpMulticastBus) and not drop_own_frames(bus, self._stamp):
            self._tag = f"rig {self._stamp!r}"
        self._table: dict[int, tuple[Handler, ...]] = {}
        self._messages: dict[int, can.Message] = {}

    def plug(self) -> Link:
        """Return a cable for one more device."""
        return Link(self)

    def fileno(self) -> int | None:
        """Return the descriptor to select on, None where the interface has none."""
        try:
            number = self.bus.fileno()
        except NotImplementedError:
            return None
        return number if number >= 0 else None

    def rebuild(self) -> None:
        """Recompute which handlers a frame id goes to."""
        heard = [link.received() for link in self.links]
        table: dict[int, tuple[Handler, ...]] = {}
        for can_id in set(self.around).union(*heard):
            before, after = self.around.get(can_id, (None, None))
            devices = [handlers[can_id] for handlers in heard if can_id in handlers]
            table[can_id] = _present((before, *devices, after))
        self._table = table

    def expects(self) -> bool:
        """Return whether a frame may be waiting; lock step does not foresee frames of foreign
        processes.
        """
        return self._arrivals.expects()

    def receive(self, now_ns: int) -> bool:
        """Handle the next waiting frame, if there is one; never blocks. True when there was."""
        self.now_ns = now_ns
        try:
            message = self._arrivals.receive(0)
        except (can.CanError, OSError, ValueError):
            self.receive_errors += 1
            return False
        if message is None:
            return False
        if self._tag is not None and message.channel == self._tag:
            self.own_echoes += 1
            return True
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
            message = can.Message(self._stamp, can_id, is_extended_id=False, channel=self._tag)
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
    """Return whether a frame is of a kind that no device here answers."""
    return (
        message.is_extended_id or message.is_remote_frame or message.is_error_frame or message.is_fd
    )
