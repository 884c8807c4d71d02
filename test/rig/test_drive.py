# SPDX-License-Identifier: Apache-2.0
"""The simulated drive against CiA 402: objects, torque in and out, modes, stops."""

import pytest

from screw_module_ros.rig.build import RigSettings

SHUTDOWN = "06 00 00 00"
SWITCH_ON = "07 00 00 00"
ENABLE = "0F 00 00 00"


def test_golden_frames_on_the_way_to_operation_enabled(torque_drive):
    drive = torque_drive
    drive.world.encoder_count = -2
    words = []
    for rpdo in (SHUTDOWN, SWITCH_ON, ENABLE):
        drive.send(0x201, rpdo)
        words += drive.ask(0x080)
    assert words == [
        (0x181, "31 02 FE FF FF FF 00 00"),
        (0x181, "33 02 FE FF FF FF 00 00"),
        (0x181, "37 12 FE FF FF FF 00 00"),
    ]


def test_target_torque_is_per_mille_of_rated_and_becomes_amperes(torque_drive):
    drive = torque_drive
    drive.enable("F4 01")  # 500 per mille of 0.42 Nm = 0.21 Nm = 1.3125 A
    assert drive.world.vertical_powered
    assert drive.world.vertical_command == pytest.approx(1.3125)
    drive.ask(0x201, "0F 00 0C FE")  # -500
    assert drive.world.vertical_command == pytest.approx(-1.3125)
    assert drive.read(1, "6040:00") == "0f00"
    assert drive.read(1, "6071:00") == drive.read(1, "6074:00") == "0cfe"
    assert drive.read(1, "6060:00") == drive.read(1, "6061:00") == "0a"


def test_actual_torque_and_current_are_reported_per_mille(torque_drive):
    drive = torque_drive
    drive.world.vertical_torque = -0.105
    assert drive.ask(0x080) == [(0x181, "50 02 00 00 00 00 06 FF")]  # -250
    assert drive.read(1, "6078:00") == "06ff"
    drive.world.vertical_torque = 1000.0
    assert drive.read(1, "6077:00") == "ff7f"


def test_position_wraps_at_32_bits(drive):
    drive.world.encoder_count = 2**31 + 5
    assert drive.read(1, "6064:00") == "05000080"


def test_ratings_are_in_milli_units(drive):
    assert drive.read(1, "6076:00") == "a4010000"  # 420 mNm
    assert drive.read(1, "6075:00") == "410a0000"  # 2625 mA
    assert drive.read(1, "6502:00") == "08020000"


def test_a_make_limits_the_torque_by_a_share_of_its_current(make_bench):
    drive = make_bench("drive", settings=RigSettings(drive_profile="epos4"))
    assert drive.read(1, "6072:00") == "06020000"  # it has no such object
    assert drive.read(1, "1400:05") == "06090011"  # and no such subindex
    drive.start(1)
    assert drive.write(1, "3001:02", "C4090000") == "ok"  # 2500 of 5000 mA
    for key, value in (
        ("6060:00", "0A"), ("6040:00", "0600"), ("6040:00", "0700"), ("6040:00", "0F00"),
        ("6071:00", "E803"),
    ):  # fmt: skip
        assert drive.write(1, key, value) == "ok"
    assert drive.world.vertical_command == pytest.approx(0.5 * 0.42 / 0.16)


def test_the_modes_that_can_be_set_are_those_of_6502(make_bench):
    drive = make_bench("drive", settings=RigSettings(drive_profile="epos4"))
    assert drive.read(1, "6502:00") == "a5030000"
    modes = range(-2, 12)
    said = [drive.write(1, "6060:00", mode.to_bytes(1, "little", signed=True).hex())
            for mode in modes]
    assert [mode for mode, each in zip(modes, said, strict=True) if each == "ok"] == [
        0, 1, 3, 6, 8, 9, 10
    ]  # fmt: skip
    assert set(said) == {"ok", "06090030"}


def test_ratings_are_those_of_the_motor_that_was_asked_for(make_bench):
    settings = RigSettings(rated_torque=0.5, torque_constant=0.25, max_torque=1234)
    drive = make_bench("drive", "planar", settings=settings)
    assert drive.read(1, "6076:00") == "f4010000"  # 500 mNm
    assert drive.read(1, "6075:00") == "d0070000"  # 2000 mA
    assert drive.read(1, "6072:00") == drive.read(3, "6072:00") == "d204"
    assert drive.read(1, "608F:01") == "204e0000"  # 20 000 counts a turn
    assert drive.read(3, "608F:01") == "00000100"  # 65 536


def test_target_beyond_max_torque_is_limited_and_said(torque_drive):
    drive = torque_drive
    drive.write(1, "6072:00", "E803")  # 1000 per mille
    drive.enable("D0 07")
    assert drive.world.vertical_command == pytest.approx(2.625)
    assert drive.statusword() == "371a"  # internal limit, bit 11


def test_no_torque_without_a_torque_mode(torque_drive):
    drive = torque_drive
    drive.write(1, "6060:00", "00")
    drive.enable("F4 01")
    assert drive.statusword()[:2] == "37"
    assert not drive.world.vertical_powered


def test_modes_that_are_not_supported_are_refused(drive):
    for mode in ("01", "03", "08", "09", "0B", "FF"):
        assert drive.write(1, "6060:00", mode) == "06090030"
    assert drive.write(1, "6060:00", "04") == "ok"
    assert drive.read(1, "6061:00") == "04"


def test_profile_torque_follows_the_slope_and_halts(torque_drive):
    drive = torque_drive
    drive.write(1, "1400:05", "0000")
    drive.write(1, "6060:00", "04")
    drive.write(1, "6087:00", "E8030000")  # 1000 per mille a second
    for controlword in ("06 00 64 00", "07 00 64 00"):
        drive.ask(0x201, controlword)
    drive.run(1000)  # it does not save up torque
    drive.ask(0x201, "0F 00 64 00")
    drive.run(50)
    assert drive.world.vertical_command == pytest.approx(0.05 * 2.625, rel=0.05)
    drive.run(100)
    assert drive.world.vertical_command == pytest.approx(0.1 * 2.625)
    assert drive.statusword() == "3706"  # target reached, bit 10
    drive.ask(0x201, "0F 01 64 00")  # halt, bit 8
    drive.run(200)
    assert drive.world.vertical_command == 0.0


def test_torque_offset_adds_in_cyclic_mode(torque_drive):
    torque_drive.write(1, "60B2:00", "6400")
    torque_drive.enable("64 00")
    assert torque_drive.world.vertical_command == pytest.approx(0.2 * 2.625)


def test_the_torque_offset_may_come_with_each_command(drive):
    drive.write(1, "1400:01", "01020080")
    drive.write(1, "1600:00", "00")
    for number, entry in enumerate(("10004060", "1000B260"), 1):
        assert drive.write(1, f"1600:0{number}", entry) == "ok"
    drive.write(1, "1600:00", "02")
    drive.write(1, "1400:01", "01020000")
    drive.write(1, "6060:00", "0A")
    drive.start(1)
    drive.enable("64 00")
    assert drive.world.vertical_command == pytest.approx(0.1 * 2.625)
    assert drive.read(1, "60B2:00") == "6400"


def test_per_mille_are_those_of_the_rating_that_the_master_has_written(torque_drive):
    torque_drive.write(1, "6076:00", "48030000")  # 840 mNm
    torque_drive.enable("64 00")
    assert torque_drive.world.vertical_command == pytest.approx(0.1 * 5.25)


def test_disabled_means_coasting(torque_drive):
    drive = torque_drive
    drive.enable("F4 01")
    drive.ask(0x201, "07 00 F4 01")
    world = drive.world
    state = (world.vertical_command, world.vertical_powered, world.vertical_braked)
    assert state == (0.0, False, False)


def test_disable_with_option_1_brakes_to_standstill(torque_drive):
    drive = torque_drive
    drive.write(1, "1400:05", "0000")
    drive.write(1, "605C:00", "0100")
    drive.enable("F4 01")
    drive.world.counts_per_second = 50_000.0
    drive.ask(0x201, "07 00 00 00")
    drive.run(20)
    assert drive.world.vertical_braked
    assert drive.statusword()[:2] == "37"
    drive.world.counts_per_second = 0.0
    drive.run(12)
    assert drive.statusword()[:2] == "33"
    assert not drive.world.vertical_braked


def test_a_stop_that_never_ends_is_given_up(torque_drive):
    drive = torque_drive
    drive.write(1, "1400:05", "0000")
    drive.write(1, "605A:00", "0200")
    drive.enable()
    drive.world.counts_per_second = 1e6
    drive.ask(0x201, "02 00 00 00")
    assert drive.statusword()[:2] == "17"
    drive.run(1100)
    assert drive.statusword()[:2] == "50"


def test_planar_drives_are_two_nodes_on_one_bus(make_bench, world):
    plane = make_bench("planar")
    world.planar_counts = (1, -1)
    world.planar_torque = (5.0, -10.0)
    for node in (3, 4):
        assert plane.read(node, "6076:00") == "10270000"  # 10 000 mNm
        plane.silence(node)
        entries = ["10004160", "20006460", "10007760"]
        plane.map_pdo(node, 0, entries, "02", f"8{node}010000")
        plane.write(node, "6060:00", "0A")
        plane.write(node, "1400:01", f"0{node}020080")
        plane.write(node, "1600:00", "00")
        plane.write(node, "1600:01", "10004060")
        plane.write(node, "1600:02", "10007160")
        plane.write(node, "1600:00", "02")
        plane.write(node, "1400:01", f"0{node}020000")
        plane.start(node)
    assert plane.ask(0x080) == []
    assert plane.ask(0x080) == [
        (0x183, "50 02 01 00 00 00 F4 01"),
        (0x184, "50 02 FF FF FF FF 18 FC"),
    ]
    for rpdo in (SHUTDOWN, SWITCH_ON, "0F 00 0A 00"):
        plane.send(0x203, rpdo)
    plane.send(0x204, "0F 00 E8 03")
    plane.run(0)
    assert world.planar_command == pytest.approx((0.1, 0.0))
    assert world.planar_powered == (True, False)
