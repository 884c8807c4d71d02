# SPDX-License-Identifier: Apache-2.0
"""Keeps a sender from hearing itself on python-can's `udp_multicast`.

Multicast hands a process its own datagrams back: each costs as much to read as one of somebody
else's, and there are as many. A receiver replaces the time stamp that a datagram carries by the
kernel's, so the sender's stamp is free to say whose frame it is, and it lies at a fixed offset: a
socket filter of six instructions drops our own frames in the kernel. Where there is no such filter
(it is Linux's), the frames come back and have to be told apart by whoever reads them.
"""

from __future__ import annotations

import ctypes
import os
import socket
import struct

import can
from can.interfaces.udp_multicast import UdpMulticastBus

_SO_ATTACH_FILTER = 26
_LOAD_WORD, _JUMP_IF_EQUAL, _RETURN = 0x20, 0x15, 0x06
_INSTRUCTION = struct.Struct("=HBBI")
_WHOLE_DATAGRAM = 0xFFFFFFFF
_STAMP_AT = 8 + 12
"""After the UDP header and, in the msgpack map, its head, the key "timestamp" and the type byte."""
_EXPONENT_OF_NO_DATE = 0x7E << 56
"""Makes the stamp a finite number about 1e298: no clock shows that."""


def own_stamp() -> float:
    """Return a time stamp that no other process uses, for the frames of one bus."""
    bits = _EXPONENT_OF_NO_DATE | int.from_bytes(os.urandom(7), "big")
    return struct.unpack(">d", bits.to_bytes(8, "big"))[0]


def drop_own_frames(bus: can.BusABC, stamp: float) -> bool:
    """Let the kernel drop what `bus` receives with `stamp` on it; return whether it will.

    False, without any effect, for other interfaces and where the system has no socket filters.
    """
    if not isinstance(bus, UdpMulticastBus):
        return False
    high, low = struct.unpack(">II", struct.pack(">d", stamp))
    program = b"".join(
        _INSTRUCTION.pack(*instruction)
        for instruction in (
            (_LOAD_WORD, 0, 0, _STAMP_AT),
            (_JUMP_IF_EQUAL, 0, 3, high),
            (_LOAD_WORD, 0, 0, _STAMP_AT + 4),
            (_JUMP_IF_EQUAL, 0, 1, low),
            (_RETURN, 0, 0, 0),
            (_RETURN, 0, 0, _WHOLE_DATAGRAM),
        )
    )
    buffer = ctypes.create_string_buffer(program, len(program))
    count = len(program) // _INSTRUCTION.size
    argument = struct.pack("@HP", count, ctypes.addressof(buffer))
    try:
        # A duplicate descriptor reaches the socket without touching python-can's private fields.
        with socket.socket(fileno=os.dup(bus.fileno())) as duplicate:
            duplicate.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, argument)
    except OSError:
        return False
    return True
