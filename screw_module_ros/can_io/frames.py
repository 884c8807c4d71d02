# SPDX-License-Identifier: Apache-2.0
"""Frames as loops and simulated devices exchange them: one word and the data, no objects.

The word is the identifier, with the bits EXTENDED, REMOTE and ERROR of Linux's `can_id`, and above
them FD, and OWN for a frame that this computer has sent. So a plain frame of another node is a word
up to STANDARD_ID.
"""

from __future__ import annotations

from typing import Any

import can

STANDARD_ID, EXTENDED_ID = 0x7FF, 0x1FFF_FFFF
EXTENDED, REMOTE, ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
FD, OWN = 1 << 32, 1 << 33

Frame = tuple[int, bytes]


class Messages:
    """The frames of a bus of python-can that has only messages."""

    def __init__(self, bus: can.BusABC):
        self._bus = bus

    def send_frame(self, can_id: int, data: bytes) -> None:
        """Send a plain frame; raises as python-can."""
        self._bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def receive_frame(self, timeout_s: float) -> Frame | None:
        """Return the next frame, None without one within `timeout_s` [s]; raises as python-can."""
        message = self._bus.recv(timeout_s)
        return None if message is None else (word_of(message), bytes(message.data))


def frames_of(bus: Any) -> Any:
    """Return what sends and receives the frames of an open bus: itself where it can."""
    return bus if hasattr(bus, "receive_frame") else Messages(bus)


def word_of(message: can.Message) -> int:
    """Return identifier and flags of a message."""
    return (
        message.arbitration_id
        | EXTENDED * message.is_extended_id
        | REMOTE * message.is_remote_frame
        | ERROR * message.is_error_frame
        | FD * message.is_fd
        | OWN * (not message.is_rx)
    )
