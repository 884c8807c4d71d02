# SPDX-License-Identifier: Apache-2.0
"""python-can's `udp_multicast`, by wall clock: a driver and a device of others meet on it."""

from __future__ import annotations

import socket
import threading

import can
import pytest
from can.interfaces.udp_multicast import UdpMulticastBus

from screw_module_ros.can_io.bus import BusSettings, open_bus, open_port
from screw_module_ros.devices.encoder import Encoder, EncoderSettings
from screw_module_ros.devices.errors import BusError
from screw_module_ros.plant.world import World, load_world
from screw_module_ros.rig.rig import Rig

GROUP = "239.74.163.2"


def pumped(port) -> int:
    """Wait 10 ms for frames; return how many came."""
    return port.pump(port.clock.now_ns() + 10_000_000)


@pytest.fixture
def settings():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return BusSettings("udp_multicast", GROUP, probe.getsockname()[1])


@pytest.fixture
def port(settings):
    try:
        opened = open_port(settings)
    except BusError as error:
        pytest.skip(f"no interface of this machine carries multicast: {error}")
    yield opened
    opened.close()


@pytest.fixture
def far(settings, port):
    """The bus of somebody else, python-can's own."""
    bus = UdpMulticastBus(channel=GROUP, port=settings.port, hop_limit=0, fd=False)
    yield bus
    bus.shutdown()


def test_a_driver_works_over_it(settings, port):
    bus = open_bus(settings)
    rig = Rig({"encoder": bus}, World(load_world(None)))
    over = threading.Event()
    thread = threading.Thread(target=rig.run, args=(over.is_set,))
    thread.start()
    try:
        encoder = Encoder(port, EncoderSettings(listen=0.0, sdo_timeout=10.0))
        encoder.configure()
        encoder.start()
        readings = []
        for tick in range(1, 200):
            now_ns = port.clock.now_ns()
            encoder.request(tick, now_ns, 0)
            pumped(port)
            if (reading := encoder.reading()) is not None:
                readings.append(reading)
            if len(readings) == 3:
                break
        assert len(readings) == 3
        assert port.counters["foreign_sync"] == 0 and not encoder.fault
    finally:
        over.set()
        thread.join(5.0)
        rig.close()
        bus.shutdown()


def test_frames_stay_on_the_machine(port):
    with socket.socket(fileno=socket.dup(port.bus.fileno())) as duplicate:
        assert duplicate.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0


def test_own_frames_are_not_received(port, far, wait_until):
    seen = []
    port.subscribe(0x120, lambda data, arrival: seen.append(bytes(data)))
    port.send(0x120, b"")
    assert far.recv(1.0).arbitration_id == 0x120
    far.send(can.Message(arbitration_id=0x120, data=b"reply", is_extended_id=False))
    wait_until(lambda: pumped(port) and seen, what="the reply")
    assert seen == [b"reply"]


def test_a_reply_that_equals_its_request_is_received(port, far, wait_until):
    """Even when the device returns the very frame it got."""
    seen = []
    port.subscribe(0x126, lambda data, arrival: seen.append(bytes(data)))
    port.send(0x126, b"\x03")
    far.send(far.recv(1.0))
    wait_until(lambda: pumped(port) and seen, what="the reply")
    assert seen == [b"\x03"]


def test_a_foreign_sync_is_told_from_our_own(port, far, wait_until):
    port.send_sync(0)
    far.send(can.Message(arbitration_id=0x080, is_extended_id=False))
    wait_until(lambda: pumped(port) and port.counters["foreign_sync"], what="the foreign SYNC")
    assert port.counters["foreign_sync"] == 1
