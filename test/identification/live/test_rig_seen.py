# SPDX-License-Identifier: Apache-2.0
"""Only a rig that was detected on its bus needs no confirmation of an operator."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import can
import pytest

from screw_module_ros.can_io.bus import BusSettings
from screw_module_ros.clock import WallClock
from screw_module_ros.identification.live import fixture
from screw_module_ros.identification.live.fixture import RigBusSettings, sees_rig

ROBOT = SimpleNamespace(
    clock=WallClock(), node=SimpleNamespace(get_namespace=lambda: "/")
)


@pytest.fixture
def bus(request, monkeypatch):
    """Return the bus in the parameters of the node `encoder`."""
    settings = BusSettings(interface="virtual", channel=request.node.name)
    told = {"can.interface": "virtual", "can.channel": settings.channel, "node_id": 2}
    monkeypatch.setattr(ROBOT, "parameters", lambda node, names: told, raising=False)
    return settings


@pytest.fixture
def talking(bus):
    """Send frames of an identifier until the test ends."""
    ends, threads = threading.Event(), []

    def talk(identifier: int) -> None:
        def send() -> None:
            with can.Bus(interface="virtual", channel=bus.channel) as sender:
                while not ends.wait(0.002):
                    sender.send(can.Message(arbitration_id=identifier, is_extended_id=False))

        threads.append(threading.Thread(target=send))
        threads[-1].start()

    yield talk
    ends.set()
    for thread in threads:
        thread.join()


def test_a_rig_that_answers_is_seen(bus, talking):
    talking(0x182)
    assert sees_rig(ROBOT, bus, RigBusSettings())


def test_a_silent_bus_shows_no_rig(bus):
    assert not sees_rig(ROBOT, bus, RigBusSettings())


def test_another_device_shows_no_rig(bus, talking):
    talking(0x183)
    assert not sees_rig(ROBOT, bus, RigBusSettings())


def test_an_encoder_on_another_bus_shows_no_rig(bus, talking):
    talking(0x182)
    assert not sees_rig(ROBOT, bus._replace(channel="another"), RigBusSettings())


@pytest.mark.parametrize("interface", ["socketcan", "udp_multicast"])
def test_hardware_is_no_rig(monkeypatch, interface):
    monkeypatch.setattr(fixture, "open_bus", None)  # nor is it listened to
    assert not sees_rig(ROBOT, BusSettings(interface=interface), RigBusSettings())


@pytest.mark.parametrize(
    ("pids", "sent", "seen"), [((7, 8), (5, 5), True), ((8, 8), (5, 5), False),
                               ((7, 8), (0, 5), False)]
)  # fmt: skip
def test_in_simulated_time_who_moves_it_must_have_answered(pids, sent, seen):
    page = SimpleNamespace(conductor=7, buses=lambda: list(zip(pids, sent, strict=True)))
    robot = SimpleNamespace(clock=SimpleNamespace(simulated=True, page=page))
    assert sees_rig(robot, BusSettings(), RigBusSettings()) is seen
