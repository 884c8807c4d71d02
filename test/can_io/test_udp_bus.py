# SPDX-License-Identifier: Apache-2.0
"""The lean udp_multicast bus speaks to python-can's own, both ways, frame for frame."""

from __future__ import annotations

import socket

import can
import msgpack
import pytest
from can.interfaces.udp_multicast import UdpMulticastBus
from can.interfaces.udp_multicast.utils import pack_message

from screw_module_ros.can_io.echo import own_stamp
from screw_module_ros.can_io.udp_bus import LeanUdpBus

GROUP = "239.74.163.2"
FRAMES = [
    can.Message(arbitration_id=0x80, data=b"", is_extended_id=False),
    can.Message(arbitration_id=0x7FF, data=b"12345678", is_extended_id=False),
    can.Message(arbitration_id=0x201, data=b"\xa4data\xc4\x01", is_extended_id=False),
    can.Message(arbitration_id=0x1ABCDEF0, data=b"\x01", is_extended_id=True),
    can.Message(arbitration_id=0x123, is_remote_frame=True, dlc=4, is_extended_id=False),
    can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False),
]


@pytest.fixture
def pair(can_port_base):
    """Return a lean bus and one of python-can's on the same group."""
    arguments = {"channel": GROUP, "port": can_port_base, "hop_limit": 0, "fd": False}
    lean, plain = LeanUdpBus(**arguments), UdpMulticastBus(**arguments)
    yield lean, plain
    lean.shutdown()
    plain.shutdown()


def heard(bus: can.BusABC, sent: can.Message) -> can.Message:
    """Return the next frame on the bus that equals `sent`; own echoes come too."""
    message = bus.recv(5.0)
    assert message is not None
    assert message.equals(sent, timestamp_delta=None, check_direction=False)
    return message


@pytest.mark.parametrize("frame", FRAMES, ids=lambda frame: f"{frame.arbitration_id:x}")
def test_frames_cross_both_ways(pair, frame):
    """What one sends the other reads, every kind of classical frame."""
    lean, plain = pair
    lean.send(frame)
    heard(plain, frame)
    heard(lean, frame)
    plain.send(frame)
    heard(lean, frame)


def test_the_same_datagram(pair):
    """Byte for byte what python-can packs, for data of every length and changing content."""
    lean, _ = pair
    sent = []
    lean._own_socket = type("Tap", (), {"sendto": lambda self, data, to: sent.append(data),
                                        "close": lambda self: None})()  # fmt: skip
    frames = [
        can.Message(arbitration_id=0x181, data=bytes([fill] * size), is_extended_id=False)
        for size in range(9)
        for fill in (0x00, 0xC4)
    ]
    for frame in frames:
        lean.send(frame)
    assert sent == [pack_message(frame) for frame in frames]


def test_what_is_known_of_a_sender_changes_nothing(pair):
    """Frames of several senders and identifiers, each again and again with other data."""
    lean, _ = pair
    lean.own_stamp = own_stamp()
    stamps = [own_stamp(), own_stamp(), lean.own_stamp, 0.0, 12.5]
    counted = 0
    for number in range(300):
        stamp = stamps[number % len(stamps)]
        sent = can.Message(
            timestamp=stamp,
            arbitration_id=(0x80, 0x181, 0x7FF)[number % 3],
            is_extended_id=False,
            channel=(None, "rig")[number % 2],
            data=(b"\xa4data\xc4\x01", bytes([number & 0xFF] * (number % 9)))[number % 7 > 0],
        )
        counted += stamp in stamps[:2]
        found = lean._frame(pack_message(sent))
        assert found.equals(sent, timestamp_delta=None, check_direction=False, check_channel=True)
        assert lean.members_frames == counted


def test_strangers_do_not_fill_the_memory(pair):
    """Whoever sends a new time stamp with each frame, as python-can does."""
    lean, _ = pair
    for number in range(1000):
        lean._frame(pack_message(can.Message(float(number), 0x181, False, data=b"12")))
    assert len(lean._known) <= 256


def test_nothing_there(pair):
    """No frame, no wait: None."""
    assert pair[0].recv(0.0) is None
    assert pair[0].recv(0.001) is None


@pytest.mark.parametrize(
    "datagram",
    [
        b"",
        b"nonsense",
        msgpack.packb({"arbitration_id": 1}),
        pack_message(FRAMES[1]).replace(b"12345678", b"1234567"),
        msgpack.packb({**msgpack.unpackb(pack_message(FRAMES[1])), "dlc": 3}),
        msgpack.packb({**msgpack.unpackb(pack_message(FRAMES[1])), "arbitration_id": 0x800}),
        msgpack.packb({**msgpack.unpackb(pack_message(FRAMES[1])), "data": "12345678"}),
    ],
)
def test_a_stranger_s_datagram_is_an_error_not_a_frame(pair, can_port_base, datagram):
    """Whatever arrives that is no frame raises python-can's error; the next frame is read."""
    lean, plain = pair
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        stranger.sendto(datagram, (GROUP, can_port_base))
    with pytest.raises(can.CanOperationError):
        lean.recv(5.0)
    plain.send(FRAMES[0])
    heard(lean, FRAMES[0])
