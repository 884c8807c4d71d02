# SPDX-License-Identifier: Apache-2.0
"""Started again: after an exit, after a pause, or with a restart of the device in the midst of it.

In each case the device may have lost what it was told: guards, limits, scale and home.
"""

from __future__ import annotations

import pytest
from running_drivers import tick, tick_both, two_drives, watched_drive, watched_tick

from screw_module_ros.devices import drive_group
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.encoder import Encoder
from screw_module_ros.devices.encoder_setup import EncoderSettings
from screw_module_ros.devices.errors import BusError, NotAnswering, NotConfigured, NotNow
from screw_module_ros.devices.force_sensor import ForceSensor
from screw_module_ros.devices.force_sensor_settings import ForceSensorSettings

DRIVE = DriveSettings(listen=0.0, sdo_timeout=0.02)
ENCODER = EncoderSettings(listen=0.0, sdo_timeout=0.02)
FORCE_SENSOR = ForceSensorSettings(listen=0.0, timeout=0.02, calibration=3)
SET_CALIBRATION = 0x126
ARMED = (b"\x14\x00", bytes.fromhex("64 00 70 00"))  # 1400:05 is 20 ms, 1016 is 112 and 100 ms
NMT_START = 0x01
READ_MODE = bytes.fromhex("40 61 60 00 00 00 00 00")  # a request that alters nothing


def guards(drive_end):
    return drive_end.objects[0x1400, 5], drive_end.objects[0x1016, 1]


@pytest.fixture
def drive(wire, drive_end):
    return watched_drive(wire, DRIVE)


def when_it_starts(wire, end, happens):
    """Let something happen at the next NMT start, read at once by the loop's thread."""
    handle = end.handle

    def start_seen(can_id, data):
        handle(can_id, data)
        if can_id == 0x000 and data[0] == NMT_START:
            end.handle = handle
            happens()
            wire.port.pump()

    end.handle = start_seen


# -- after an exit, after a pause ----------------------------------------------------------------


def test_after_the_exit_that_disarmed_its_guards_a_drive_does_not_start(wire, drive, drive_end):
    assert guards(drive_end) == ARMED
    assert drive_group.leave([drive], wire.port) == ""
    assert guards(drive_end) == (bytes(2), bytes(4))
    with pytest.raises(NotConfigured):
        drive.start()


def test_the_start_after_an_exit_arms_the_guards_again(wire, drive, drive_end):
    drive_group.leave([drive], wire.port)
    assert drive_group.start([drive]) == [drive]
    assert guards(drive_end) == ARMED
    for _ in range(5):
        watched_tick(wire, drive)
    drive.request_enable()
    for _ in range(3):
        watched_tick(wire, drive, 0.1)
    assert (drive_end.state, drive.fault) == ("operation enabled", "")


def test_a_fault_outlives_exit_and_start(wire, drive, drive_end):
    drive_end.fail()
    watched_tick(wire, drive)
    told = drive.fault
    assert "fault" in told
    drive_group.leave([drive], wire.port)
    drive_end.state = "switch on disabled"
    drive_group.start([drive])
    for _ in range(5):
        watched_tick(wire, drive)
    assert drive.fault == told
    with pytest.raises(NotNow, match="clear the fault first"):
        drive.request_enable()


def test_what_was_configured_just_now_is_not_configured_twice(wire, drive_end):
    drive = Drive(wire.port, DRIVE)
    drive.configure()
    drive_end.writes.clear()
    assert drive_group.start([drive]) == []
    assert drive_end.writes == []


def test_a_drive_that_nobody_watched_is_configured_anew(wire, drive_end):
    """Minutes between the lifecycle's configure and activate: its boot-up may be lost."""
    drive = Drive(wire.port, DRIVE)
    drive.configure()
    wire.advance(60_000)
    drive_end.objects[0x1400, 5] = bytes(2)
    assert drive_group.start([drive]) == [drive]
    assert guards(drive_end) == ARMED


def test_both_drives_of_a_bus_are_configured_before_either_starts(wire):
    ends, drives = two_drives(wire, DRIVE)
    drive_group.start(drives)
    for _ in range(5):
        tick_both(wire, drives)
    assert drive_group.leave(drives, wire.port) == ""
    wire.frames.clear()
    assert drive_group.start(drives) == drives
    commands = [data[0] for data in wire.sent(0x000)]
    assert commands == [0x80, 0x80, NMT_START, NMT_START]
    assert [end.objects[0x1400, 5] for end in ends] == [b"\x14\x00"] * 2


def test_an_encoder_that_was_left_has_no_home(wire, encoder_end):
    encoder = Encoder(wire.port, ENCODER)
    encoder.configure()
    encoder.start()
    encoder.request(1, wire.advance(), 0)
    wire.port.pump()
    encoder.home()
    encoder.stop()
    assert not encoder.configured
    with pytest.raises(NotConfigured):
        encoder.start()
    encoder.configure()
    encoder.start()
    assert encoder.configured and not encoder.homed


def test_an_encoder_that_somebody_stopped_has_a_way_back(wire, encoder_end):
    """By a foreign NMT command, or a restart that nobody heard: it is silent, without a fault."""
    encoder = Encoder(wire.port, ENCODER)
    encoder.configure()
    encoder.start()
    assert tick(wire, encoder) is not None
    encoder.home()
    encoder_end.operational = False
    for n in range(200):
        assert tick(wire, encoder, n) is None
    assert encoder.silent and encoder.fault == ""
    encoder_end.mute = True
    with pytest.raises(NotAnswering):
        encoder.clear_fault()
    assert encoder.fault == "the encoder does not answer"
    encoder_end.mute = False
    encoder.clear_fault()
    assert encoder.fault == "" and not encoder.silent
    sample = tick(wire, encoder, 300)
    assert sample is not None and not sample.homed


def test_a_force_sensor_that_was_left_gets_its_calibration_again(wire, sensor_end):
    """It may have restarted with its first one, and a status that nobody compares with another."""
    sensor = ForceSensor(wire.port, FORCE_SENSOR)
    sensor.configure()
    sensor.start()
    assert tick(wire, sensor) is not None
    sensor.stop()
    assert not sensor.configured
    with pytest.raises(NotConfigured):
        sensor.start()
    wire.frames.clear()
    sensor.configure()
    sensor.start()
    assert wire.sent(SET_CALIBRATION) == [b"\x03"]
    assert tick(wire, sensor) is not None


def test_a_force_sensor_that_nobody_watched_gets_its_calibration_again(wire, sensor_end):
    """Minutes between the lifecycle's configure and activate."""
    sensor = ForceSensor(wire.port, FORCE_SENSOR)
    sensor.configure()
    assert sensor.configured
    wire.advance(60_000)
    assert not sensor.configured


# -- a restart or another client in the midst of a start -----------------------------------------


def test_a_drive_that_restarts_as_it_is_started_gives_no_torque(wire, drive_end):
    drive = Drive(wire.port, DRIVE, "vertical drive")
    drive.configure()
    when_it_starts(wire, drive_end, drive_end.boot_up)
    drive.start()
    drive_end.operational = True  # whoever starts it then: its guards are gone
    for _ in range(10):
        assert watched_tick(wire, drive, 0.1) == 0.0
    assert "boot-up" in drive.fault
    with pytest.raises(NotNow):
        drive.request_enable()


def restarted_encoder(wire, encoder_end):
    """Return a started encoder whose device has restarted, and been heard."""
    encoder = Encoder(wire.port, ENCODER)
    encoder.configure()
    encoder.start()
    encoder_end.boot_up()
    wire.port.pump()
    return encoder


@pytest.mark.parametrize("restarts", [True, False])
def test_what_comes_while_a_fault_is_cleared_stays(wire, drive, drive_end, restarts):
    def happens():
        if restarts:
            drive_end.boot_up()
        else:
            wire.emit(0x601, READ_MODE)

    drive_end.boot_up()
    watched_tick(wire, drive)
    when_it_starts(wire, drive_end, happens)
    drive.clear_fault()
    for _ in range(200):
        assert watched_tick(wire, drive, 0.1) == 0.0
    assert "clear it again" in drive.fault
    with pytest.raises(NotNow, match="clear the fault first"):
        drive.request_enable()
    drive.clear_fault()
    for _ in range(200):
        watched_tick(wire, drive)
    assert (drive.fault, drive.recovering) == ("", False)
    drive.request_enable()


def test_a_start_that_fails_leaves_the_encoder_s_fault_and_another_try(wire, encoder_end):
    encoder = restarted_encoder(wire, encoder_end)
    told = encoder.fault

    def fail():
        raise BusError("cannot send")

    start = encoder.prepare_start
    encoder.prepare_start = fail
    with pytest.raises(BusError):
        encoder.clear_fault()
    assert encoder.fault == told
    encoder.prepare_start = start
    encoder.clear_fault()
    encoder.request(1, wire.advance(), 0)
    wire.port.pump()
    assert encoder.fault == "" and encoder.reading() is not None


def test_what_comes_while_the_encoder_s_fault_is_cleared_stays(wire, encoder_end):
    encoder = restarted_encoder(wire, encoder_end)
    when_it_starts(wire, encoder_end, encoder_end.boot_up)
    encoder.clear_fault()
    assert "boot-up" in encoder.fault
    encoder.request(1, wire.advance(), 0)
    wire.port.pump()
    assert encoder.reading() is None
