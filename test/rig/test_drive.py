# SPDX-License-Identifier: Apache-2.0
"""The simulated drive against CiA 402: torque in and out, modes, guards, faults, options."""

import pytest

OFF, SHUTDOWN, SWITCH_ON, ENABLE, RESET = (
    "00 00 00 00",
    "06 00 00 00",
    "07 00 00 00",
    "0F 00 00 00",
    "80 00 00 00",
)


def enable(bench, target: str = "00 00") -> None:
    for rpdo in (SHUTDOWN, SWITCH_ON, ENABLE, "0F 00" + target):
        bench.send(0x201, rpdo)
    bench.run(0)


def statusword(bench) -> str:
    return bench.read(1, "6041:00")


def beat(bench, milliseconds: int, rpdo: str | None, heartbeat: bool = True) -> list:
    """Let time pass with the master's heartbeat and RPDO each 10 ms."""
    frames = []
    for _ in range(milliseconds // 10):
        if heartbeat:
            bench.send(0x770, "05")
        if rpdo:
            bench.send(0x201, rpdo)
        frames += bench.run(10)
    return frames


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
    enable(drive, "F4 01")  # 500 per mille of 0.42 Nm = 0.21 Nm = 1.3125 A
    assert drive.world.vertical_powered
    assert drive.world.vertical_command == pytest.approx(1.3125)
    drive.ask(0x201, "0F 00 0C FE")  # -500
    assert drive.world.vertical_command == pytest.approx(-1.3125)


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


def test_target_beyond_max_torque_is_limited_and_said(torque_drive):
    drive = torque_drive
    drive.write(1, "6072:00", "E803")  # 1000 per mille
    enable(drive, "D0 07")
    assert drive.world.vertical_command == pytest.approx(2.625)
    assert statusword(drive) == "371a"  # internal limit, bit 11


def test_no_torque_without_a_torque_mode(torque_drive):
    drive = torque_drive
    drive.write(1, "6060:00", "00")
    enable(drive, "F4 01")
    assert statusword(drive)[:2] == "37"
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
    enable(drive, "64 00")
    drive.run(50)
    assert drive.world.vertical_command == pytest.approx(0.05 * 2.625, rel=0.05)
    drive.run(100)
    assert drive.world.vertical_command == pytest.approx(0.1 * 2.625)
    assert statusword(drive) == "3706"  # target reached, bit 10
    drive.ask(0x201, "0F 01 64 00")  # halt, bit 8
    drive.run(200)
    assert drive.world.vertical_command == 0.0


def test_torque_offset_adds_in_cyclic_mode(torque_drive):
    torque_drive.write(1, "60B2:00", "6400")
    enable(torque_drive, "64 00")
    assert torque_drive.world.vertical_command == pytest.approx(0.2 * 2.625)


def test_disabled_means_coasting(torque_drive):
    drive = torque_drive
    enable(drive, "F4 01")
    drive.ask(0x201, "07 00 F4 01")
    world = drive.world
    state = (world.vertical_command, world.vertical_powered, world.vertical_braked)
    assert state == (0.0, False, False)


def test_disable_with_option_1_brakes_to_standstill(torque_drive):
    drive = torque_drive
    drive.write(1, "1400:05", "0000")
    drive.write(1, "605C:00", "0100")
    enable(drive, "F4 01")
    drive.world.counts_per_second = 50_000.0
    drive.ask(0x201, "07 00 00 00")
    drive.run(20)
    assert drive.world.vertical_braked
    assert statusword(drive)[:2] == "37"
    drive.world.counts_per_second = 0.0
    drive.run(12)
    assert statusword(drive)[:2] == "33"
    assert not drive.world.vertical_braked


def test_a_stop_that_never_ends_is_given_up(torque_drive):
    drive = torque_drive
    drive.write(1, "1400:05", "0000")
    drive.write(1, "605A:00", "0200")
    enable(drive)
    drive.world.counts_per_second = 1e6
    drive.ask(0x201, "02 00 00 00")
    assert statusword(drive)[:2] == "17"
    drive.run(1100)
    assert statusword(drive)[:2] == "50"


def test_rpdo_deadline_faults_by_itself(torque_drive):
    drive = torque_drive
    enable(drive, "F4 01")
    assert drive.run(19) == []
    assert drive.run(1) == [(0x081, "50 82 11 00 00 00 00 00")]
    assert statusword(drive) == "1802"
    assert drive.read(1, "603F:00") == "5082"
    assert not drive.world.vertical_powered
    assert not drive.world.vertical_braked


def test_deadline_is_armed_by_the_first_rpdo_and_disarmed_by_zero(torque_drive):
    drive = torque_drive
    drive.run(100)
    assert statusword(drive) == "5002"
    drive.ask(0x201, SHUTDOWN)
    assert drive.write(1, "1400:05", "0000") == "ok"
    assert drive.run(100) == []


def test_deadline_counts_also_after_nmt_pre_operational(torque_drive):
    drive = torque_drive
    enable(drive, "F4 01")
    drive.ask(0x000, "80 01")
    drive.run(25)
    assert statusword(drive) == "1802"


def test_lost_heartbeat_faults_and_falls_back_to_pre_operational(torque_drive):
    drive = torque_drive
    drive.write(1, "1400:05", "0000")
    drive.ask(0x770, "05")
    enable(drive, "F4 01")
    assert drive.run(99) == []
    assert drive.run(1) == [(0x081, "30 81 11 00 00 00 00 00")]
    assert statusword(drive) == "1802"
    assert drive.read(1, "603F:00") == "3081"
    assert drive.ask(0x080) == []  # 1029:01 = 0: pre-operational
    assert not drive.world.vertical_powered


def test_way_back_from_a_lost_heartbeat(torque_drive):
    drive = torque_drive
    enable(drive)
    drive.ask(0x770, "05")
    drive.run(150)
    drive.send(0x770, "05")
    drive.start(1)
    assert drive.ask(0x201, OFF) == []
    assert drive.ask(0x201, RESET) == [(0x081, "00 00 00 00 00 00 00 00")]
    assert statusword(drive) == "5002"
    assert drive.read(1, "603F:00") == "0000"
    enable(drive, "64 00")
    assert drive.world.vertical_powered
    assert beat(drive, 300, "0F 00 64 00") == []


def test_error_history_has_the_newest_first(torque_drive):
    drive = torque_drive
    enable(drive)
    drive.ask(0x770, "05")
    drive.run(150)
    assert drive.read(1, "1003:00") == "02"
    assert drive.read(1, "1003:01") == "30810000"
    assert drive.read(1, "1003:02") == "50820000"
    assert drive.read(1, "603F:00") == "5082"
    assert drive.write(1, "1003:00", "00") == "ok"
    assert drive.read(1, "1003:00") == "00"


@pytest.mark.parametrize(
    ("option", "state", "error"),
    [
        ("0000", "37", "0000"),
        ("0100", "18", "5082"),
        ("0200", "50", "0000"),
        ("0300", "50", "0000"),
    ],
)
def test_abort_connection_option(torque_drive, option, state, error):
    drive = torque_drive
    drive.write(1, "6007:00", option)
    enable(drive)
    drive.run(25)
    assert statusword(drive)[:2] == state
    assert drive.read(1, "603F:00") == error
    assert drive.read(1, "1001:00") == "11"


def test_an_rpdo_after_its_deadline_clears_the_error_when_there_is_no_fault(torque_drive):
    drive = torque_drive
    drive.write(1, "6007:00", "0000")
    enable(drive)
    assert drive.run(25) == [(0x081, "50 82 11 00 00 00 00 00")]
    assert drive.ask(0x201, ENABLE) == [(0x081, "00 00 00 00 00 00 00 00")]


def test_fault_reaction_brakes_when_told_so(torque_drive):
    drive = torque_drive
    drive.write(1, "605E:00", "0200")
    enable(drive)
    drive.world.counts_per_second = 50_000.0
    drive.run(25)
    assert statusword(drive)[:2] == "1f"
    assert drive.world.vertical_braked
    drive.world.counts_per_second = 0.0
    drive.run(12)
    assert statusword(drive)[:2] == "18"
    assert not drive.world.vertical_braked


def test_nmt_stop_in_operation_is_a_fault(torque_drive):
    drive = torque_drive
    enable(drive, "F4 01")
    drive.ask(0x000, "02 01")
    assert not drive.world.vertical_powered
    drive.ask(0x000, "80 01")
    assert drive.read(1, "603F:00") == "0081"


def test_nmt_reset_lets_go_and_forgets_the_guard(torque_drive):
    drive = torque_drive
    enable(drive, "F4 01")
    drive.ask(0x000, "81 01")
    assert not drive.world.vertical_powered
    assert drive.run(30) == [(0x701, "00")]
    assert drive.read(1, "1016:01") == "00000000"
    assert statusword(drive) == "5002"
    assert drive.read(1, "6076:00") == "a4010000"


@pytest.mark.parametrize(
    ("fault", "emcy"),
    [
        ("over_current", "10 23 03 00 00 00 00 00"),
        ("over_voltage", "10 32 05 00 00 00 00 00"),
        ("over_temperature", "10 42 09 00 00 00 00 00"),
        ("motor_temperature", "10 43 09 00 00 00 00 00"),
        ("watchdog", "10 60 01 00 00 00 00 00"),
        ("feedback", "00 73 01 00 00 00 00 00"),
        ("heartbeat_fault", "30 81 11 00 00 00 00 00"),
    ],
)
def test_injected_faults_stop_the_drive_and_last(torque_drive, fault, emcy):
    drive = torque_drive
    drive.write(1, "1400:05", "0000")
    enable(drive, "F4 01")
    drive.rig.inject("drive", fault, 0, 0, drive.now_ns)
    assert drive.run(0) == [(0x081, emcy)]
    assert not drive.world.vertical_powered
    drive.ask(0x201, OFF)
    drive.ask(0x201, RESET)
    assert statusword(drive) == "1802"
    drive.rig.inject("drive", "clear", 0, 0, drive.now_ns)
    drive.ask(0x201, OFF)
    assert drive.ask(0x201, RESET)[0] == (0x081, "00 00 00 00 00 00 00 00")
    assert statusword(drive) == "5002"


def test_under_voltage_shows_in_the_statusword(torque_drive):
    drive = torque_drive
    drive.rig.inject("drive", "under_voltage", 0, 0, drive.now_ns)
    drive.run(0)
    assert statusword(drive) == "0802"
    assert drive.read(1, "6079:00") == "00000000"


def test_any_error_code_may_be_injected(torque_drive):
    torque_drive.rig.inject("drive", "fault", 0xFF01, 0, torque_drive.now_ns)
    assert torque_drive.run(0) == [(0x081, "01 FF 81 00 00 00 00 00")]


def test_torque_off_disables_without_a_fault_and_needs_a_new_start(torque_drive):
    drive = torque_drive
    enable(drive, "F4 01")
    drive.rig.inject("drive", "torque_off", 0, 0.005, drive.now_ns)
    drive.run(0)
    assert statusword(drive) == "4002"
    assert not drive.world.vertical_powered
    drive.ask(0x201, SHUTDOWN)
    assert statusword(drive) == "4002"
    drive.run(6)
    drive.ask(0x201, ENABLE)
    assert statusword(drive) == "5002"


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
    inject("clear")
    assert drive.read(1, "6076:00") == "a4010000"
    inject("refuse_enable")
    enable(drive)
    assert statusword(drive) == "3302"
    inject("clear")
    inject("stuck_torque", -500)
    enable(drive, "F4 01")
    assert drive.world.vertical_command == pytest.approx(-1.3125)
    inject("clear")
    inject("motor_open")
    assert not drive.world.vertical_powered
    assert statusword(drive) == "3712"
    inject("disable")
    assert statusword(drive) == "5002"
    inject("warning")
    assert statusword(drive) == "d002"


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
