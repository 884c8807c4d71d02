# SPDX-License-Identifier: Apache-2.0
"""Frames of python-can's messages: identifier, flags, data."""

from __future__ import annotations

import can
import pytest

from screw_module_ros.can_io.frames import (
    ERROR,
    EXTENDED,
    FD,
    OWN,
    REMOTE,
    STANDARD_ID,
    frames_of,
    word_of,
)


@pytest.mark.parametrize(
    ("flags", "word"),
    [
        ({}, 0x123),
        ({"is_extended_id": True}, 0x123 | EXTENDED),
        ({"is_remote_frame": True}, 0x123 | REMOTE),
        ({"is_error_frame": True}, 0x123 | ERROR),
        ({"is_fd": True}, 0x123 | FD),
        ({"is_rx": False}, 0x123 | OWN),
    ],
)
def test_only_a_plain_frame_of_another_node_has_no_flag(flags, word):
    message = can.Message(**{"arbitration_id": 0x123, "is_extended_id": False, **flags})
    assert word_of(message) == word
    assert (word > STANDARD_ID) == bool(flags)


def test_a_bus_of_messages_sends_and_receives_frames():
    with can.Bus(interface="virtual", channel="frames") as near, \
            can.Bus(interface="virtual", channel="frames") as far:  # fmt: skip
        frames_of(near).send_frame(0x7FF, b"\x01\x02")
        assert frames_of(far).receive_frame(0.0) == (0x7FF, b"\x01\x02")
        assert frames_of(far).receive_frame(0.0) is None
