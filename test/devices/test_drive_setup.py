# SPDX-License-Identifier: Apache-2.0
"""Configuration, guards and exit of a drive, object by object."""

from __future__ import annotations

import pytest
from running_drivers import tick_both, two_drives
from scripted import Wire, unsigned

from screw_module_ros.devices import drive_group
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import WAIVABLE, DriveSettings
from screw_module_ros.devices.drive_setup import rated_torque
from screw_module_ros.devices.errors import (
    NotAnswering,
    NotConfigured,
    NotNow,
    Occupied,
    WrongDevice,
)

SETTINGS = DriveSettings(listen=0.0, sdo_timeout=0.02)


def configured(wire, settings=SETTINGS):
    drive = Drive(wire.port, settings, "vertical drive")
    drive.configure()
    return drive


def tick(wire, drive):
    now_ns = wire.advance()
    drive.sync(now_ns)
    wire.port.pump()
    drive.heartbeat(now_ns)
    drive.write(0.0, now_ns)


def test_every_write_in_order(wire, drive_end):
    configured(wire)
    assert drive_end.writes == [
        (0x6071, 0, 0), (0x6040, 0, 0),  # off, whoever left it on
        (0x6060, 0, 10),
        (0x1401, 1, 0x80000301), (0x1802, 1, 0xC0000381),  # unused PDOs
        (0x1800, 1, 0xC0000181), (0x1A00, 0, 0),
        (0x1A00, 1, 0x60410010), (0x1A00, 2, 0x60640020), (0x1A00, 3, 0x60770010), (0x1A00, 0, 3),
        (0x1800, 2, 1), (0x1800, 1, 0x40000181),
        (0x1A01, 0, 0),  # TPDO2 came disabled
        (0x1A01, 1, 0x603F0010), (0x1A01, 2, 0x60610008), (0x1A01, 3, 0x60FD0020), (0x1A01, 0, 3),
        (0x1801, 2, 255), (0x1801, 5, 100), (0x1801, 1, 0x40000281),
        (0x1400, 1, 0x80000201), (0x1600, 0, 0),
        (0x1600, 1, 0x60400010), (0x1600, 2, 0x60710010), (0x1600, 0, 2),
        (0x1400, 2, 255), (0x1400, 5, 20), (0x1400, 1, 0x00000201),
        (0x1017, 0, 50), (0x1016, 1, 0x00700064),
        (0x6007, 0, 1), (0x605A, 0, 0), (0x605E, 0, 0),
        (0x6072, 0, 3810),  # 1.6 Nm
    ]  # fmt: skip


def test_sync_divider_is_the_transmission_type(wire, drive_end):
    configured(wire, SETTINGS._replace(sync_divider=2, rate=500.0))
    assert drive_end.objects[0x1800, 2] == b"\x02"


def test_brake_is_written_as_ramps(wire, drive_end):
    configured(wire, SETTINGS._replace(stop_reaction="brake"))
    objects = drive_end.objects
    assert objects[0x605A, 0] == objects[0x605E, 0] == b"\x02\x00"
    assert objects[0x605C, 0] == b"\x01\x00"
    assert objects[0x6007, 0] == b"\x01\x00"


# -- mode ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("supported", "mode"), [(0x0208, 10), (0x0200, 10), (0x0008, 4)])
def test_mode_is_cyclic_torque_else_profile_torque(wire, drive_end, supported, mode):
    drive_end.objects[0x6502, 0] = unsigned(supported, 4)
    drive_end.objects[0x6087, 0] = bytes(4)
    assert configured(wire).mode == mode
    assert drive_end.objects[0x6060, 0] == bytes([mode])
    steep = drive_end.objects[0x6087, 0] == bytes.fromhex("FF FF FF 7F")
    assert steep == (mode == 4)


def test_torque_offset_of_an_earlier_program_is_cleared(wire, drive_end):
    drive_end.objects[0x60B2, 0] = unsigned(100, 2)  # added to each target in cyclic torque mode
    configured(wire)
    assert drive_end.objects[0x60B2, 0] == b"\0\0"
    drive_end.objects[0x60B2, 0] = unsigned(100, 2)
    drive_end.refused[0x60B2, 0] = 0x06010002
    with pytest.raises(NotConfigured, match="100 per mille.*60B2"):
        configured(wire)


@pytest.mark.parametrize("code", [0x06010000, 0x08000000])
def test_a_drive_without_a_torque_offset_may_refuse_with_any_code(wire, drive_end, code):
    drive_end.objects.pop((0x60B2, 0), None)
    drive_end.refused[0x60B2, 0] = code
    assert configured(wire).identity


def test_drive_without_torque_modes_is_refused(wire, drive_end):
    drive_end.objects[0x6502, 0] = unsigned(0x0107, 4)
    with pytest.raises(WrongDevice, match="torque mode"):
        configured(wire)


def test_mode_that_is_not_shown_is_refused(wire, drive_end, monkeypatch):
    monkeypatch.setattr("screw_module_ros.devices.drive_setup._MODE_WITHIN_S", 0.0)
    drive_end.written = lambda key, data: None
    with pytest.raises(NotConfigured, match="6061 shows 0"):
        configured(wire)


# -- rated torque --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("raw", "expected"), [(420, 0.42), (420_000, 0.42), (423, 0.42), (12_000, 12.0), (5, 0.005)]
)
def test_rated_torque_in_either_unit(raw, expected):
    assert rated_torque(raw, expected, "drive") == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("raw", [0, 42, 4200, 42_000, 430, 0xFFFFFFFF])
def test_another_rated_torque_is_refused(raw):
    with pytest.raises(WrongDevice, match=r"rated_torque is 0\.42 Nm"):
        rated_torque(raw, 0.42, "drive")


def test_rating_in_micro_newton_metres_scales_the_command(wire, drive_end):
    drive_end.objects[0x6076, 0] = unsigned(420_000, 4)
    drive = enabled(wire)
    drive.write(0.42, wire.now_ns)
    assert wire.sent(0x201)[-1] == bytes.fromhex("0F 00 E8 03")


# -- who is there --------------------------------------------------------------------------------


def test_drive_without_digital_inputs_reports_the_rest(wire, drive_end):
    """60FD is optional in CiA 402."""
    accept = drive_end._download

    def without_inputs(command, key, address, data):
        refused = key == (0x1A01, 3) and data != bytes(4)
        drive_end.refused = {key: 0x06040041} if refused else {}  # cannot be mapped
        accept(command, key, address, data)

    drive_end._download = without_inputs
    drive = configured(wire)
    assert drive_end.objects[0x1A01, 0] == b"\x02"
    assert drive_end.objects[0x1801, 1] == unsigned(0x40000281, 4)
    drive.start()
    wire.emit(0x281, "20 32 0A")
    wire.port.pump()
    assert (drive.error_code, drive.mode_display) == (0x3220, 10)
    assert drive.counters["wrong_length"] == 0


def test_silent_drive_is_named_within_its_time_limit(wire):
    with pytest.raises(NotAnswering, match=r"vertical drive \(node id 1\).*Virtual bus"):
        configured(wire)
    assert len(wire.sent(0x601)) == 4  # two tries and their aborts


def test_encoder_in_the_drives_place_is_refused(wire, drive_end):
    drive_end.objects[0x1000, 0] = bytes.fromhex("96 01 02 00")
    with pytest.raises(WrongDevice, match="CiA 406"):
        configured(wire)


def test_somebody_who_already_commands_is_named(wire, drive_end):
    wire.emit(0x201, "00 00 00 00")
    with pytest.raises(Occupied, match="frames 0x201"):
        configured(wire, SETTINGS._replace(listen=0.05))
    assert wire.frames == []


def test_a_second_sync_producer_is_not_taken_for_a_second_master(wire, drive_end):
    wire.emit(0x080, "")
    with pytest.raises(Occupied, match="already sends SYNC.*can.sync_producer should be false"):
        configured(wire, SETTINGS._replace(listen=0.05))
    assert wire.frames == []


def test_second_copy_is_refused_before_anything_is_sent(wire, drive_end):
    wire.emit(0x770, "05")
    with pytest.raises(Occupied, match="master 112"):
        configured(wire, SETTINGS._replace(listen=0.05))
    assert wire.frames == []


# -- guards --------------------------------------------------------------------------------------


GUARDS = [(0x1016, 1), (0x1017, 0), (0x1400, 5), (0x6007, 0), (0x605A, 0), (0x605E, 0), (0x6072, 0)]


@pytest.mark.parametrize("key", GUARDS)
@pytest.mark.parametrize("how", ["refused", "deaf", "absent"])
def test_drive_without_a_guard_is_not_enabled(wire, drive_end, key, how):
    if how == "refused":
        drive_end.refused[key] = 0x06090030
    elif how == "deaf":
        drive_end.deaf.add(key)
        drive_end.objects[key] = b"\x07" * len(drive_end.objects[key])
    else:
        del drive_end.objects[key]
    drive = configured(wire)
    drive.start()
    for _ in range(5):
        tick(wire, drive)
    assert f"{key[0]:04X}" in drive.warnings[0]
    assert drive.warnings[0].startswith("UNGUARDED")
    with pytest.raises(NotNow, match=f"{key[0]:04X}"):
        drive.request_enable()


def test_guards_that_are_constants_of_the_drive_are_guards(wire, drive_end):
    constants = {(0x6007, 0): 1, (0x605A, 0): 0, (0x605E, 0): 0}
    for key, value in constants.items():
        drive_end.objects[key] = unsigned(value, 2)
        drive_end.refused[key] = 0x06010002
    assert configured(wire).unguarded == ()


def test_no_heartbeat_watch_is_enabled_by_its_own_switch_alone_and_is_loud(wire, drive_end):
    drive_end.refused[0x1016, 1] = 0x06090030
    drive = configured(wire, SETTINGS._replace(waived=", ".join(WAIVABLE)))
    drive.start()
    for _ in range(5):
        tick(wire, drive)
    with pytest.raises(NotNow, match="only `allow_no_heartbeat`"):
        drive.request_enable()


def test_drive_without_a_heartbeat_is_not_missed_when_that_is_allowed(wire, drive_end):
    del drive_end.objects[0x1017, 0]
    drive = configured(wire, SETTINGS._replace(waived="drive_heartbeat"))
    drive.start()
    for _ in range(300):
        tick(wire, drive)
    assert drive.fault == ""


def test_a_drive_without_a_heartbeat_that_falls_silent_is_stopped_by_nmt(wire, drive_end):
    """It may be in PRE-OPERATIONAL with its torque on: our heartbeat would hold it."""
    del drive_end.objects[0x1017, 0]
    drive = configured(wire, SETTINGS._replace(waived="drive_heartbeat"))
    drive.start()
    for _ in range(5):
        tick(wire, drive)
    drive.request_enable()
    for _ in range(20):
        tick(wire, drive)
    assert drive.is_on(wire.clock.time_ns)
    drive_end.answering = False
    for _ in range(20):
        tick(wire, drive)
    assert "silent" in drive.fault
    assert (0x000, bytes([0x02, 1])) in wire.frames


def test_a_refusal_that_quotes_1017_does_not_end_the_watch_of_the_drives_heartbeat(wire, drive_end):
    """A torque limit that stays at 0x1017 is another guard; the drive's heartbeat is still due."""
    drive_end.deaf.add((0x6072, 0))
    drive_end.objects[0x6072, 0] = unsigned(0x1017, 2)
    drive = configured(wire, SETTINGS._replace(waived="torque_limit"))
    assert "1017" in drive.warnings[0]
    drive.start()
    for _ in range(300):
        tick(wire, drive)
    assert "heartbeat of the vertical drive is missing" in drive.fault


def test_optional_ramps_that_are_refused_are_only_a_warning(wire, drive_end):
    drive_end.objects[0x605C, 0] = b"\0\0"
    drive_end.refused[0x605C, 0] = 0x06090030
    drive = configured(wire, SETTINGS._replace(stop_reaction="brake"))
    assert drive.unguarded == ()
    assert "disable reaction" in drive.warnings[0]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("heartbeat_period", 0.2),
        ("command_timeout", 0.001),
        ("master_id", 1),
        ("stop_reaction", "hope"),
        ("direction", 0),
        ("rated_torque", 0.0),
        ("max_torque", float("nan")),
        ("lasting_torque", 0.25),
    ],
)
def test_settings_that_cannot_work_name_the_field(wire, field, value):
    with pytest.raises(ValueError, match=field):
        Drive(wire.port, SETTINGS._replace(**{field: value}))


def test_enabling_before_the_loop_runs_is_refused(wire, drive_end):
    drive = configured(wire)
    with pytest.raises(NotNow, match="not being commanded"):
        drive.request_enable()


@pytest.mark.parametrize(
    ("torque", "rated", "per_mille"),
    [(1.6, 0.42, 3810), (0.42, 0.42, 1000), (0.2881, 0.42, 686), (25.0, 10.0, 2500), (0.0, 1.0, 0),
     (100.0, 0.42, 32767)],
)  # fmt: skip
@pytest.mark.parametrize("direction", [1, -1])
def test_own_limit_lets_every_command_of_ours_pass(
    wire, drive_end, torque, rated, per_mille, direction
):
    drive_end.objects[0x6076, 0] = unsigned(round(rated * 1e3), 4)
    drive = enabled(
        wire, SETTINGS._replace(max_torque=torque, rated_torque=rated, direction=direction)
    )
    limit = int.from_bytes(drive_end.objects[0x6072, 0], "little")
    assert limit == per_mille
    for wanted in (1e3, -1e3):
        drive.write(wanted, wire.now_ns)
        assert abs(drive_end.torque) <= limit
        assert abs(drive_end.torque) >= limit - 1


# -- clean exit ----------------------------------------------------------------------------------


def enabled(wire, settings=SETTINGS):
    """Return a drive in operation enabled."""
    drive = configured(wire, settings)
    drive.start()
    for _ in range(5):
        tick(wire, drive)
    drive.request_enable()
    for _ in range(3):
        tick(wire, drive)
    return drive


def test_clean_exit_order(wire, drive_end):
    drive = enabled(wire)
    drive_end.writes.clear()
    wire.frames.clear()
    assert drive_group.leave([drive], wire.port) == ""
    assert drive_end.writes == [(0x1400, 5, 0), (0x1016, 1, 0)]
    assert drive_end.state == "switched on"
    disabled = wire.frames.index((0x201, b"\x00\x00\x00\x00"))
    disarmed = wire.frames.index((0x601, bytes.fromhex("2B 00 14 05 00 00 00 00")))
    silent = wire.frames.index((0x601, bytes.fromhex("23 16 10 01 00 00 00 00")))
    assert disabled < disarmed < silent < wire.frames.index((0x000, bytes([0x80, 0x01])))
    after = len(wire.frames)
    drive.heartbeat(wire.advance(100))
    drive.write(0.1, wire.now_ns)
    assert len(wire.frames) == after


def test_exit_from_a_dead_drive_ends_and_says_so(wire, drive_end):
    drive = configured(wire)
    drive.start()
    for _ in range(3):
        tick(wire, drive)
    drive_end.mute = True
    drive_end.answering = False
    assert "not disarmed" in drive_group.leave([drive], wire.port)
    assert not drive.running


def test_a_drive_that_does_not_go_off_keeps_its_guards(wire, drive_end):
    drive = enabled(wire)
    drive_end.command = lambda word: None
    drive_end.writes.clear()
    wire.frames.clear()
    told = drive_group.leave([drive], wire.port)
    assert "not disarmed" in told and "operation enabled" in told
    assert drive_end.writes == []
    assert wire.sent(0x000) == [b"\x02\x01"], "NMT stop, and left to its guards"
    assert not drive.running


@pytest.mark.parametrize(("word", "disarmed"), [(0x0237, False), (0x0233, True), (None, False)])
def test_a_silent_drive_is_asked_whether_it_is_off(wire, drive_end, word, disarmed):
    """Its statuswords do not come; 6041 does, unless the drive lacks it."""
    drive = configured(wire)
    drive.start()
    for _ in range(5):
        tick(wire, drive)
    drive_end.answering = False
    if word is not None:
        drive_end.objects[0x6041, 0] = word.to_bytes(2, "little")
    drive_end.writes.clear()
    wire.advance(50.0)
    told = drive_group.leave([drive], wire.port)
    assert ("not disarmed" in told) is not disarmed
    assert drive_end.writes == ([(0x1400, 5, 0), (0x1016, 1, 0)] if disarmed else [])


def test_two_drives_share_a_heartbeat_and_leave_together(wire):
    ends, drives = two_drives(wire, SETTINGS)
    for drive in drives:
        drive.configure()
        drive.start()
    for _ in range(100):
        tick_both(wire, drives)
    assert [end.state for end in ends] == ["switched on"] * 2
    assert len(wire.sent(0x771)) < 8
    assert drive_group.leave(drives, wire.port) == ""
    assert [end.objects[0x1016, 1] for end in ends] == [bytes(4)] * 2


def test_exit_of_what_never_ran_does_nothing():
    wire = Wire("never ran")
    try:
        assert drive_group.leave([Drive(wire.port, SETTINGS)], wire.port) == ""
        assert wire.frames == []
    finally:
        wire.close()
