# SPDX-License-Identifier: Apache-2.0
"""The drive as the last guard: deadline, heartbeat, what 6007 and 605E say, and the recovery."""

import pytest

from screw_module_ros.resources import resource_path
from screw_module_ros.rig.build import RigSettings

OFF = "00 00 00 00"
SHUTDOWN = "06 00 00 00"
ENABLE = "0F 00 00 00"
RESET = "80 00 00 00"


def beat(bench, milliseconds: int, rpdo: str) -> list:
    """Let time pass with the master's heartbeat and RPDO each 10 ms."""
    frames = []
    for _ in range(milliseconds // 10):
        bench.send(0x770, "05")
        bench.send(0x201, rpdo)
        frames += bench.run(10)
    return frames


def test_rpdo_deadline_faults_by_itself(torque_drive):
    drive = torque_drive
    drive.enable("F4 01")
    assert drive.run(19) == []
    assert drive.run(1) == [(0x081, "50 82 11 00 00 00 00 00")]
    assert drive.statusword() == "1802"
    assert drive.read(1, "603F:00") == "5082"
    assert not drive.world.vertical_powered
    assert not drive.world.vertical_braked


def test_deadline_is_armed_by_the_first_rpdo_and_disarmed_by_zero(torque_drive):
    drive = torque_drive
    drive.run(100)
    assert drive.statusword() == "5002"
    drive.ask(0x201, SHUTDOWN)
    assert drive.write(1, "1400:05", "0000") == "ok"
    assert drive.run(100) == []


def test_deadline_counts_also_after_nmt_pre_operational(torque_drive):
    drive = torque_drive
    drive.enable("F4 01")
    drive.ask(0x000, "80 01")
    drive.run(25)
    assert drive.statusword() == "1802"


def test_lost_heartbeat_faults_and_falls_back_to_pre_operational(torque_drive):
    drive = torque_drive
    drive.write(1, "1400:05", "0000")
    drive.ask(0x770, "05")
    drive.enable("F4 01")
    assert drive.run(99) == []
    assert drive.run(1) == [(0x081, "30 81 11 00 00 00 00 00")]
    assert drive.statusword() == "1802"
    assert drive.read(1, "603F:00") == "3081"
    assert drive.ask(0x080) == []  # 1029:01 = 0: pre-operational
    assert not drive.world.vertical_powered


def test_recovery_from_a_lost_heartbeat(torque_drive):
    drive = torque_drive
    drive.enable()
    drive.ask(0x770, "05")
    drive.run(150)
    drive.send(0x770, "05")
    drive.start(1)
    assert drive.ask(0x201, OFF) == []
    assert drive.ask(0x201, RESET) == [(0x081, "00 00 00 00 00 00 00 00")]
    assert drive.statusword() == "5002"
    assert drive.read(1, "603F:00") == "0000"
    drive.enable("64 00")
    assert drive.world.vertical_powered
    assert beat(drive, 300, "0F 00 64 00") == []


def test_error_history_has_the_newest_first(torque_drive):
    drive = torque_drive
    drive.enable()
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
    drive.enable()
    drive.run(25)
    assert drive.statusword()[:2] == state
    assert drive.read(1, "603F:00") == error
    assert drive.read(1, "1001:00") == "11"


def test_an_rpdo_after_its_deadline_clears_the_error_when_there_is_no_fault(torque_drive):
    drive = torque_drive
    drive.write(1, "6007:00", "0000")
    drive.enable()
    assert drive.run(25) == [(0x081, "50 82 11 00 00 00 00 00")]
    assert drive.ask(0x201, ENABLE) == [(0x081, "00 00 00 00 00 00 00 00")]


@pytest.fixture
def make_of(make_bench, tmp_path):
    """Return a maker of drives that differ from the standard in these objects (YAML)."""
    def make(objects: str):
        file = tmp_path / "make.yaml"
        standard = resource_path("params/devices/generic_402.yaml").read_text()
        file.write_text(f"{standard}objects: {{{objects}}}")
        return make_bench("drive", settings=RigSettings(drive_profile=str(file)))

    return make


def test_a_make_may_have_objects_of_its_own(make_of):
    drive = make_of(
        '"2000": {size: 1, value: 7}, "2001": {size: 2, value: 0x1234, read_only: true}, '
        '"2002:01": {size: 4, value: 5, per_node: true}, "2003": {size: 2}, "6087": {absent: true}'
    )
    assert [drive.read(1, key) for key in ("2000:00", "2001:00", "2002:01")] == [
        "07", "3412", "06000000"
    ]  # fmt: skip
    assert drive.write(1, "2001:00", "0000") == "06010002"
    assert drive.read(1, "2003:00") == "060a0023"  # nothing was ever stored there
    assert drive.read(1, "6087:00") == "06020000"


def test_a_make_may_have_its_deadline_from_power_on(make_of):
    drive = make_of('"1400:05": {value: 20}')
    drive.silence(1)
    drive.start(1)
    assert drive.run(100) == []  # a frame arms it
    assert drive.ask(0x201, "06 00") == []
    assert drive.run(19) == []
    assert drive.run(1) == [(0x081, "50 82 11 00 00 00 00 00")]
    drive.send(0x201, "06 00")
    drive.ask(0x000, "81 01")
    assert drive.run(30) == [(0x701, "00")]  # and a reset disarms it
    drive.silence(1)
    drive.start(1)
    assert drive.run(100) == []


def test_a_make_may_have_its_deadline_in_periods_of_sync(make_bench):
    drive = make_bench("drive", settings=RigSettings(drive_profile="elmo_gold"))
    drive.silence(1)
    assert drive.write(1, "1006:00", "88130000") == "ok"  # 5 ms
    assert drive.write(1, "2F75:00", "0400") == "ok"
    drive.start(1)
    drive.ask(0x201, "06 00")
    assert drive.run(19) == []
    assert drive.run(1) == [(0x081, "50 82 11 00 00 00 00 00")]


def test_fault_reaction_brakes_when_told_so(torque_drive):
    drive = torque_drive
    drive.write(1, "605E:00", "0200")
    drive.enable()
    drive.world.counts_per_second = 50_000.0
    drive.run(25)
    assert drive.statusword()[:2] == "1f"
    assert drive.world.vertical_braked
    drive.world.counts_per_second = 0.0
    drive.run(12)
    assert drive.statusword()[:2] == "18"
    assert not drive.world.vertical_braked


def test_nmt_stop_in_operation_is_a_fault(torque_drive):
    drive = torque_drive
    drive.enable("F4 01")
    drive.ask(0x000, "02 01")
    assert not drive.world.vertical_powered
    drive.ask(0x000, "80 01")
    assert drive.read(1, "603F:00") == "0081"


def test_nmt_reset_lets_go_and_forgets_the_guard(torque_drive):
    drive = torque_drive
    drive.enable("F4 01")
    drive.ask(0x000, "81 01")
    assert not drive.world.vertical_powered
    assert drive.run(30) == [(0x701, "00")]
    assert drive.read(1, "1016:01") == "00000000"
    assert drive.statusword() == "5002"
    assert drive.read(1, "6076:00") == "a4010000"
