# SPDX-License-Identifier: Apache-2.0
"""A tick on a bus that fails, or without answers: each part gets its turn all the same."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace

import pytest

from screw_module_ros.clock import ManualClock
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.torque_chain import TorqueChain
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.errors import BusError
from screw_module_ros.loop.drive import VerticalDrive
from screw_module_ros.loop.plane import JointSettings, Plane
from screw_module_ros.loop.ticker import Tick
from screw_module_ros.loop.vertical import Parts, VerticalLoop, Wires
from screw_module_ros.safety.permit import CLOSED, OPEN, PermitSettings
from screw_module_ros.samples import DriveReading, EncoderReading, ForceReading
from screw_module_ros.trials.one_thread import PERIOD_NS

MS = 1_000_000


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
    drives = [SimpleNamespace(settings=DriveSettings(), reading=None) for _ in range(2)]
    plane = Plane(drives, port, MS, PlanarSettings(), JointSettings(), PermitSettings())
    plane.request = fails if failing == "request" else lambda now: None
    plane.idle = idle.append
    plane.step()
    assert idle == [6 * MS]


def test_the_vertical_drive_is_no_other():
    idle = []
    port = SimpleNamespace(pump=fails, clock=ManualClock(5 * MS))
    device = SimpleNamespace(settings=DriveSettings())
    drive = VerticalDrive(device, port, MS, PermitSettings(), TorqueChain())
    drive.idle = idle.append
    drive.end(Tick(1, 5 * MS, 6 * MS, 0), lambda drives, now_ns: None)
    assert idle == [5 * MS]


def test_an_error_that_ends_the_loop_leaves_no_torque(enabled):
    """The drive's own deadline would end it 20 ms later; a drive without that guard never would."""
    enabled.setpoint = (enabled.home + 0.02, 0.0)
    enabled.ticks(100)
    assert abs(enabled.axis.last.command) > 0.01
    enabled.controller.count = fails_unforeseen
    with pytest.raises(ZeroDivisionError):
        enabled.tick()
    assert enabled.axis.last.command == 0.0
    assert enabled.axis.permit.phase == CLOSED


def test_a_bus_that_cannot_be_read_takes_the_torque_away(enabled, monkeypatch):
    """The drive hears our heartbeat: without a deadline it would keep the last torque."""
    enabled.setpoint = (enabled.home + 0.02, 0.0)
    enabled.ticks(100)
    port, sent = enabled.ports["drive"], []
    send = port.send

    def noted(can_id, data):
        sent.append((can_id, bytes(data)))
        send(can_id, data)

    monkeypatch.setattr(port, "send", noted)
    with monkeypatch.context() as unplugged:
        unplugged.setattr(port._arrivals, "receive", fails)
        enabled.ticks(30)
    commands = [data for can_id, data in sent if can_id == 0x201]
    assert len(commands) > 20
    assert commands[0][2:] != b"\0\0"
    assert set(commands[-10:]) == {b"\0\0\0\0"}, "disable voltage, no torque"
    rows = enabled.ticks(200)  # it can be read again
    assert all(row.reason and row.torque == 0.0 for row in rows)


def test_nor_does_one_in_the_plane(bench):
    bench.planar_setpoint = (0.05, 0.05, 0.0, 0.0)
    assert bench.enable_plane() == ""
    bench.ticks(600)
    last: list[float] = []
    for drive in bench.planar_drives:
        drive.write = partial(noting, last, drive.write)
    bench.plane.meter.tick = fails_unforeseen
    with pytest.raises(ZeroDivisionError):
        bench.tick()
    assert max(map(abs, last[:2])) > 0.1
    assert last[-2:] == [0.0, 0.0]
    assert bench.plane.permit.phase == CLOSED


def test_the_force_sensor_is_read_while_the_encoder_is_silent(bench):
    before = bench.force_sensor.counters["received"]
    bench.rig.inject("encoder", "mute", 0.0, 0.0, bench.now_ns)
    bench.ticks(50)
    assert bench.encoder.counters["missing_in_a_row"] >= 45
    assert bench.force_sensor.counters["received"] - before >= 48


def test_two_silent_sensors_hold_no_tick_up(bench):
    for device in ("encoder", "force_sensor"):
        bench.rig.inject(device, "mute", 0.0, 0.0, bench.now_ns)
    before = bench.now_ns
    bench.ticks(50)
    assert bench.now_ns - before == 50 * PERIOD_NS


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_three_lost_answers_in_a_row_stop_the_robot(enabled, lost):
    """A lost answer costs two more ticks, in which a late one would show (`devices/polled.py`)."""
    enabled.rig.inject("encoder", "drop", 1.0, lost * PERIOD_NS * 1e-9, enabled.now_ns)
    reasons = {row.reason for row in enabled.ticks(50)} - {""}
    assert reasons == ({"no fresh command"} if lost == 3 else set())
    assert enabled.torque_passes == (lost < 3)
    assert enabled.encoder.counters["missing"] == lost + 2
    assert enabled.controller.faulted == (lost == 3)
    if lost == 3:  # the way back of docs/hazards.md: no homing
        assert enabled.enable() != ""
        assert enabled.clear_fault() == ""
        enabled.controller.reset(enabled.now_ns)
        enabled.ticks(10)
        assert not enabled.controller.faulted and enabled.enable() == ""
        assert enabled.torque_passes


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
    VerticalLoop(bench.clock, PERIOD_NS, wires).step(Parts(controller=bench.controller))
    assert used == [7 if comes else 6]


def test_an_encoder_alone_waits_for_no_commands():
    """Its process has no drive: commands are another one's."""
    asked: list[int] = []
    encoder = SimpleNamespace(
        begin=lambda tick: None, answer=lambda until_ns: None, end=lambda: None
    )
    loop = VerticalLoop(ManualClock(5_000_000), 1_000_000, Wires(take_command=asked.append))
    loop.step(Parts(encoder=encoder))
    assert asked == []


class FakeDrive:
    """A drive in operation enabled whose SYNC or commands may fail."""

    fault, running, settings = "", False, DriveSettings()

    def __init__(self, label):
        self.label = label
        self.fails: set[str] = set()
        self.done: list[str] = []
        self.reading = DriveReading(0, 0x27, 0, 0.0)

    def _do(self, what):
        self.done.append(what)
        if what in self.fails:
            raise BusError(f"{self.label} {what}")

    def sync(self, now_ns):
        self._do("sync")

    def heartbeat(self, now_ns):
        self._do("heartbeat")

    def write(self, torque_nm, now_ns):
        self._do("write")
        return torque_nm

    def is_on(self, now_ns):
        return True

    def request_disable(self):
        self._do("disable")


@pytest.fixture
def axes():
    drives = (FakeDrive("shoulder drive"), FakeDrive("elbow drive"))
    port = SimpleNamespace(clock=ManualClock(102 * MS))
    made = Plane(drives, port, MS, PlanarSettings(), JointSettings(), PermitSettings())
    made.permit.supervise(True, "", 100 * MS)
    made.act(100 * MS)
    made.permit.phase, made.permit.scale = OPEN, 1.0
    for drive in drives:
        drive.done.clear()
    return made


@pytest.mark.parametrize("failing", [0, 1])
def test_both_drives_are_written_whichever_fails(axes, failing):
    drives = axes.permit.drives
    drives[failing].fails.add("write")
    with pytest.raises(BusError, match=drives[failing].label):
        axes.act(101 * MS)
    assert [drive.done for drive in drives] == [["write"]] * 2
    assert len(axes.written) == 2


def test_the_first_error_is_the_one_raised(axes):
    for drive in axes.permit.drives:
        drive.fails.add("write")
    with pytest.raises(BusError, match="shoulder drive write"):
        axes.idle(101 * MS)


def test_the_heartbeat_goes_out_without_a_sync(axes):
    axes.permit.drives[0].fails.add("sync")
    with pytest.raises(BusError, match="sync"):
        axes.request(101 * MS)
    assert [drive.done[-1] for drive in axes.permit.drives] == ["heartbeat"] * 2


def test_after_the_end_the_gate_is_closed_and_the_next_start_finds_no_fault(axes):
    """Deactivated while enabled, activated again later: nothing is latched."""

    assert axes.permit.enabled
    assert axes.shutdown() == ""
    assert not axes.permit.enabled and axes.permit.reason == "not enabled"
    axes.idle(9000 * MS)
    assert not axes.permit.faulted
