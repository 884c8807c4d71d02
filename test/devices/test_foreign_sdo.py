# SPDX-License-Identifier: Apache-2.0
"""A second SDO client on a device: it may alter what the driver told it, guards and scale too."""

from __future__ import annotations

import pytest
from running_drivers import watched_drive, watched_tick
from scripted import ScriptedNode, unsigned

from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.encoder import Encoder
from screw_module_ros.devices.encoder_setup import EncoderSettings
from screw_module_ros.devices.errors import NotAnswering, NotNow, Occupied
from screw_module_ros.devices.sdo import Sdo

DRIVE = DriveSettings(listen=0.0, sdo_timeout=0.02, max_torque=1.6)
ENCODER = EncoderSettings(listen=0.0, sdo_timeout=0.02)
LIMIT = bytes.fromhex("2B 72 60 00 10 27 00 00")  # 6072 = 10000 per mille
TURNED = bytes.fromhex("2B 00 60 00 05 00 00 00")  # 6000: counts the other way round


def intrude(wire, device, data):
    """A request of somebody else's: the device hears it, and we do."""
    device.handle(0x600 + device.node_id, data)
    wire.emit(0x600 + device.node_id, data)
    wire.port.pump()


@pytest.fixture
def drive(wire, drive_end):
    return watched_drive(wire, DRIVE)


@pytest.fixture
def encoder(wire, encoder_end):
    made = Encoder(wire.port, ENCODER)
    made.configure()
    made.start()
    sample(wire, made)
    made.home()
    return made


def sample(wire, encoder):
    now_ns = wire.advance()
    encoder.request(1, now_ns, now_ns)
    wire.port.pump()
    return encoder.reading()


@pytest.mark.parametrize("was_enabled", [False, True])
def test_the_drive_stops_and_is_configured_anew_on_request(wire, drive, drive_end, was_enabled):
    limit = drive_end.objects[0x6072, 0]
    if was_enabled:
        drive.request_enable()
        for _ in range(3):
            watched_tick(wire, drive, 0.1)
    wire.frames.clear()
    intrude(wire, drive_end, LIMIT)
    assert drive_end.objects[0x6072, 0] == b"\x10\x27"
    assert watched_tick(wire, drive, 0.1) == 0.0
    assert "another SDO client (frames 0x601 on" in drive.fault
    assert wire.sent(0x000)[0] == b"\x02\x01", "NMT stop: it serves no SDO any more"
    with pytest.raises(NotNow, match="SDO client"):
        drive.request_enable()
    assert drive.counters["foreign_sdo"] == 1
    drive.clear_fault()
    assert drive_end.objects[0x6072, 0] == limit
    for _ in range(200):
        watched_tick(wire, drive)
    assert drive.fault == "" and not drive.recovering
    drive.request_enable()


def test_a_drive_left_in_fault_recovers_in_the_same_act(wire, drive, drive_end):
    intrude(wire, drive_end, LIMIT)
    watched_tick(wire, drive)
    drive_end.state = "fault"  # of the lost connection, 6007 = 1
    drive.clear_fault()
    for _ in range(200):
        watched_tick(wire, drive)
    assert (drive.fault, drive_end.state) == ("", "switched on")


def test_while_the_intruder_goes_on_the_drive_is_not_configured(wire, drive, drive_end):
    intrude(wire, drive_end, LIMIT)
    watched_tick(wire, drive)
    drive_end.written = lambda key, data: wire.emit(0x601, LIMIT)
    with pytest.raises(Occupied, match=r"another SDO client .*stop it"):
        drive.clear_fault()
    drive_end.written = lambda key, data: None
    wire.port.pump()
    assert "SDO client" in drive.fault
    with pytest.raises(NotNow):
        drive.request_enable()
    drive.clear_fault()
    for _ in range(200):
        watched_tick(wire, drive)
    assert drive.fault == ""


def test_the_encoder_delivers_nothing_and_is_not_homed(wire, encoder, encoder_end):
    intrude(wire, encoder_end, TURNED)
    assert sample(wire, encoder) is None
    assert not encoder.homed
    assert "another SDO client (frames 0x602 on" in encoder.fault
    with pytest.raises(NotNow, match="SDO client"):
        encoder.home()
    encoder.clear_fault()
    assert encoder_end.objects[0x6000, 0] == b"\x04\0"
    assert sample(wire, encoder) is not None
    assert encoder.counters["foreign_sdo"] == 1


def test_our_own_requests_and_late_answers_are_nobody_else_s(wire):
    node = wire.attach(ScriptedNode(wire, 5, {(0x1018, 4): unsigned(7, 4)}))
    foreign = []
    sdo = Sdo(wire.port, 5, "test device", 0.02, lambda: foreign.append(True))
    node.mute = True
    with pytest.raises(NotAnswering):
        sdo.read(0x1018, 4)
    late = bytes.fromhex("43 18 10 04 07 00 00 00")
    for _ in range(2):
        wire.emit(0x585, late)
    wire.port.pump()
    node.mute = False
    assert sdo.unsigned(0x1018, 4) == 7
    wire.emit(0x585, late)
    wire.port.pump()
    assert foreign == []
