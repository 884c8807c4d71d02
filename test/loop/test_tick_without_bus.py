# SPDX-License-Identifier: Apache-2.0
"""A tick on a bus that fails, or without answers: each part gets its turn all the same."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from unittest.mock import Mock

import pytest
from loop_parts import MS, S, open_axis

from screw_module_ros.clock import ManualClock
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.errors import BusError
from screw_module_ros.loop.plane import Plane
from screw_module_ros.loop.plane_controller import JointSettings
from screw_module_ros.loop.ticker import Tick
from screw_module_ros.loop.vertical import Roles, VerticalLoop, Wires
from screw_module_ros.safety.permit import CLOSED, OPEN, PermitSettings
from screw_module_ros.samples import DriveReading, EncoderReading, ForceReading
from screw_module_ros.trials.one_thread import PERIOD_NS


def fails(*_):
    raise BusError("the cable is out")


def noting(seen, write, torque, now_ns):
    seen.append(torque)
    return write(torque, now_ns)


def fails_unforeseen(*_):
    raise ZeroDivisionError


@pytest.mark.parametrize("failing", ["request", "pump"])
def test_an_error_before_the_writes_does_not_skip_them(failing):
    idle = []
    port = SimpleNamespace(pump=fails, clock=ManualClock(5 * MS))
    drive = SimpleNamespace(brakes=False, settings=DriveSettings(), label="drive", reading=None)
    drives = drive, drive
    plane = Plane(drives, port, MS, PlanarSettings(), JointSettings(), PermitSettings())
    plane.drives.request = fails if failing == "request" else lambda now: None
    plane.zero_without_answers = idle.append
    plane.step()
    assert idle == [6 * MS]


def test_the_vertical_drive_is_no_other():
    idle, drive = [], open_axis([])
    drive._port.pump, drive.serve_without_command = fails, idle.append
    drive.end(Tick(1, S, S + MS, 0), lambda drives, now_ns: None)
    assert idle == [S]


@pytest.fixture
def pressing(enabled):
    """Return a robot whose vertical axis presses against its spring."""
    enabled.setpoint = (enabled.home + 0.02, 0.0)
    enabled.ticks(100)
    assert abs(enabled.axis.last.command) > 0.01
    return enabled


def test_an_error_that_ends_the_loop_leaves_no_torque(pressing):
    """The drive's own deadline would end it 20 ms later; a drive without that guard never would."""
    pressing.controller.count = fails_unforeseen
    with pytest.raises(ZeroDivisionError):
        pressing.tick()
    assert pressing.axis.last.command == 0.0
    assert pressing.axis.permit.phase == CLOSED


def test_a_bus_that_cannot_be_read_takes_the_torque_away(pressing, monkeypatch):
    """The drive hears our heartbeat: without a deadline it would keep the last torque."""
    port, sent = pressing.ports["drive"], []
    send = port.send

    def noted(can_id, data):
        sent.append((can_id, bytes(data)))
        send(can_id, data)

    monkeypatch.setattr(port, "send", noted)
    with monkeypatch.context() as unplugged:
        unplugged.setattr(port._arrivals, "receive", fails)
        pressing.ticks(30)
    commands = [data for can_id, data in sent if can_id == 0x201]
    assert len(commands) > 20
    assert commands[0][2:] != b"\0\0"
    assert set(commands[-10:]) == {b"\0\0\0\0"}, "disable voltage, no torque"
    rows = pressing.ticks(200)  # it can be read again
    assert all(row.reason and row.torque == 0.0 for row in rows)


def test_nor_does_one_in_the_plane(bench, plane):
    bench.planar_setpoint = (0.05, 0.05, 0.0, 0.0)
    bench.ticks(600)
    last: list[float] = []
    for drive in bench.planar_drives:
        drive.write = partial(noting, last, drive.write)
    plane.meter.tick = fails_unforeseen
    with pytest.raises(ZeroDivisionError):
        bench.tick()
    assert max(map(abs, last[:2])) > 0.1
    assert last[-2:] == [0.0, 0.0]
    assert plane.drives.permit.phase == CLOSED


def test_a_silent_sensor_holds_neither_the_other_nor_a_tick_up(bench):
    received, begin_ns = bench.force_sensor.counters["received"], bench.now_ns
    bench.rig.inject("encoder", "mute", 0.0, 0.0, bench.now_ns)
    bench.ticks(50)
    assert bench.encoder.counters["missing_in_a_row"] >= 45
    assert bench.force_sensor.counters["received"] - received >= 48
    bench.rig.inject("force_sensor", "mute", 0.0, 0.0, bench.now_ns)
    bench.ticks(50)
    assert bench.now_ns - begin_ns == 100 * PERIOD_NS


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_three_lost_answers_in_a_row_stop_the_robot(enabled, lost):
    """A lost answer costs two more ticks, in which a late one would show (`devices/polled.py`)."""
    enabled.rig.inject("encoder", "drop", 1.0, lost * PERIOD_NS * 1e-9, enabled.now_ns)
    reasons = {row.reason for row in enabled.ticks(50)} - {""}
    assert reasons == ({"no fresh command"} if lost == 3 else set())
    assert enabled.axis.permit.enabled == (lost < 3)
    assert enabled.encoder.counters["missing"] == lost + 2
    assert enabled.controller.faulted == (lost == 3)
    if lost == 3:  # the way back of docs/hazards.md: no homing
        assert enabled.enable() != ""
        assert enabled.clear_fault() == ""
        enabled.controller.reset(enabled.now_ns)
        enabled.ticks(10)
        assert not enabled.controller.faulted and enabled.enable() == ""
        assert enabled.axis.permit.enabled


@pytest.mark.parametrize("comes", [True, False])
def test_a_controller_alone_waits_for_the_force_of_the_encoders_tick(bench, monkeypatch, comes):
    """It comes a moment later than the position; where it does not, the older one is used."""
    old, new = (ForceReading(n, n * MS, n * MS, *(0.0,) * 6, 0) for n in (6, 7))
    used: list[int] = []
    monkeypatch.setattr(bench.controller, "on_force", lambda force, _: used.append(force.sequence))
    wires = Wires(
        take_sample=lambda until_ns: EncoderReading(7, 7 * MS, 7 * MS, 0, 0.1, 0.0, True),
        take_force=lambda until_ns: old if until_ns == 0 else new if comes else None,
    )
    VerticalLoop(bench.clock, PERIOD_NS, wires).step(Roles(controller=bench.controller))
    assert used == [7 if comes else 6]


def test_an_encoder_alone_waits_for_no_commands():
    """Its process has no drive: commands are another one's."""
    asked: list[int] = []
    loop = VerticalLoop(ManualClock(5 * MS), MS, Wires(take_command=asked.append))
    loop.step(Roles(encoder=Mock()))
    assert asked == []


def fake_drive(label):
    """Return a drive in operation enabled; its methods can be made to fail."""
    reading = DriveReading(0, 0x27, 0, 0.0)
    drive = Mock(label=label, fault="", running=False, settings=DriveSettings(), reading=reading)
    drive.is_on.return_value = True
    drive.write.side_effect = lambda torque_nm, now_ns: torque_nm
    return drive


@pytest.fixture
def axes():
    drives = fake_drive("shoulder drive"), fake_drive("elbow drive")
    port = SimpleNamespace(clock=ManualClock(102 * MS))
    made = Plane(drives, port, MS, PlanarSettings(), JointSettings(), PermitSettings())
    made.drives.permit.supervise(True, "", 100 * MS)
    made.act(100 * MS)
    made.drives.permit.phase, made.drives.permit.scale = OPEN, 1.0
    for drive in drives:
        drive.write.reset_mock()
    return made


@pytest.mark.parametrize("writes", ["act", "zero_without_answers"])
@pytest.mark.parametrize(
    ("failing", "raised"), [((0,), "shoulder"), ((1,), "elbow"), ((0, 1), "shoulder")]
)
def test_both_drives_are_written_whichever_fails(axes, writes, failing, raised):
    """The first error is the one raised."""
    drives = axes.drives.permit.drives
    for number in failing:
        drives[number].write.side_effect = BusError(f"{drives[number].label} write")
    with pytest.raises(BusError, match=f"{raised} drive write"):
        getattr(axes, writes)(101 * MS)
    assert [drive.write.call_count for drive in drives] == [1, 1]
    assert len(axes.drives.written) == 2


def test_the_heartbeat_goes_out_without_a_sync(axes):
    axes.drives.permit.drives[0].sync.side_effect = BusError("sync")
    with pytest.raises(BusError, match="sync"):
        axes.drives.request(101 * MS)
    assert all(drive.heartbeat.called for drive in axes.drives.permit.drives)


def test_after_the_end_the_gate_is_closed_and_the_next_start_finds_no_fault(axes):
    """Deactivated while enabled, activated again later: nothing is latched."""
    assert axes.drives.permit.enabled
    assert axes.drives.shutdown() == ""
    assert not axes.drives.permit.enabled and axes.drives.permit.reason == "not enabled"
    axes.zero_without_answers(9000 * MS)
    assert not axes.drives.permit.faulted
