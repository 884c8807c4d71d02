# SPDX-License-Identifier: Apache-2.0
"""The rig's end of a simulated CAN bus: passes each frame on to the other members."""

from __future__ import annotations

import select
import socket
from contextlib import suppress

from ..can_io.frames import Frame
from .local_bus import LocalHub
from .rig_bus import FRAME, PACKET_BYTES, UNPLUGGED, WELCOME, SimulatedBus, address

_SEND_BUFFER_BYTES = 4 * 1024 * 1024


class RigHub(LocalHub, SimulatedBus):
    """A simulated bus with members in other processes, and in this one by `join`.

    It waits for no member: one that does not read loses frames, as with an adapter whose buffer is
    full, and `lost` counts them. The caller makes sure that one process serves a bus: a socket of
    that name is what a killed rig left. Raises OSError, ValueError.
    """

    def __init__(self, channel: str):
        self.lost = 0
        self.far: dict[int, socket.socket] = {}
        self._path = address(channel)
        self._path.unlink(missing_ok=True)
        self._door = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._door.setblocking(False)
        self._door.bind(str(self._path))
        self._door.listen()
        self._ready = select.epoll()
        self._ready.register(self._door, select.EPOLLIN)
        super().__init__(channel)

    def plug(self, plugged: bool) -> None:
        """Unplug the adapter of all members, who are dead from then on, or plug it in again."""
        super().plug(plugged)
        for number, member in () if plugged else list(self.far.items()):
            with suppress(OSError):
                member.send(UNPLUGGED, socket.MSG_DONTWAIT)
            self.far.pop(number).close()

    def _send_far(self, can_id: int, data: bytes) -> None:
        self._send_to_all(FRAME.pack(can_id, len(data), self.counted, data), 0)

    def receive_frame(self, timeout_s: float | None) -> Frame | None:
        """Return the next frame of a member, None without one within `timeout_s` [s]."""
        return super().receive_frame(timeout_s) or SimulatedBus.receive_frame(self, timeout_s)

    def _next_packet(self, timeout_s: float | None) -> bytes | None:
        while ready := self._ready.poll(timeout_s, 1):
            number = ready[0][0]
            if number == self._door.fileno():
                self._admit()
            elif packet := self._read(number):
                self._send_to_all(packet, number)
                if self.near:
                    word, length, _, data = FRAME.unpack(packet)
                    self.pass_on(None, word, data[:length])
                return packet
            timeout_s = 0.0
        return None

    def _admit(self) -> None:
        with suppress(OSError):  # it has gone again
            member = self._door.accept()[0]
            if not self.plugged:
                member.send(UNPLUGGED, socket.MSG_DONTWAIT)
                member.close()
                return
            # The kernel takes as much as it permits: some 550 frames by default.
            member.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
            self.far[member.fileno()] = member
            self._ready.register(member, select.EPOLLIN)
            member.send(WELCOME, socket.MSG_DONTWAIT)

    def _read(self, number: int) -> bytes:
        """Return a member's next packet; empty if it has left, or was sent away for nonsense."""
        packet = b""
        with suppress(ConnectionError):
            packet = self.far[number].recv(PACKET_BYTES, socket.MSG_DONTWAIT)
        if len(packet) == PACKET_BYTES - 1:
            return packet
        self.far.pop(number).close()
        return b""

    def _send_to_all(self, packet: bytes, sender: int) -> None:
        for number, member in self.far.items():
            if number != sender:
                try:
                    member.send(packet, socket.MSG_DONTWAIT)
                except BlockingIOError:
                    self.lost += 1
                except OSError:
                    continue  # it has left: its end is read next

    def fileno(self) -> int:
        """Return a file descriptor that is readable when a frame or a new member waits."""
        return self._ready.fileno()

    def shutdown(self) -> None:
        """Close the bus for all members."""
        super().shutdown()
        for member in self.far.values():
            member.close()
        self._ready.close()
        self._door.close()
        self._path.unlink(missing_ok=True)
