# SPDX-License-Identifier: Apache-2.0
"""Scripted runs of the whole robot, judged bit for bit by digests of their samples.

Drivers, loops, laws and rig run as in the nodes: in one process, in three, and with faults of the
devices. A rewrite that changes the last bit of one sample,
the tick of one reaction or one reason shows here, with the first phase that differs. Who changes a
law or a limit on purpose writes the new digests (`make test ARGS="test/loop/test_scripted_run.py
--write"`) and says in the commit what changed.
"""

from __future__ import annotations

import hashlib
import math
import struct
from collections import deque
from functools import partial

import pytest

from screw_module_ros.control.laws import variants
from screw_module_ros.control.modes import FORCE_FEEDBACK, OFF
from screw_module_ros.loop.vertical import Roles, VerticalLoop, Wires
from screw_module_ros.plant.world import ArmSettings
from screw_module_ros.trials.one_thread import PERIOD_NS, OneThreadRobot

_STROKE = ArmSettings(kind="active", amplitude=(0.05, 0.04, 0.08), omega=(3.0, 2.0, 4.0))


def scripted_run():
    """Yield the name and the digest of each phase."""
    bench = OneThreadRobot(seed=3)
    try:
        for number, (name, phase) in enumerate(_phases(bench)):
            begin = len(bench.rows)
            phase()
            yield f"{number} {name}", _digest(bench, begin)
    finally:
        bench.close()


def _phases(bench: OneThreadRobot):
    yield "ready", bench.ready
    yield "enabled", lambda: _enabled(bench)
    bench.world.set_arm(_STROKE)
    bench.setpoint = (0.22, 0.05)
    bench.planar_setpoint = (0.06, -0.05, 0.02, 0.0)
    for mode in (*variants(), OFF, FORCE_FEEDBACK):
        yield f"mode {mode}", lambda mode=mode: _moved(bench, mode)
    bench.rig.inject("encoder", "freeze", 0.0, 0.0, bench.now_ns)
    yield "encoder frozen", lambda: bench.seconds(0.3)
    bench.rig.inject("encoder", "clear", 0.0, 0.0, bench.now_ns)
    yield "recovered", lambda: _recovered(bench)
    bench.permitted = False
    yield "not permitted", lambda: bench.seconds(0.2)


def _enabled(bench: OneThreadRobot) -> None:
    bench.controller.mode = 1
    bench.planar_setpoint = (0.0, 0.0, 0.0, 0.0)
    begin = len(bench.rows)
    assert bench.enable() == ""
    _until(bench, begin + 200)
    assert bench.enable_plane() == ""
    _until(bench, begin + 600)


def _moved(bench: OneThreadRobot, mode: int) -> None:
    bench.controller.mode = mode
    bench.seconds(0.5)


def _recovered(bench: OneThreadRobot) -> None:
    begin = len(bench.rows)
    bench.encoder.clear_fault()
    assert bench.clear_fault() == ""
    bench.controller.reset(bench.now_ns)
    _until(bench, begin + 400)


def _until(bench: OneThreadRobot, ticks: int) -> None:
    """Go on until this many ticks in all, however soon a service has answered."""
    assert len(bench.rows) <= ticks
    bench.ticks(ticks - len(bench.rows))


def _digest(bench: OneThreadRobot, begin: int) -> str:
    """Return the digest of all rows from `begin` on, and of what was counted and told by then."""
    digest, plane = hashlib.sha256(), bench.plane
    for row in bench.rows[begin:]:
        numbers = (0.0 if math.isnan(each) else each for each in (*row[:6], *row.plane))
        digest.update(struct.pack("<8d", *numbers) + f"{row.reason}|{row.plane_reason}".encode())
    meters = [(m.samples, m.late, m.lost, m.histogram) for m in
              (bench.controller.meter, bench.axis.meter, plane.meter)]  # fmt: skip
    counted = [device.counters for device in bench.devices[:2]]
    sensors = [(part.answers, part.skipped) for part in bench.roles[:2]]
    shown = bench.axis.own, bench.axis.last, plane.controller.output, plane.controller.homed
    digest.update(repr((meters, counted, sensors, shown)).encode())
    return digest.hexdigest()[:16]


class Apart:
    """Sensors, controller and drive as three processes, one after the other; all calls noted."""

    def __init__(self, bench: OneThreadRobot):
        self.bench, self.lines = bench, []
        self.samples, self.forces, self.commands = deque(), deque(), deque()
        encoder, force_sensor, controller, drive = bench.roles
        self.processes = [
            (self._loop(), Roles(encoder, force_sensor)),
            (self._loop(), Roles(controller=controller)),
            (self._loop(), Roles(drive=drive)),
        ]

    def _loop(self) -> VerticalLoop:
        wires = Wires(
            take_sample=partial(self._taken, self.samples),
            take_force=partial(self._taken, self.forces),
            take_command=partial(self._taken, self.commands),
            publish_sample=partial(self._sent, self.samples),
            publish_force=partial(self._sent, self.forces),
            publish_command=self._command,
            read_inputs=self._inputs,
            permission=self._permission,
            publish_controller_state=partial(self._note, "controller"),
            publish_drive_state=partial(self._note, "drive"),
        )
        return VerticalLoop(self.bench.clock, PERIOD_NS, wires)

    def rounds(self, count: int) -> None:
        for _ in range(count):
            for loop, parts in self.processes:
                loop.step(parts)
            self.bench.rig.process(self.bench.now_ns)

    def digest(self) -> str:
        lines, self.lines = self.lines, []
        return hashlib.sha256(repr(lines).encode()).hexdigest()[:16]

    def _note(self, *what) -> None:
        self.lines.append((self.bench.now_ns, *what))

    def _taken(self, queue: deque, until_ns: int):
        self._note("waits", until_ns)
        return queue.popleft() if queue else None

    def _sent(self, queue: deque, one) -> None:
        self._note(one)
        queue.append(one)

    def _command(self, behind, output, mode, activation) -> None:
        self._note(behind.sequence, output, mode)
        self.commands.append((behind.sequence, behind.monotonic_ns, output.force, mode, activation))

    def _inputs(self, now_ns: int) -> None:
        axis, controller = self.bench.axis, self.bench.controller
        self._note("inputs", axis.last, axis.skipped, axis.meter.late, axis.meter.lost)
        controller.on_drive(axis.permit.enabled, axis.position, now_ns)
        controller.wanted.ask((0.22,), (0.05,), now_ns)

    def _permission(self, permit, now_ns: int) -> None:
        self._note("permission", permit.reason)
        permit.supervise(True, "", now_ns)


def apart_run():
    """Yield the name and the digest of each phase with three processes."""
    bench = OneThreadRobot(seed=4)
    try:
        bench.ready()
        bench.controller.mode = 2
        apart, rig = Apart(bench), bench.rig
        apart.rounds(20)
        assert bench.axis.permit.open(bench.now_ns) == ""
        apart.rounds(150)
        yield "work", apart.digest()
        for device, fault, size in (
            ("force_sensor", "delay", 0.4), ("encoder", "mute", 0.0), ("force_sensor", "mute", 0.0),
            ("drive", "mute", 0.0),
        ):  # fmt: skip
            rig.inject(device, fault, size, 0.0, bench.now_ns)
            apart.rounds(4)
            yield f"{device} {fault}, 4 ticks", apart.digest()
            apart.rounds(30)
            rig.inject(device, "clear", 0.0, 0.0, bench.now_ns)
            bench.controller.reset(bench.now_ns)
            apart.rounds(10)
            yield f"{device} {fault} and back", apart.digest()
        bench.clock.time_ns += 3_400_000
        apart.rounds(10)
        yield "an overrun", apart.digest()
    finally:
        bench.close()


FAULTS = [
    ("force_sensor", "delay", 0.4), ("force_sensor", "mute", 0.0), ("force_sensor", "status", 4.0),
    ("encoder", "delay", 0.7), ("encoder", "mute", 0.0), ("encoder", "drop", 0.3),
    ("encoder", "jump", 0.0), ("encoder", "noise", 5.0), ("drive", "mute", 0.0),
    ("drive", "reset", 0.0), ("drive", "fault", 0.0), ("drive", "emcy", 0.0),
    ("shoulder", "fault", 0.0), ("elbow", "drop", 0.4), ("elbow", "cable_out", 0.0),
    ("shoulder", "reset", 0.0), ("shoulder", "position_freeze", 0.0),
]  # fmt: skip


def fault_run(device: str, fault: str, size: float):
    """Yield the digest of a short fault in motion, of a long one, and what the mend answered."""
    bench = OneThreadRobot(seed=5)
    try:
        bench.ready()
        _enabled(bench)
        bench.controller.mode = 4
        bench.world.set_arm(_STROKE)
        bench.setpoint, bench.planar_setpoint = (0.22, 0.05), (0.06, -0.05, 0.02, 0.0)
        bench.plane.controller.settings = bench.plane.controller.settings._replace(stiffness=400.0)
        begin = len(bench.rows)
        bench.ticks(150)
        for name, ticks in (("for 3 ticks", 3), ("for 150 ticks", 150)):
            bench.rig.inject(device, fault, size, 0.0, bench.now_ns)
            bench.ticks(ticks)
            bench.rig.inject(device, "clear", 0.0, 0.0, bench.now_ns)
            bench.ticks(40)
            yield name, _digest(bench, begin)
            begin = len(bench.rows)
        bench.encoder.clear_fault()
        answers = bench.clear_fault(), bench.clear_plane_fault()
        bench.controller.reset(bench.now_ns)
        _until(bench, begin + 400)
        answers += bench.enable(), bench.enable_plane()
        _until(bench, begin + 600)
        yield "mended", f"{answers}, {bench.rows[-1].reason}: {_digest(bench, begin)}"
    finally:
        bench.close()


RUNS = {
    "the robot": scripted_run,
    "three processes": apart_run,
    **{f"{device} {fault}": partial(fault_run, device, fault, size)
       for device, fault, size in FAULTS},
}  # fmt: skip


@pytest.mark.parametrize("name", RUNS)
def test_every_phase_is_the_same_bit_for_bit(name, kept):
    kept(dict(RUNS[name]()))
