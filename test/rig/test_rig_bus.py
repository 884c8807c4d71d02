# SPDX-License-Identifier: Apache-2.0
"""Simulated buses: frames of all kinds between members, the rig's end, losses, separation."""

from __future__ import annotations

import itertools
import socket
import struct
import uuid
from collections import deque
from concurrent.futures import ThreadPoolExecutor

import can
import pytest

from screw_module_ros.can_io.bus import BusSettings, open_port, within
from screw_module_ros.devices.errors import BusError
from screw_module_ros.lockstep.clock import SimulatedClock
from screw_module_ros.lockstep.page import Page
from screw_module_ros.rig import rig_bus
from screw_module_ros.rig.rig_bus import WELCOME, RigBus, address
from screw_module_ros.rig.rig_hub import RigHub

FRAMES = [
    can.Message(arbitration_id=0x80, is_extended_id=False),
    can.Message(arbitration_id=0x7FF, data=b"12345678", is_extended_id=False),
    can.Message(arbitration_id=0x1ABCDEF0, data=b"\x01", is_extended_id=True),
    can.Message(arbitration_id=0x123, is_remote_frame=True, dlc=4, is_extended_id=False),
    can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False, dlc=8,
                data=bytes(8)),
]  # fmt: skip
SYNC = FRAMES[0]


@pytest.fixture
def channel() -> str:
    return f"bus_{uuid.uuid4().hex[:8]}"


@pytest.fixture
def hub(channel):
    made = RigHub(channel)
    yield made
    made.shutdown()


@pytest.fixture
def join(hub, channel):
    """Return `join(make=..., at=hub)`: a new member, while that hub is served."""
    made = []

    def opened(make=lambda: RigBus(channel), at=hub):
        with ThreadPoolExecutor(1) as pool:
            member = pool.submit(make)
            while not member.done():
                at.recv(0.01)
        made.append(member.result())
        return made[-1]

    yield opened
    for each in made:
        getattr(each, "bus", each).shutdown()


@pytest.fixture(params=["far far far", "near far far", "far near near", "near near near"])
def members(request, hub, join):
    """Three members, each in another process than the rig's (far) or in its own (near)."""
    return [join() if at == "far" else join(hub.join) for at in request.param.split()]


def frame(message: can.Message) -> tuple[int, bytes]:
    """What a loop gets of a plain frame."""
    return message.arbitration_id, bytes(message.data)


def same(one: can.Message, other: can.Message) -> bool:
    return one.equals(other, timestamp_delta=None, check_direction=False)


# -- frames --------------------------------------------------------------------------------------


@pytest.mark.parametrize("frame", FRAMES, ids=lambda frame: f"{frame.arbitration_id:x}")
def test_a_frame_reaches_the_rig_and_every_other_member(hub, members, frame):
    sender, one, other = members
    sender.send(frame)
    for bus in (hub, one, other):
        assert same(bus.recv(5.0), frame)
    assert sender.recv(0.0) is None, "nobody receives his own frames"
    hub.send(frame)
    for bus in (sender, one, other):
        assert same(bus.recv(5.0), frame)
    assert hub.recv(0.0) is None


def test_a_packet_is_a_frame_of_linux(hub, join, channel):
    """struct can_frame, as SocketCAN has it (linux/can.h)."""
    join()
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as raw:
        raw.connect(str(address(channel)))
        assert hub.recv(0.0) is None
        assert raw.recv(99) == WELCOME
        for frame, flags in zip(FRAMES, (0, 0, 1 << 31, 1 << 30, 1 << 29), strict=True):
            hub.send(frame)
            data = b"" if frame.is_remote_frame else bytes(frame.data)
            expected = struct.pack("=IB3x8s", frame.arbitration_id | flags, frame.dlc, data)
            assert raw.recv(99) == expected


def test_fd_frames_are_refused(hub, members):
    for bus in (hub, *members):
        with pytest.raises(can.CanOperationError, match="carries no CAN FD frames"):
            bus.send(can.Message(arbitration_id=1, is_fd=True, data=bytes(12)))


def test_nothing_there(hub, members):
    for bus in (hub, *members):
        assert bus.recv(0.0) is None
        assert bus.recv(0.001) is None


def test_members_are_served_in_turn(hub, join):
    one, other = join(), join()
    for bus, can_id in ((one, 1), (other, 2)):
        for _ in range(3):
            bus.send(can.Message(arbitration_id=can_id))
    order = [hub.recv(0.0).arbitration_id for _ in range(6)]
    assert sorted(order) == [1, 1, 1, 2, 2, 2]
    assert order[:2] != [order[0]] * 2


def test_any_tool_of_python_can_takes_part(hub, join, channel):
    """As `python -m can.viewer -i rig -c CHANNEL` opens it."""
    member = join(lambda: can.Bus(interface="rig", channel=channel, bitrate=500_000,
                                  can_filters=[{"can_id": 0x80, "can_mask": 0x7FF}]))  # fmt: skip
    assert isinstance(member, RigBus)
    hub.send(FRAMES[1])
    hub.send(SYNC)
    assert member.recv(5.0).arbitration_id == 0x80


# -- who does not do its part --------------------------------------------------------------------


def test_a_bus_without_a_rig(channel):
    with pytest.raises(can.CanInitializationError, match=f"no sim_rig serves .*{channel}.*start"):
        RigBus(channel)


def test_a_rig_that_is_not_active(hub, channel, monkeypatch):
    monkeypatch.setattr(rig_bus, "_WELCOME_S", 0.01)
    with pytest.raises(can.CanInitializationError, match="does not serve this bus at present"):
        RigBus(channel)


def test_what_a_killed_rig_left_is_no_rig_and_in_nobodys_way(channel):
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as killed:
        killed.bind(str(address(channel)))
    with pytest.raises(can.CanInitializationError, match="Connection refused"):
        RigBus(channel)
    hub = RigHub(channel)
    assert hub.recv(0.0) is None
    hub.shutdown()
    assert not address(channel).exists()


def test_a_member_joins_again_when_the_rig_is_back(hub, join, channel):
    """Its user is told of the error both ways, and goes on as with an adapter that is back."""
    member = join()
    member.send(SYNC)  # unread when the rig ends
    hub.shutdown()
    with pytest.raises(can.CanOperationError, match="sim_rig has ended"):
        member.send(SYNC)
    for told in ("sim_rig has ended", "no sim_rig serves", "no sim_rig serves"):
        with pytest.raises(can.CanOperationError, match=told):
            member.recv(1.0)
    with pytest.raises(can.CanOperationError, match="sim_rig has ended"):
        member.send(SYNC)
    again = RigHub(channel)
    assert member.recv(0.0) is None
    member.send(SYNC)
    assert same(again.recv(5.0), SYNC)
    again.send(FRAMES[1])
    assert same(member.recv(5.0), FRAMES[1])
    again.shutdown()


def test_a_port_names_the_bus_and_goes_on_when_the_rig_is_back(hub, join, channel):
    port = join(lambda: open_port(BusSettings(channel=channel)))
    assert port.name.startswith(f"rig {channel} in ROS domain ")
    hub.shutdown()
    with pytest.raises(BusError, match=f"cannot receive on rig {channel}.*sim_rig has ended"):
        port.pump()
    again = RigHub(channel)
    seen = []
    port.subscribe(0x7FF, lambda data, arrival: seen.append(bytes(data)))
    assert port.pump() == 0
    port.send_sync(0)
    assert same(again.recv(5.0), SYNC)
    again.send(FRAMES[1])
    assert port.pump() == 1 and seen == [b"12345678"]
    again.shutdown()


def test_an_adapter_that_was_unplugged_is_back_for_who_opens_it_anew(hub, join, channel):
    """As a USB adapter: the old socket of SocketCAN says for ever that the network is down."""
    port = join(lambda: open_port(BusSettings(channel=channel)))
    hub.plug(False)
    for use in (port.pump, port.pump, lambda: port.send_sync(0)):
        with pytest.raises(BusError, match="Network is down"):
            use()
    with pytest.raises(can.CanOperationError, match="acknowledge"):
        hub.send(SYNC)
    with pytest.raises(can.CanInitializationError, match="Network is down"):
        join()
    hub.plug(True)
    with pytest.raises(BusError, match="Network is down"):
        port.send_sync(0)
    join(lambda: port.restore() or port)
    port.send_sync(0)
    assert same(hub.recv(5.0), SYNC)


def test_a_member_that_does_not_read_holds_up_nobody(hub, join):
    stopped, reader = join(), join()
    sent = 0
    while not hub.lost:
        hub.send(SYNC)
        sent += 1
        assert same(reader.recv(5.0), SYNC)
    assert sum(1 for _ in iter(lambda: stopped.recv(0.0), None)) == sent - 1
    hub.send(FRAMES[1])
    assert same(stopped.recv(5.0), FRAMES[1])
    assert hub.lost == 1


def test_a_rig_that_does_not_read_holds_up_nobody(hub, join):
    member = join()
    with pytest.raises(can.CanOperationError, match="transmit buffer full"):
        deque(map(member.send, itertools.repeat(SYNC)))


def test_a_member_that_has_gone_holds_up_nobody(hub, join):
    gone, member = join(), join()
    gone.send(SYNC)
    gone.shutdown()
    hub.send(FRAMES[1])
    assert same(member.recv(5.0), FRAMES[1])
    assert same(hub.recv(5.0), SYNC), "what it sent before arrives"
    assert hub.recv(0.0) is None and hub.lost == 0


# -- apart from others ---------------------------------------------------------------------------


def test_robots_of_two_namespaces_and_domains_are_apart(channel, monkeypatch):
    names = [within(BusSettings(channel=channel), above).channel for above in ("", "/a", "/a/b")]
    assert names == [channel, f"a/{channel}", f"a/b/{channel}"]
    here = {address(name) for name in names}
    monkeypatch.setenv("ROS_DOMAIN_ID", "101")
    assert len(here | {address(name) for name in names}) == 6
    assert within(BusSettings("socketcan", "can0"), "/a").channel == "can0"


@pytest.mark.parametrize("name", ["", "a b", "../x", "a//b", "/a", "239.74.163.2", "x\0"])
def test_a_channel_is_a_name(name):
    with pytest.raises(ValueError, match="names such as encoder"):
        address(name)


# -- simulated time ------------------------------------------------------------------------------


@pytest.fixture
def clock():
    page = Page(f"test_{uuid.uuid4().hex}")
    yield SimulatedClock(page, "test")
    page.close()


def test_a_frame_holds_time_until_each_has_read_it(hub, join, clock):
    """Also while it is on its way through the rig."""
    sender, other = join(), join()
    at_hub, at_sender, at_other = (clock.arrivals(bus) for bus in (hub, sender, other))
    sender.send(SYNC)
    at_sender.sent()
    assert at_hub.expects() and at_other.expects() and not at_sender.expects()
    assert at_hub.receive(0) == frame(SYNC)
    assert not at_hub.expects() and at_other.expects()
    assert at_other.receive(0) == frame(SYNC)
    assert not at_other.expects()
    hub.send(SYNC)
    at_hub.sent()
    for arrivals in (at_sender, at_other):
        assert arrivals.expects()
        assert arrivals.receive(0) == frame(SYNC)
        assert not arrivals.expects()


def test_frames_of_a_tool_hold_no_time_and_hide_no_others(hub, join, clock):
    tool, driver = join(), join()
    at_hub, at_driver = clock.arrivals(hub), clock.arrivals(driver)
    tool.send(FRAMES[1])
    assert not at_hub.expects()
    assert at_hub.receive(0) == frame(FRAMES[1])
    hub.send(SYNC)
    at_hub.sent()
    assert at_driver.receive(0) == frame(FRAMES[1])
    assert at_driver.expects()
    assert at_driver.receive(0) == frame(SYNC)
    assert not at_driver.expects()
    assert same(tool.recv(5.0), SYNC)
