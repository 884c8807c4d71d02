# SPDX-License-Identifier: Apache-2.0
"""The drive driver where values vary: any statusword, any guard, any limit; two drives on a bus."""

from __future__ import annotations

import math

import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scripted import Wire, unsigned
from scripted_devices import STATUSWORDS, ScriptedDrive
from talk import DRIVE, Talk, converse

from screw_module_ros.devices import drive_group
from screw_module_ros.devices.canopen import Heartbeat
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_logic import ExcessTorque
from screw_module_ros.devices.drive_settings import WAIVABLE
from screw_module_ros.devices.drive_setup import rated_torque
from screw_module_ros.devices.errors import WrongDevice

MS = 1_000_000
GUARDS = ("1016:01", "1017:00", "1400:05", "6007:00", "605A:00", "605E:00", "6072:00")


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
        talk = Talk(wire, "drive", [])
        drive, talk.device.answering, asked = talk.driver, False, False
        for word, act, torque in script:
            if act == "enable" and not drive.refusal():
                drive.request_enable()
                asked = True
            elif act in ("disable", "clear"):
                drive.request_disable() if act == "disable" else drive.clear_fault()
                asked = False
            wire.emit(0x181, word.to_bytes(2, "little") + bytes(6))
            talk.run("1", str(torque))
            command = wire.sent(0x201)[-1]
            asked = asked and not drive.fault
            if not (word & 0x6F == 0x27 and asked and math.isfinite(torque)):
                assert command[2:] == b"\0\0"
            assert (command[0] & 0x0F == 0x0F) <= asked
    finally:
        wire.close()


@pytest.mark.parametrize("state", sorted(set(STATUSWORDS) - {"operation enabled"}))
def test_every_exit_from_operation_enabled_is_latched(wire, state):
    converse(
        Talk(wire, "enabled_drive", []),
        f"let state {state}",
        "run 1 0.3 = *201 00 00 00 00; see written = 0",
        f"see fault = *left operation enabled by itself, to {state}*; see logic.enabling = False",
        "let state operation enabled",
        "5 x run 1 0.3; see written = 0",  # nothing enables it again by itself
        "see device.state = switch on disabled",
        "cannot request_enable = NotNow: *clear the fault*",
    )


# -- guards and limits -----------------------------------------------------------------------------


@pytest.mark.parametrize("key", GUARDS)
@pytest.mark.parametrize("how", ["refuse", "deafen", "remove"])
def test_drive_without_a_guard_is_not_enabled(wire, key, how):
    talk = Talk(wire, "new_drive", [])
    talk.object(key, "07" * (len(talk.read(key)) // 2))
    getattr(talk, how)(key)
    talk.begin()
    assert talk.driver.warnings[0].startswith("UNGUARDED")
    assert key[:4] in talk.driver.warnings[0]
    refusal = talk.cannot("request_enable")
    assert key[:4] in refusal
    assert ("allow_no_heartbeat" in refusal) == (key == "1016:01")


def test_no_heartbeat_watch_is_enabled_by_its_own_switch_alone(wire):
    talk = Talk(wire, "new_drive", [f"waived={','.join(WAIVABLE)}"])
    talk.remove("1016:01")
    talk.begin()
    assert "only `allow_no_heartbeat`" in talk.cannot("request_enable")


@pytest.mark.parametrize(
    ("raw", "expected"), [(420, 0.42), (420_000, 0.42), (423, 0.42), (12_000, 12.0), (5, 0.005)]
)
def test_rated_torque_in_either_unit(raw, expected):
    assert rated_torque(raw, expected, "drive") == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("raw", [0, 42, 4200, 42_000, 430, 0xFFFFFFFF])
def test_another_rated_torque_is_refused(raw):
    with pytest.raises(WrongDevice, match=r"rated_torque is 0\.42 Nm"):
        rated_torque(raw, 0.42, "drive")


@pytest.mark.parametrize(
    ("torque", "rated", "per_mille"),
    [(1.6, 0.42, 3810), (0.42, 0.42, 1000), (0.2881, 0.42, 686), (25.0, 10.0, 2500), (0.0, 1.0, 0),
     (100.0, 0.42, 32767)],
)  # fmt: skip
@pytest.mark.parametrize("direction", [1, -1])
def test_own_limit_lets_every_command_of_ours_pass(wire, torque, rated, per_mille, direction):
    settings = [f"max_torque={torque}", f"rated_torque={rated}", f"direction={direction}"]
    talk = Talk(wire, "new_drive", settings)
    talk.device.objects[0x6076, 0] = unsigned(round(rated * 1e3), 4)
    talk.begin()
    talk.enable()
    assert int.from_bytes(talk.device.objects[0x6072, 0], "little") == per_mille
    for sign in (1, -1):
        talk.write(str(1e3 * sign))
        assert per_mille - 1 <= sign * direction * talk.device.torque <= per_mille


# -- two drives on a bus ---------------------------------------------------------------------------


@pytest.fixture
def two(wire):
    """Return the scripted ends 3 and 4, and their drives with one heartbeat for both."""
    ends = [wire.attach(ScriptedDrive(wire, node)) for node in (3, 4)]
    beat = Heartbeat(wire.port, 113, 0.025)
    each = [DRIVE._replace(node_id=node, master_id=113) for node in (3, 4)]
    return ends, [Drive(wire.port, settings, "drive", beat) for settings in each]


def tick_both(wire, drives, ticks):
    """Periods of both drives without torque."""
    for _ in range(ticks):
        now_ns = wire.advance()
        drives[0].sync(now_ns)
        wire.port.pump()
        for drive in drives:
            drive.heartbeat(now_ns)
            drive.write(0.0, now_ns)


def test_two_drives_share_a_heartbeat_and_leave_together(wire, two):
    ends, drives = two
    drive_group.start(drives)
    tick_both(wire, drives, 100)
    assert [end.state for end in ends] == ["switched on"] * 2
    assert len(wire.sent(0x771)) < 8
    assert drive_group.leave(drives, wire.port) == ""
    assert [end.objects[0x1016, 1] for end in ends] == [bytes(4)] * 2


def test_both_drives_of_a_bus_are_configured_before_either_starts(wire, two):
    ends, drives = two
    drive_group.start(drives)
    tick_both(wire, drives, 5)
    assert drive_group.leave(drives, wire.port) == ""
    wire.frames.clear()
    assert drive_group.start(drives) == drives
    assert [data[0] for data in wire.sent(0x000)] == [0x80, 0x80, 0x01, 0x01]
    assert [end.objects[0x1400, 5] for end in ends] == [b"\x14\x00"] * 2


# -- torque in excess of the command ---------------------------------------------------------------


def noticed(asked, given, ticks=1000, period=MS):
    """Return the first tick at which torques, by the tick, are too much; None for never."""
    check = ExcessTorque(0.1, 0.02, period)
    return next((k for k in range(ticks) if check.check(asked(k), given(k), k * period)), None)


@pytest.mark.parametrize(
    ("asked", "given", "ticks"),
    [
        (0.0, 0.2, 20), (0.05, 0.21, 20), (0.05, -0.18, 20), (-0.3, 0.1, 20),  # far too much
        (0.0, 0.06, 40), (0.05, 0.09, 80), (0.0, -0.03, 160),  # less takes longer
        (0.3, 0.0, None), (0.05, 0.069, None), (0.0, 0.019, None), (-0.3, -0.1, None),
        (0.05, -0.019, None),  # a weak or inaccurate drive is no danger
    ],
)  # fmt: skip
def test_too_much_or_the_wrong_way_does_not_last(asked, given, ticks):
    found = noticed(lambda k: asked, lambda k: given, ticks=20_000)
    assert found == (ticks if ticks in (None, 20) else pytest.approx(ticks, abs=1))
    if ticks == 20:
        assert noticed(lambda k: asked, lambda k: given, period=20 * MS) == 3


@pytest.mark.parametrize(("on", "of"), [(1, 2), (10, 30)])
def test_excess_that_comes_and_goes_does_not_last_either(on, of):
    found = noticed(lambda k: 0.0, lambda k: 0.3 * (k % of < on))
    assert found is not None and found < 120


def test_torque_that_follows_late_is_no_excess():
    """Some ticks with the old torque now and then do not add up; nor does a sine 3 ms late."""
    assert noticed(lambda k: 0.0, lambda k: 0.3 * (k % 100 < 15), ticks=10_000) is None
    sine = [0.3 * math.sin(0.5 * k) for k in range(-3, 3000)]
    assert noticed(lambda k: sine[k + 3], lambda k: sine[k], ticks=3000) is None


def test_a_restart_of_the_check_forgets():
    check = ExcessTorque(0.1, 0.02, MS)
    for k in range(1000):
        if k % 19 == 0:
            check.restart()
        assert not check.check(0.0, 0.3, k * MS)
