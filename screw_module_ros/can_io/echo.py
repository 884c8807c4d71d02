# SPDX-License-Identifier: Apache-2.0
"""Drops our own frames, which python-can's `udp_multicast` returns to their sender.

An echo costs as much to read as a device's answer and wakes the loop, and there are as many echoes
as answers. The receiver replaces the time stamp in a datagram by the kernel's, so the sender is
free to use that field, at a fixed place, as a mark: a socket filter drops datagrams with our mark.
If socket filters do not work, the channel field carries the mark and echoes are counted: for each
frame sent, the first one that returns is the echo. So a device's reply that copies our frame, mark
included, is still received. Drivers and the simulated rig share this file; it depends on no device.
"""

from __future__ import annotations

import ctypes
import os
import socket
import struct

import can
from can.interfaces.udp_multicast import UdpMulticastBus
from can.interfaces.udp_multicast.utils import pack_message

_SO_ATTACH_FILTER = 26
# Classic BPF: operation, jump if true, jump if false, operand.
_INSTRUCTION = struct.Struct("=HBBI")
_LOAD_WORD, _JUMP_IF_EQUAL, _RETURN = 0x20, 0x15, 0x06
_UDP_HEADER_BYTES = 8


class EchoFilter:
    """Marks the frames that one bus sends and recognises their echoes.

    in_kernel: the kernel drops the echoes, so `is_echo` is not needed.
    """

    def __init__(self, bus: can.BusABC):
        self.marks = isinstance(bus, UdpMulticastBus)
        self._stamp = own_stamp()
        self._tag = f"own {self._stamp!r}"
        self._due: dict[int, int] = {}
        bus.own_stamp = self._stamp
        self.in_kernel = drop_own_frames(bus, self._stamp)

    def mark(self, message: can.Message) -> None:
        """Mark a frame that is about to be sent."""
        message.timestamp = self._stamp
        if not self.in_kernel:
            message.channel = self._tag
            can_id = message.arbitration_id
            self._due[can_id] = self._due.get(can_id, 0) + 1

    def unmark(self, can_id: int) -> None:
        """Undo one `mark`: the frame was not sent."""
        if not self.in_kernel:
            self._due[can_id] -= 1

    def is_echo(self, message: can.Message) -> bool:
        """Return whether a received frame is the echo of one of our own."""
        if message.channel != self._tag:
            return False
        due = self._due.get(message.arbitration_id, 0)
        if due:
            self._due[message.arbitration_id] = due - 1
        return due > 0


def own_stamp() -> float:
    """Return a mark for the frames of one bus: a finite time stamp of about 1e298."""
    return struct.unpack(">d", b"\x7e" + os.urandom(7))[0]


def drop_own_frames(bus: can.BusABC, stamp: float) -> bool:
    """Make the kernel drop frames with `stamp` that `bus` receives; return whether it does.

    Returns False, without any effect, for other interfaces and if socket filters do not work.
    """
    if not isinstance(bus, UdpMulticastBus):
        return False
    return _works(stamp) and _attach(bus.fileno(), stamp)


def _works(stamp: float) -> bool:
    """Test the filter on a pair of sockets: some kernels accept a filter and ignore it."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver,
    ):
        try:
            receiver.bind(("127.0.0.1", 0))
            receiver.settimeout(0.1)
            if not _attach(receiver.fileno(), stamp):
                return False
            for mark, name in ((stamp, 1), (0.0, 2)):
                datagram = pack_message(can.Message(mark, name, is_extended_id=False))
                sender.sendto(datagram, receiver.getsockname())
            heard = receiver.recv(4096)
        except OSError:
            return False
    return heard == datagram


def _attach(descriptor: int, stamp: float) -> bool:
    """Make the kernel drop datagrams with `stamp`; return whether it accepts the filter."""
    wanted = struct.pack(">d", stamp)
    marked = pack_message(can.Message(stamp, 0, is_extended_id=False))
    at = _UDP_HEADER_BYTES + marked.find(wanted)
    high, low = struct.unpack(">II", wanted)
    program = b"".join(
        _INSTRUCTION.pack(*instruction)
        for instruction in (
            (_LOAD_WORD, 0, 0, at),
            (_JUMP_IF_EQUAL, 0, 3, high),
            (_LOAD_WORD, 0, 0, at + 4),
            (_JUMP_IF_EQUAL, 0, 1, low),
            (_RETURN, 0, 0, 0),
            (_RETURN, 0, 0, 0xFFFFFFFF),
        )
    )
    buffer = ctypes.create_string_buffer(program, len(program))
    argument = struct.pack("@HP", len(program) // _INSTRUCTION.size, ctypes.addressof(buffer))
    try:
        # A duplicate descriptor reaches the socket without touching python-can's private fields.
        with socket.socket(fileno=os.dup(descriptor)) as duplicate:
            duplicate.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, argument)
    except OSError:
        return False
    return True
