# SPDX-License-Identifier: Apache-2.0
"""The drive driver in its cycle, against a scripted CiA 402 device: raw frames both ways."""

from __future__ import annotations

import itertools
import math
from collections import deque

import can
import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from running_drivers import watched_drive
from scripted import Wire
from scripted_devices import STATUSWORDS, ScriptedDrive

from screw_module_ros.devices.cia402 import State
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_logic import ExcessTorque
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.errors import BusError, NotNow

SETTINGS = DriveSettings(listen=0.0, sdo_timeout=0.02, max_torque=1.6)


def started(wire, drive_end, settings=SETTINGS):
    """Configured, started, one arming tick and up to switched on."""
    return watched_drive(wire, settings, tick)


@pytest.fixture
def drive(wire, drive_end):
    return started(wire, drive_end)


@pytest.fixture
def enabled(wire, drive, drive_end):
    drive.request_enable()
    for _ in range(3):
        tick(wire, drive)
    assert drive_end.state == "operation enabled"
    return drive


def tick(wire, drive, torque=0.0):
    """One period of a torque loop; returns the torque written."""
    now_ns = wire.advance()
    drive.sync(now_ns)
    drive.heartbeat(now_ns)
    wire.port.pump()
    return drive.write(torque, now_ns)


def commands(wire):
    return [data.hex(" ") for data in wire.sent(0x201)]


# -- frames by hand ------------------------------------------------------------------------------


def test_arming_order_heartbeat_then_one_command_without_torque(wire, drive_end):
    drive = Drive(wire.port, SETTINGS)
    drive.configure()
    drive.start()
    wire.frames.clear()
    assert drive.write(1.0, wire.advance()) == 0.0
    assert wire.frames == [(0x770, b"\x05"), (0x201, b"\x00\x00\x00\x00")]


def test_way_up_word_by_word_and_torque_only_when_enabled(wire, drive_end):
    drive = Drive(wire.port, SETTINGS)
    drive.configure()
    drive.start()
    for _ in range(5):
        tick(wire, drive, 0.21)
    assert commands(wire) == ["00 00 00 00"] + ["06 00 00 00", "07 00 00 00"] + ["07 00 00 00"] * 2
    drive.request_enable()
    written = [tick(wire, drive, 0.21) for _ in range(3)]
    # 0.21 of 0.42 Nm are 500 per mille: F4 01.
    assert commands(wire)[-3:] == ["0f 00 00 00", "0f 00 f4 01", "0f 00 f4 01"]
    assert written == [0.0, pytest.approx(0.21), pytest.approx(0.21)]


def test_torque_is_signed_and_follows_the_direction(wire, drive_end):
    drive = started(wire, drive_end, SETTINGS._replace(direction=-1))
    drive.request_enable()
    for _ in range(3):
        tick(wire, drive)
    tick(wire, drive, 0.042)
    assert commands(wire)[-1] == "0f 00 9c ff"  # -100 per mille
    wire.emit(0x181, "37 02 FF FF FF FF 32 00")  # position -1, torque +50 per mille
    wire.port.pump()
    assert drive.reading.position == pytest.approx(2.0 * math.pi / 20000)  # radians, sign turned
    assert drive.reading.torque == pytest.approx(-0.021)
    assert drive.reading.statusword == 0x0237


def test_the_position_is_metres_of_the_nut_by_the_drive_s_own_resolution(wire, drive_end):
    """A drive of 4096 counts per turn: one turn of the screw is 19.05 mm whoever counts it."""
    drive = Drive(wire.port, SETTINGS._replace(counts_per_turn=4096), per_turn=0.01905)
    drive.configure()
    drive.start()
    wire.emit(0x181, "37 02 00 10 00 00 00 00")
    wire.port.pump()
    assert drive.reading.position == pytest.approx(0.01905)


@pytest.mark.parametrize("direction", [1, -1])
def test_the_position_is_continuous_where_6064_wraps(wire, drive_end, direction):
    settings = SETTINGS._replace(direction=direction, counts_per_turn=4)
    drive = started(wire, drive_end, settings)
    places = []
    for raw in ("FE FF FF 7F", "01 00 00 80", "FD FF FF 7F"):  # 2^31 - 2, then 3 on, 4 back
        wire.emit(0x181, f"37 02 {raw} 00 00")
        wire.port.pump()
        places.append(drive.reading.position * direction / (0.5 * math.pi))
    assert [b - a for a, b in itertools.pairwise(places)] == pytest.approx([3.0, -4.0])


def test_slow_status_layout(wire, drive):
    wire.emit(0x281, "20 32 0A 05 00 00 80")
    wire.port.pump()
    assert drive.error_code == 0x3220
    assert drive.mode_display == 10
    assert drive.digital_inputs == 0x80000005


def test_heartbeat_is_sent_by_the_loop_at_its_own_pace(wire, drive):
    before = len(wire.sent(0x770))
    for _ in range(100):
        tick(wire, drive)
    assert len(wire.sent(0x770)) - before == 4  # each 25 ms
    for _ in range(100):
        wire.advance()
        wire.port.pump()
    assert len(wire.sent(0x770)) - before == 4  # a loop that does not run is silent


def test_torque_beyond_the_limit_is_cut_and_counted(wire, enabled):
    assert tick(wire, enabled, 5.0) == pytest.approx(1.6, abs=1e-3)
    assert tick(wire, enabled, -5.0) == pytest.approx(-1.6, abs=1e-3)
    assert enabled.counters["saturated"] == 2


def test_disabling_is_voltage_off_then_up_to_switched_on(wire, enabled, drive_end):
    """Voltage off coasts on every drive; to disable operation brakes as 605C says."""
    enabled.request_disable()
    assert tick(wire, enabled, 0.3) == 0.0
    assert commands(wire)[-1] == "00 00 00 00"
    assert drive_end.state == "switch on disabled"
    for _ in range(5):
        assert tick(wire, enabled, 0.3) == 0.0
    assert commands(wire)[-1] == "07 00 00 00"
    assert drive_end.state == "switched on"
    assert enabled.fault == ""


def test_enabling_again_waits_until_the_drive_has_left(wire, enabled, drive_end):
    """Else the statusword that obeys the disabling looks like an exit that nobody asked for."""
    enabled.request_disable()
    with pytest.raises(NotNow, match="still being disabled: try again"):
        enabled.request_enable()
    for _ in range(20):
        tick(wire, enabled, 0.3)
        assert enabled.leaving
    tick(wire, enabled, 0.3)
    enabled.request_enable()
    for _ in range(3):
        tick(wire, enabled, 0.3)
    assert (enabled.fault, drive_end.state) == ("", "operation enabled")


@pytest.mark.parametrize("ticks", range(4))
def test_a_disabling_before_the_drive_was_on_is_no_exit_by_itself(wire, drive, drive_end, ticks):
    """A drive that obeys some ticks late may reach operation enabled after the request."""
    late = deque([0x06] * ticks)
    obey = drive_end.command

    def obey_late(word: int) -> None:
        late.append(word)
        obey(late.popleft())

    drive_end.command = obey_late
    for _ in range(10):
        tick(wire, drive)
    for _ in range(3):
        drive.request_enable()
        tick(wire, drive)
        drive.request_disable()
        tick(wire, drive)
        while drive.refusal() and not drive.fault:
            tick(wire, drive)
    for _ in range(10):
        tick(wire, drive)
    assert drive.fault == ""


# -- torque only where it is allowed -------------------------------------------------------------


@pytest.mark.parametrize("torque", [math.nan, math.inf, -math.inf])
def test_torque_that_is_no_number_is_zero_and_a_fault(wire, enabled, torque):
    tick(wire, enabled, 0.1)
    assert tick(wire, enabled, torque) == 0.0
    assert commands(wire)[-1] == "00 00 00 00"
    assert "torque command" in enabled.fault
    assert enabled.counters["bad_torque"] == 1


@hypothesis_settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(
    st.lists(
        st.tuples(
            st.one_of(st.sampled_from(sorted(STATUSWORDS.values())), st.integers(0, 0xFFFF)),
            st.sampled_from(["", "enable", "disable", "clear"]),
            st.floats(allow_nan=True, allow_infinity=True),
        ),
        max_size=40,
    )
)
def test_whatever_the_drive_shows_torque_is_zero_unless_enabled_and_asked_for(script):
    wire = Wire("any statusword")
    try:
        end = wire.attach(ScriptedDrive(wire))
        drive = started(wire, end)
        end.answering = False
        asked = False
        for word, act, torque in script:
            if act == "enable" and not drive.refusal():
                drive.request_enable()
                asked = True
            elif act in ("disable", "clear"):
                drive.request_disable() if act == "disable" else drive.clear_fault()
                asked = False
            wire.emit(0x181, word.to_bytes(2, "little") + bytes(6))
            tick(wire, drive, torque)
            command = wire.sent(0x201)[-1]
            enabled = word & 0x6F == 0x27
            asked = asked and not drive.fault
            if not (enabled and asked and math.isfinite(torque)):
                assert command[2:] == b"\0\0"
            assert (command[0] & 0x0F == 0x0F) <= asked
    finally:
        wire.close()


# -- exits nobody asked for ----------------------------------------------------------------------


@pytest.mark.parametrize("state", sorted(set(STATUSWORDS) - {"operation enabled"}))
def test_every_exit_from_operation_enabled_is_latched(wire, enabled, drive_end, state):
    drive_end.state = state
    assert tick(wire, enabled, 0.3) == 0.0
    assert f"left operation enabled by itself, to {state}" in enabled.fault
    assert not enabled.logic.enabling
    drive_end.state = "operation enabled"
    for _ in range(5):
        assert tick(wire, enabled, 0.3) == 0.0  # nothing re-enables by itself
    assert drive_end.state == "switch on disabled"
    with pytest.raises(NotNow, match="clear the fault"):
        enabled.request_enable()


def test_statusword_older_than_ten_periods_disables(wire, enabled, drive_end):
    drive_end.answering = False
    for _ in range(10):
        tick(wire, enabled, 0.3)
        assert enabled.fault == ""
    assert enabled.state(wire.now_ns) is State.OPERATION_ENABLED
    assert tick(wire, enabled, 0.3) == 0.0
    assert commands(wire)[-1] == "00 00 00 00"
    assert enabled.state(wire.now_ns) is State.UNKNOWN
    assert "stale" in enabled.fault
    drive_end.answering = True
    assert tick(wire, enabled, 0.3) == 0.0


def test_statuswords_that_wait_unread_are_not_stale(wire, enabled, drive_end):
    for _ in range(20):  # we hang for 20 ms; the drive goes on
        wire.advance()
        drive_end.report()
    assert enabled.write(0.21, wire.now_ns) == pytest.approx(0.21)
    assert enabled.fault == ""


def test_missing_heartbeat_of_the_drive_is_latched(wire, drive):
    for _ in range(145):
        tick(wire, drive)
    assert drive.fault == ""
    for _ in range(10):
        tick(wire, drive)
    assert "heartbeat of the vertical drive is missing" in drive.fault


def test_heartbeats_keep_the_drive_healthy_and_show_a_fall_back(wire, drive):
    for n in range(1000):
        if n % 50 == 0:
            wire.emit(0x701, "05")
        tick(wire, drive)
    assert drive.fault == ""
    wire.emit(0x701, "7F")
    tick(wire, drive)
    assert "fell back to PRE-OPERATIONAL" in drive.fault


def test_enabled_drive_that_falls_back_is_stopped(wire, enabled, drive_end):
    """There it takes no commands, and not every drive then monitors their deadline, 1400:05."""
    drive_end.handle(0x000, bytes([0x80, 0x00]))  # another master, to all nodes
    drive_end.nmt.clear()
    for _ in range(30):
        tick(wire, enabled, 0.3)
    assert "stale" in enabled.fault
    assert drive_end.nmt == []
    wire.emit(0x701, "7F")
    tick(wire, enabled, 0.3)
    assert drive_end.nmt == [0x02]  # for the drive a lost connection, 6007
    wire.emit(0x701, "04")
    for _ in range(150):
        tick(wire, enabled, 0.3)
    assert drive_end.nmt == [0x02]
    enabled.clear_fault()
    tick(wire, enabled)
    assert drive_end.nmt == [0x02, 0x01]


def test_drive_in_fault_is_named_with_its_emergency(wire, enabled, drive_end):
    drive_end.fail("10 23 03 00 00 00 00 00")
    tick(wire, enabled, 0.3)
    assert "0x2310 continuous overcurrent, motor side" in enabled.fault
    assert enabled.error_code == 0x2310
    assert enabled.counters["emcy"] == 1


def test_error_code_that_comes_after_the_fault_explains_it(wire, drive, drive_end):
    drive_end.state = "fault"
    tick(wire, drive)
    assert drive.fault == "the vertical drive is in fault"
    drive_end.report_slowly(0x3220)
    tick(wire, drive)
    assert drive.fault == "the vertical drive is in fault: 0x3220 DC link undervoltage"


def test_emergency_while_enabled_stops_the_drive(wire, enabled):
    wire.emit(0x081, "10 43 08 00 00 00 00 00")
    tick(wire, enabled, 0.3)
    assert commands(wire)[-1] == "00 00 00 00"
    assert "excess temperature, drive" in enabled.fault


def test_mode_that_changes_while_enabled_stops_the_drive(wire, enabled, drive_end):
    drive_end.report_slowly(mode=8)
    assert tick(wire, enabled, 0.3) == 0.0
    assert "6061 is 8" in enabled.fault


def test_enabling_that_takes_too_long_is_given_up(wire, drive, drive_end):
    drive.request_enable()
    drive_end.command = lambda word: None
    for n in range(2100):
        if n % 50 == 0:
            wire.emit(0x701, "05")
        tick(wire, drive, 0.3)
    assert "did not reach operation enabled in 2 s, it is in switched on" in drive.fault


def test_boot_up_is_latched_and_reconfigured_on_request_only(wire, enabled, drive_end):
    drive_end.boot_up()
    drive_end.state = "switch on disabled"
    drive_end.objects[0x1016, 1] = bytes(4)
    writes = len(drive_end.writes)
    for _ in range(3):
        assert tick(wire, enabled, 0.3) == 0.0
    assert "boot-up" in enabled.fault
    assert len(drive_end.writes) == writes
    with pytest.raises(NotNow):
        enabled.request_enable()
    enabled.clear_fault()
    assert drive_end.objects[0x1016, 1] == bytes.fromhex("64 00 70 00")
    for _ in range(5):
        tick(wire, enabled, 0.3)
    assert drive_end.state == "switched on"
    assert enabled.fault == ""


# -- brake instead of coast ----------------------------------------------------------------------


def test_brake_stops_with_the_quick_stop_ramp(wire, drive_end):
    drive = started(wire, drive_end, SETTINGS._replace(stop_reaction="brake"))
    drive.request_enable()
    for _ in range(3):
        tick(wire, drive)
    tick(wire, drive, math.nan)
    assert commands(wire)[-1] == "02 00 00 00"
    tick(wire, drive)
    assert drive_end.state == "quick stop active"
    assert commands(wire)[-1] == "02 00 00 00"  # the ramp is not cut short


# -- recovery ------------------------------------------------------------------------------------


def test_recovery_is_a_rising_edge_and_ends_switched_on(wire, enabled, drive_end):
    drive_end.fail()
    tick(wire, enabled, 0.3)
    count = len(commands(wire))
    enabled.clear_fault()
    assert enabled.recovering
    for _ in range(6):
        assert tick(wire, enabled, 0.3) == 0.0
    assert commands(wire)[count : count + 4] == [
        "00 00 00 00", "80 00 00 00", "06 00 00 00", "07 00 00 00",
    ]  # fmt: skip
    assert (0x000, bytes([0x01, 0x01])) in wire.frames[-20:]
    assert drive_end.state == "switched on"
    assert (enabled.fault, enabled.recovering, enabled.logic.enabling) == ("", False, False)


def test_recovery_tries_again_while_the_cause_stands_then_gives_up(wire, enabled, drive_end):
    drive_end.fail()
    drive_end.cause_stands = True
    tick(wire, enabled)
    enabled.clear_fault()
    for n in range(2100):
        if n == 130:
            edges = [data[0] for data in wire.sent(0x201)[-130:]]
            assert edges.count(0x00) == 3  # an edge each 50 ms
        tick(wire, enabled)
    assert not enabled.recovering
    assert "does not recover, it is in fault" in enabled.fault
    drive_end.cause_stands = False
    enabled.clear_fault()
    for _ in range(6):
        tick(wire, enabled)
    assert enabled.fault == ""


# -- the bus -------------------------------------------------------------------------------------


def test_bus_that_fails_is_latched_and_raised(wire, enabled, monkeypatch):
    def refuse(message, timeout=None):
        raise can.CanOperationError("Transmit buffer full")

    with monkeypatch.context() as patch:
        patch.setattr(wire.bus, "send", refuse)
        with pytest.raises(BusError, match="Transmit buffer full"):
            enabled.write(0.3, wire.advance())
    assert "Transmit buffer full" in enabled.fault
    assert enabled.counters["bus_errors"] == 1
    assert tick(wire, enabled, 0.3) == 0.0


def test_on_a_shared_bus_somebody_elses_sync_counts(wire, drive, drive_end):
    wire.port.sync_producer = False
    wire.frames.clear()
    drive.sync(wire.now_ns)
    assert wire.frames == []
    for _ in range(3):
        wire.emit(0x080, "")
    drive_end.report()
    wire.port.pump()
    assert (drive.counters["missing"], drive.counters["unexpected"]) == (2, 0)


# -- malformed frames ----------------------------------------------------------------------------


def test_wrong_lengths_are_counted_and_not_believed(wire, enabled):
    before = enabled.reading
    for can_id, data in ((0x181, "37 02"), (0x181, ""), (0x281, "00 00 0A"), (0x281, "00" * 8)):
        wire.emit(can_id, data)
    wire.port.pump()
    assert enabled.reading is before
    assert enabled.counters["wrong_length"] == 4


def test_a_statusword_that_means_nothing_stops_the_drive(wire, enabled):
    wire.emit(0x181, "05 00 00 00 00 00 00 00")
    wire.port.pump()
    assert enabled.write(0.3, wire.now_ns) == 0.0
    assert enabled.counters["bad_statusword"] == 1
    assert "unknown" in enabled.fault


def test_missing_and_unexpected_statuswords_are_counted(wire, drive, drive_end):
    drive_end.answering = False
    for _ in range(3):
        tick(wire, drive)
    assert drive.counters["missing"] == 2  # the third may still come
    drive_end.report()
    drive_end.report()
    wire.port.pump()
    assert drive.counters["unexpected"] == 1


def test_jumps_between_states_are_counted(wire, drive, drive_end):
    drive_end.state = "switch on disabled"
    tick(wire, drive)
    drive_end.command = lambda word: None
    drive_end.state = "operation enabled"
    tick(wire, drive)
    assert drive.counters["illegal_transitions"] == 1


def test_a_recovery_that_fails_enables_nothing(wire, drive, drive_end):
    """Recovering without a fault, and a wish to enable meanwhile: neither outlives the failure."""
    drive_end.state = "fault reaction active"
    drive.clear_fault()
    with pytest.raises(NotNow, match="still recovering"):
        drive.request_enable()
    drive.logic.enable()  # had it come through all the same
    for _ in range(60):
        wire.advance(50)
        tick(wire, drive, 0.3)
    assert "does not recover" in drive.fault
    drive_end.state = "switched on"
    for _ in range(5):
        assert tick(wire, drive, 0.3) == 0.0
        assert commands(wire)[-1] == "00 00 00 00"


# -- somebody else commands the drive ------------------------------------------------------------

WALK_UP = ("06 00 00 00", "07 00 00 00", "0F 00 64 00")
"""Controlwords of a foreign master on the way to operation enabled, with 100 per mille."""


def alive(wire, drive, torque=0.0):
    """One period in which the drive's heartbeat comes."""
    wire.emit(0x701, "05")
    return tick(wire, drive, torque)


def foreign(wire, drive_end, frame):
    """A command that the drive hears and, since it is not our echo, we do as well."""
    drive_end.handle(0x201, bytes.fromhex(frame))
    wire.emit(0x201, frame)


@pytest.mark.parametrize("was_enabled", [False, True])
def test_a_foreign_command_stops_the_drive_at_once_and_for_good(
    wire, drive, drive_end, was_enabled
):
    if was_enabled:
        drive.request_enable()
        for _ in range(3):
            alive(wire, drive, 0.1)
    wire.frames.clear()
    for frame in WALK_UP * 30:
        foreign(wire, drive_end, frame)
        assert alive(wire, drive, 0.1) == 0.0
    assert "somebody else commands the vertical drive: frames 0x201" in drive.fault
    assert wire.sent(0x000)[0] == b"\x02\x01", "NMT stop: it hears no more commands"
    assert not drive_end.operational
    assert drive.counters["foreign"] == 90
    drive.clear_fault()
    for _ in range(300):
        alive(wire, drive)
    assert drive.fault == ""
    assert drive_end.operational
    drive.request_enable()


def test_a_drive_in_operation_that_nobody_enabled_is_a_fault(wire, drive, drive_end):
    """Its statusword alone tells, as where the foreign frames are not heard."""
    for k in range(25):
        for frame in WALK_UP:
            drive_end.command(int.from_bytes(bytes.fromhex(frame)[:2], "little"))
        assert drive_end.state == "operation enabled"
        alive(wire, drive)
        assert bool(drive.fault) == (k >= 20), k
    assert "in operation enabled, but nobody asked for it" in drive.fault
    assert wire.sent(0x000)[-1] == b"\x02\x01"
    assert wire.sent(0x000).count(b"\x02\x01") == 1, "no more as long as it obeys"


def test_a_drive_that_stays_enabled_in_a_fault_is_stopped_by_the_network(wire, enabled, drive_end):
    drive_end.command = lambda word: None
    enabled.write(math.nan, wire.now_ns)
    wire.frames.clear()
    for _ in range(30):
        alive(wire, enabled)
    assert wire.sent(0x000) == [b"\x02\x01"]


def test_disabling_takes_a_moment_and_is_no_fault(wire, enabled, drive_end):
    command, drive_end.command = drive_end.command, lambda word: None
    enabled.request_disable()
    for _ in range(15):
        alive(wire, enabled)
    drive_end.command = command
    for _ in range(50):
        alive(wire, enabled)
    assert enabled.fault == ""
    assert drive_end.state == "switched on"


def test_a_drive_that_brakes_when_disabled_may_take_its_time(wire, drive_end):
    drive = started(wire, drive_end, SETTINGS._replace(stop_reaction="brake"))
    drive.request_enable()
    for _ in range(3):
        alive(wire, drive)
    command, drive_end.command = drive_end.command, lambda word: None
    drive.request_disable()
    for _ in range(500):
        alive(wire, drive, 0.3)
        assert commands(wire)[-1] == "07 00 00 00"
    drive_end.command = command
    alive(wire, drive)
    assert (drive.fault, drive_end.state) == ("", "switched on")


def test_excess_torque_of_35_newtons_does_not_last(wire, enabled, drive_end):
    """0.105 Nm beyond the command, a quarter of the rated torque."""
    drive_end.given = 240
    seen = 0
    while not enabled.fault and seen < 1000:
        alive(wire, enabled)
        seen += 1
    assert seen < 40
    assert "Nm of torque" in enabled.fault


@pytest.mark.parametrize(("ticks", "lost"), [(180, False), (230, True)])
def test_a_drive_that_was_silent_may_have_restarted_and_is_configured_anew(
    wire, drive, drive_end, ticks, lost
):
    drive_end.answering = False
    for n in range(ticks):
        if n % 50 == 0:
            wire.emit(0x701, "05")
        tick(wire, drive)
    drive_end.answering = True
    assert drive.altered == lost
    assert drive.fault == ("the vertical drive was silent and may have restarted" if lost else "")
    writes = len(drive_end.writes)
    if lost:
        drive.clear_fault()
    assert (len(drive_end.writes) > writes) == lost
    for _ in range(5):
        tick(wire, drive)
    assert drive.fault == ""


MS = 1_000_000
LARGEST, LASTING = 0.1, 0.02


def noticed(asked, given, ticks=1000, period=MS):
    check = ExcessTorque(LARGEST, LASTING, period)
    return next((k for k in range(ticks) if check.check(asked, given, k * period)), None)


TOO_MUCH = [(0.0, 0.2), (0.05, 0.21), (0.05, -0.18), (-0.3, 0.1)]


@pytest.mark.parametrize(("asked", "given"), TOO_MUCH)
def test_too_much_or_the_wrong_way(asked, given):
    """It is a fault after 20 ms, or three periods where these are longer."""
    assert noticed(asked, given) == 20
    assert noticed(asked, given, period=20 * MS) == 3


@pytest.mark.parametrize(
    ("asked", "given", "ticks"), [(0.0, 0.06, 40), (0.05, 0.09, 80), (0.0, -0.03, 160)]
)
def test_less_excess_takes_longer_but_does_not_last(asked, given, ticks):
    assert noticed(asked, given) == pytest.approx(ticks, abs=1)


@pytest.mark.parametrize(
    ("asked", "given"), [(0.3, 0.0), (0.05, 0.069), (0.0, 0.019), (-0.3, -0.1), (0.05, -0.019)]
)
def test_a_weak_or_inaccurate_drive_is_no_danger(asked, given):
    """Less than asked for, or a little more, stops nothing."""
    assert noticed(asked, given, ticks=20_000) is None


def test_excess_that_comes_and_goes_does_not_last_either():
    """Every other tick, and 10 ms of each 30."""
    for on, of in ((1, 2), (10, 30)):
        check = ExcessTorque(LARGEST, LASTING, MS)
        found = [k for k in range(1000) if check.check(0.0, 0.3 * (k % of < on), k * MS)]
        assert found and found[0] < 120


def test_a_step_that_the_drive_follows_late():
    """Some ticks with the old torque now and then are no fault, and do not add up."""
    check = ExcessTorque(LARGEST, LASTING, MS)
    for k in range(0, 10_000, 100):
        assert not any(check.check(0.0, 0.3, (k + i) * MS) for i in range(15))
        assert not any(check.check(0.0, 0.0, (k + i) * MS) for i in range(15, 100))


def test_what_was_asked_a_moment_ago_may_still_be_given():
    """A drive that is 3 ms late with a fast sine gives no excess."""

    check = ExcessTorque(LARGEST, LASTING, MS)
    asked = [0.3 * math.sin(0.5 * k) for k in range(3000)]
    for k in range(3, 3000):
        assert not check.check(asked[k], asked[k - 3], k * MS)


def test_a_restart_forgets():
    check = ExcessTorque(LARGEST, LASTING, MS)
    for k in range(1000):
        if k % 19 == 0:
            check.restart()
        assert not check.check(0.0, 0.3, k * MS)
