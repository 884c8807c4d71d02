# SPDX-License-Identifier: Apache-2.0
"""Faults of the drive itself: each stops it, is told, lasts while its cause does."""

import pytest

OFF = "00 00 00 00"
SHUTDOWN = "06 00 00 00"
ENABLE = "0F 00 00 00"
RESET = "80 00 00 00"


@pytest.mark.parametrize(
    ("fault", "code", "emcy"),
    [
        ("over_current", 0, "10 23 03 00 00 00 00 00"),
        ("fault", 0x3210, "10 32 05 00 00 00 00 00"),
        ("over_temperature", 0, "10 42 09 00 00 00 00 00"),
        ("fault", 0x4310, "10 43 09 00 00 00 00 00"),
        ("fault", 0x6010, "10 60 01 00 00 00 00 00"),
        ("fault", 0x7300, "00 73 01 00 00 00 00 00"),
        ("fault", 0x8130, "30 81 11 00 00 00 00 00"),
    ],
)
def test_injected_faults_stop_the_drive_and_last(torque_drive, fault, code, emcy):
    drive = torque_drive
    drive.write(1, "1400:05", "0000")
    drive.enable("F4 01")
    drive.rig.inject("drive", fault, code, 0, drive.now_ns)
    assert drive.run(0) == [(0x081, emcy)]
    assert not drive.world.vertical_powered
    drive.ask(0x201, OFF)
    drive.ask(0x201, RESET)
    assert drive.statusword() == "1802"
    drive.rig.inject("drive", "clear", 0, 0, drive.now_ns)
    drive.ask(0x201, OFF)
    assert drive.ask(0x201, RESET)[0] == (0x081, "00 00 00 00 00 00 00 00")
    assert drive.statusword() == "5002"


def test_under_voltage_shows_in_the_statusword(torque_drive):
    drive = torque_drive
    drive.rig.inject("drive", "fault", 0x3220, 0, drive.now_ns)
    drive.run(0)
    assert drive.statusword() == "0802"
    assert drive.read(1, "6079:00") == "00000000"


def test_any_error_code_may_be_injected(torque_drive):
    torque_drive.rig.inject("drive", "fault", 0xFF01, 0, torque_drive.now_ns)
    assert torque_drive.run(0) == [(0x081, "01 FF 81 00 00 00 00 00")]


def test_torque_off_disables_without_a_fault_and_needs_a_new_start(torque_drive):
    drive = torque_drive
    drive.enable("F4 01")
    drive.rig.inject("drive", "torque_off", 0, 0.005, drive.now_ns)
    drive.run(0)
    assert drive.statusword() == "4002"
    assert not drive.world.vertical_powered
    drive.ask(0x201, SHUTDOWN)
    assert drive.statusword() == "4002"
    drive.run(6)
    drive.ask(0x201, ENABLE)
    assert drive.statusword() == "5002"


def test_quirks_of_a_drive(torque_drive):
    drive = torque_drive

    def inject(fault: str, value: float = 0) -> None:
        drive.rig.inject("drive", fault, value, 0, drive.now_ns)
        drive.run(0)

    inject("micro_rating")
    assert drive.read(1, "6076:00") == "a0680600"
    inject("no_cyclic_mode")
    assert drive.write(1, "6060:00", "0A") == "06090030"
    inject("refuse_guards")
    assert drive.write(1, "1016:01", "64007000") == "08000000"
    assert drive.write(1, "1400:05", "1400") == "08000000"
    inject("wrong_profile")
    assert drive.read(1, "1000:00") == "91010000"
    shown = drive.read(1, "6061:00")
    inject("mode_lost")
    assert shown != drive.read(1, "6061:00") == "00"
    inject("clear")
    assert drive.read(1, "6076:00") == "a4010000"
    inject("refuse_enable")
    drive.enable()
    assert drive.statusword() == "3302"
    inject("clear")
    inject("stuck_torque", -500)
    drive.enable("F4 01")
    assert drive.world.vertical_command == pytest.approx(-1.3125)
    inject("clear")
    inject("motor_open")
    assert not drive.world.vertical_powered
    assert drive.statusword() == "3712"
    inject("disable")
    assert drive.statusword() == "5002"
    inject("warning")
    assert drive.statusword() == "d002"


def test_position_faults(drive):
    drive.world.encoder_count = 10
    drive.rig.inject("drive", "position_freeze", 0, 0.001, drive.now_ns)
    drive.run(0)
    drive.world.encoder_count = 20
    assert drive.read(1, "6064:00") == "0a000000"
    drive.run(1)
    drive.rig.inject("drive", "position_jump", -30, 0, drive.now_ns)
    drive.run(0)
    assert drive.read(1, "6064:00") == "f6ffffff"


def test_a_fault_whose_cause_lasts_outlives_a_reset(torque_drive):
    drive = torque_drive
    drive.rig.inject("drive", "over_temperature", 0, 0, drive.now_ns)
    drive.run(1)
    drive.ask(0x000, "81 01")
    drive.run(30)
    assert drive.statusword()[:2] == "18"
    assert drive.read(1, "603F:00") == "1042"
    drive.rig.inject("drive", "clear", 0, 0, drive.now_ns)
    drive.ask(0x000, "81 01")
    drive.run(30)
    assert drive.statusword() == "5002"
    assert drive.read(1, "603F:00") == "0000"


def test_a_drive_that_drops_out_lets_go_at_once(torque_drive):
    drive = torque_drive
    drive.enable("F4 01")
    drive.rig.inject("drive", "disable", 0, 0, drive.now_ns)
    drive.run(0)
    assert drive.statusword() == "5002"
    assert not drive.world.vertical_powered
