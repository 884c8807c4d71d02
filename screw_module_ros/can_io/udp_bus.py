# SPDX-License-Identifier: Apache-2.0
"""python-can's `udp_multicast` with less work per frame, the same datagrams on the wire.

A robot of five processes moves some ten frames a millisecond, each sent by one and read by another.
It leaves out what no receiver uses of a frame: the kernel's receive time (ports stamp with
CLOCK_MONOTONIC), a poll before each read, building the same map for each frame sent. Everything
unusual (extended, remote, error, FD frames, foreign datagrams) goes the way of the base class.
"""

from __future__ import annotations

import os
import select
import socket
import struct

import can
import msgpack
from can.interfaces.udp_multicast import UdpMulticastBus
from can.interfaces.udp_multicast.utils import pack_message, unpack_message

_LARGEST_DATAGRAM = 4096
_LAST_STANDARD_ID = 0x7FF
_LONGEST_DATA = 8
_DATA_KEY = b"\xa4data\xc4"  # msgpack: the key, then the mark of up to 255 bytes
_MOST_TEMPLATES = 256
_MARKS = tuple(struct.unpack(">d", b"\x7e" + byte * 7)[0] for byte in (b"\0", b"\xff"))
"""Time stamps that no clock shows: our own senders mark their frames with one each (see `echo`)."""


class LeanUdpBus(UdpMulticastBus):
    """`can.interface.udp_multicast`, leaner; see there for the arguments.

    members_bus: what both ends call it. members_frames: frames read so far that another process of
    this project sent; simulated time waits for these.
    """

    def __init__(self, channel: str, port: int = 43113, **kwargs):
        super().__init__(channel, port, **kwargs)
        # A duplicate descriptor reaches the socket without touching python-can's private fields.
        self._own_socket = socket.socket(fileno=os.dup(self.fileno()))
        self._waitable = [self._own_socket]
        self._destination = (channel, port)
        self._templates: dict[tuple, tuple[bytes, bytes]] = {}
        self.own_stamp = 0.0
        self.members_bus = f"{channel}:{port}"
        self.members_frames = 0

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame, None when there is none within `timeout` [s].

        Raises can.CanOperationError for a failing socket or a datagram that is no frame.
        """
        try:
            if timeout != 0.0 and not select.select(self._waitable, (), (), timeout)[0]:
                return None
            datagram = self._own_socket.recv(_LARGEST_DATAGRAM, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return None
        except (OSError, ValueError) as error:
            raise can.CanOperationError(f"cannot read from {self.channel_info}") from error
        return self._frame(datagram)

    def _frame(self, datagram: bytes) -> can.Message:
        try:
            fields = msgpack.unpackb(datagram)
            if not _is_plain(fields):
                return unpack_message(datagram, replace={"timestamp": 0.0}, check=True)
            stamp = fields["timestamp"]
            if _MARKS[0] <= stamp <= _MARKS[1] and stamp != self.own_stamp:
                self.members_frames += 1
            return can.Message(
                0.0,
                fields["arbitration_id"],
                False,
                channel=fields["channel"],
                dlc=fields["dlc"],
                data=fields["data"],
            )
        except Exception as error:  # whatever a stranger's datagram makes of the decoder
            raise can.CanOperationError("could not unpack received message") from error

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send `msg`; raises can.CanOperationError when the socket does not take it."""
        if msg.is_extended_id or msg.is_remote_frame or msg.is_error_frame or msg.is_fd:
            super().send(msg, timeout)
            return
        key = (msg.arbitration_id, msg.dlc, msg.timestamp, msg.channel)
        template = self._templates.get(key)
        if template is None:
            template = self._templates[key] = _template(msg)
            if len(self._templates) > _MOST_TEMPLATES:
                self._templates.clear()
        head, tail = template
        try:
            self._own_socket.sendto(head + msg.data + tail, self._destination)
        except OSError as error:
            raise can.CanOperationError("failed to send via socket") from error

    def shutdown(self) -> None:
        """Close the sockets."""
        super().shutdown()
        self._own_socket.close()


def _template(msg: can.Message) -> tuple[bytes, bytes]:
    """Return what stands before and after the data bytes in the datagram of `msg`."""
    datagram = pack_message(msg)
    begin = datagram.index(_DATA_KEY) + len(_DATA_KEY) + 1
    return datagram[:begin], datagram[begin + len(msg.data) :]


def _is_plain(fields: dict) -> bool:
    """Return whether this is a classical data frame with an 11-bit identifier, and whole."""
    if (
        fields["is_extended_id"]
        or fields["is_remote_frame"]
        or fields["is_error_frame"]
        or fields["is_fd"]
    ):
        return False
    data = fields["data"]
    return (
        type(data) is bytes
        and len(data) == fields["dlc"] <= _LONGEST_DATA
        and 0 <= fields["arbitration_id"] <= _LAST_STANDARD_ID
    )
