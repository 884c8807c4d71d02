# SPDX-License-Identifier: Apache-2.0
"""A simulated CAN bus: a UNIX socket of the rig (python-can interface `rig`).

The channel is the name of a bus such as `encoder`, for a robot in a namespace with it in front:
`left/encoder`. A packet is one `struct can_frame` of Linux. `rig_hub` is the rig's end.

    python -m can.viewer -i rig -c encoder
"""

from __future__ import annotations

import os
import re
import select
import socket
import stat
import struct
from pathlib import Path
from typing import Any

import can

from ..can_io.frames import Frame
from ..domain import domain_id
from .local_bus import AWAY, ENDED, FrameBus

WELCOME = b"\0"
"""The first packet to a new member: from now on it gets every frame."""
UNPLUGGED = b"\1"
"""The last packet to a member whose adapter is pulled: it is dead, also when that is back."""
_WELCOME_S = 1.0  # wall clock; a rig that holds simulated time looks for new members each 50 ms
# Identifier and flags, length, padding that carries whether simulated time waits for it, data.
FRAME = struct.Struct("=IBB2x8s")
PACKET_BYTES = FRAME.size + 1  # one more: longer packets are no frames
_CHANNEL = re.compile(r"(\w+/)*\w+", re.ASCII)


def address(channel: str) -> Path:
    """Return the socket of a bus: of this user, the process's ROS domain and the namespace.

    Raises ValueError for a channel that is no name, OSError when the folder is not ours alone.
    """
    if not _CHANNEL.fullmatch(channel):
        raise ValueError(f"{channel!r} is no bus of sim_rig, which have names such as encoder")
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    above = Path(runtime if os.path.isabs(runtime) else "/tmp")
    folder = above / f"screw_module_ros_{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    ours = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
    if not ours or found.st_mode & 0o077:
        raise PermissionError(f"{folder} is not a folder of yours alone (mode 0700): remove it")
    return folder / f"{domain_id()}.{channel.replace('/', '.')}"


class SimulatedBus(FrameBus):
    """What both ends of a simulated bus share.

    counted: simulated time waits for the frames that are sent here. frames_counted: number of
    frames read for which it does.
    """

    def __init__(self, channel: str, **kwargs: Any):
        self.counted = False
        self.frames_counted = 0
        super().__init__(channel, **kwargs)

    def send_frame(self, can_id: int, data: bytes) -> None:
        """Send a frame, which the rig passes on to all others; raises CanOperationError."""
        self._send_packet(FRAME.pack(can_id, len(data), self.counted, data))

    def receive_frame(self, timeout_s: float | None) -> Frame | None:
        """Return the next frame, None without one within `timeout_s` [s], and count it.

        None: wait without limit. Raises CanOperationError.
        """
        packet = self._next_packet(timeout_s)
        if packet is None:
            return None
        word, length, counted, data = FRAME.unpack(packet)
        self.frames_counted += counted
        return word, data[:length]

    def _send_packet(self, packet: bytes) -> None:
        raise NotImplementedError

    def _next_packet(self, timeout_s: float | None) -> bytes | None:
        raise NotImplementedError


class RigBus(SimulatedBus):
    """A member of a simulated bus; it joins again when the rig has ended and is back.

    One whose adapter was unplugged does not: like a socket of SocketCAN, it has to be opened anew.
    Nothing blocks: like an adapter, it refuses a frame when its buffer is full. Raises
    CanInitializationError when no rig serves the bus.
    """

    def __init__(self, channel: str, **kwargs: Any):
        self._link: socket.socket | None = None
        self._told = ENDED
        try:
            self._path = address(channel)
            link = self._join()
            if not select.select([link], (), (), _WELCOME_S)[0]:
                raise TimeoutError("sim_rig does not serve this bus at present: is it active?")
            self._read(link)
        except (OSError, ValueError) as error:
            self._leave()
            raise can.CanInitializationError(str(error)) from error
        super().__init__(channel, **kwargs)

    def _send_packet(self, packet: bytes) -> None:
        link = self._link
        if link is None:
            raise can.CanOperationError(self._told)
        try:
            link.send(packet, socket.MSG_DONTWAIT)
        except BlockingIOError:
            raise can.CanOperationError("transmit buffer full: sim_rig reads nothing") from None
        except OSError:
            raise can.CanOperationError(ENDED) from None

    def _next_packet(self, timeout_s: float | None) -> bytes | None:
        try:
            link = self._link or self._join()
            if timeout_s != 0.0:
                select.select([link], (), (), timeout_s)
            while (packet := self._read(link)) == WELCOME:  # it has joined again
                pass
        except BlockingIOError:
            return None
        except OSError as error:
            raise can.CanOperationError(str(error)) from None
        return packet

    def _read(self, link: socket.socket) -> bytes:
        """Return the packet that waits. Raises BlockingIOError without one, OSError."""
        try:
            packet = link.recv(PACKET_BYTES, socket.MSG_DONTWAIT)
        except ConnectionError:
            packet = b""
        if packet == UNPLUGGED:
            self._told, packet = AWAY, b""
        if not packet:
            self._leave()
            raise ConnectionResetError(self._told)
        return packet

    def _join(self) -> socket.socket:
        if self._told == AWAY:
            raise ConnectionResetError(AWAY)
        link = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            link.setblocking(False)
            link.connect(str(self._path))
        except OSError as error:
            link.close()
            raise ConnectionRefusedError(
                f"no sim_rig serves {self._path} ({error.strerror or error}): start it in this ROS "
                "domain and namespace"
            ) from error
        self._link = link
        return link

    def _leave(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def shutdown(self) -> None:
        """Leave the bus."""
        super().shutdown()
        self._leave()
