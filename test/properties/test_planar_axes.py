# SPDX-License-Identifier: Apache-2.0
"""The plane: law, gate and both drivers against two drives and an operator that do anything.

Every command frame is judged by what both drives had shown and what the operator had asked for.
"""

from __future__ import annotations

import itertools
import math
from contextlib import suppress

from anything import MS, absurd, fixed, live_changes, near
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule
from scripted import Wire, unsigned
from scripted_devices import STATUSWORDS, ScriptedDrive

from screw_module_ros.clock import ManualClock
from screw_module_ros.control.limits import LONGEST_STEP
from screw_module_ros.control.planar_settings import STUDIED_GAIN, PlanarSettings
from screw_module_ros.devices.canopen import Heartbeat
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.errors import DeviceError
from screw_module_ros.loop import gate
from screw_module_ros.loop.plane import Plane
from screw_module_ros.loop.plane_controller import JointSettings
from screw_module_ros.loop.requests import Requests
from screw_module_ros.safety.permit import CLOSED, OPEN, PermitSettings

PERIOD_NS = 2 * MS
NODES = (3, 4)
GATE, LAW, JOINTS = PermitSettings(), PlanarSettings(force_gain=STUDIED_GAIN), JointSettings()
LARGEST = (LAW.shoulder_torque, LAW.elbow_torque)
PER_MILLE = 10.0 / 1000.0
ROUNDING = 1e-9
FRESH_NS = 10 * PERIOD_NS
REFUSAL_NS = 200 * MS
DRIVES = DriveSettings(
    master_id=113, rate=500.0, rated_torque=10.0, max_torque=25.0, enable_timeout=0.1, listen=0.0,
    sdo_timeout=0.02, counts_per_turn=65536,
)  # fmt: skip
COUNT = 2.0 * math.pi / DRIVES.counts_per_turn  # [rad]
names = (f"planar axes {number}" for number in itertools.count())

which = st.integers(0, 1)
words = st.one_of(st.sampled_from(sorted(STATUSWORDS.values())), st.integers(0, 0xFFFF))
cob_ids = (0x080, 0x083, 0x084, 0x183, 0x184, 0x283, 0x284, 0x703, 0x704, 0x000)
garbage = st.tuples(st.sampled_from(cob_ids), st.binary(max_size=8))
places, speeds = near(-0.3, 0.3), near(-1.0, 1.0)
setpoints = st.one_of(st.tuples(places, places, speeds, speeds), st.tuples(*[absurd] * 4))


class Waits(ManualClock):
    """The clock of a service: while it waits, the loop ticks."""

    def __init__(self, machine: PlanarAxesMachine):
        self.machine = machine

    def now_ns(self) -> int:
        return self.machine.wire.now_ns

    def sleep_until(self, due_ns: int) -> None:
        self.machine.requests.serve()
        self.machine.work(1)


class PlanarAxesMachine(RuleBasedStateMachine):
    """Two drives on a wire, the axes, and an operator whose wishes are kept count of."""

    @initialize(setpoint=st.tuples(st.floats(0.1, 0.19), st.floats(0.1, 0.2)))
    def begin(self, setpoint):
        self.wire = Wire(next(names))
        self.ends = [self.wire.attach(ScriptedDrive(self.wire, node)) for node in NODES]
        beat = Heartbeat(self.wire.port, DRIVES.master_id, DRIVES.heartbeat_period)
        self.drives = tuple(
            Drive(self.wire.port, DRIVES._replace(node_id=node), f"drive {node}", beat)
            for node in NODES
        )
        for end, drive in zip(self.ends, self.drives, strict=True):
            end.objects[0x6076, 0] = unsigned(10_000, 4)
            drive.configure()
            drive.start()
        self.axes = Plane(self.drives, self.wire.port, PERIOD_NS, LAW, JOINTS, GATE)
        self.requests = Requests(Waits(self))
        self.shown, self.shown_ns = [0, 0], [0, 0]
        for index, node in enumerate(NODES):
            self.wire.port.subscribe(0x180 + node, lambda data, at, i=index: self.see(i, data, at))
        self.wire.frames.clear()
        self.asked = self.permitted = False
        self.safety_ns, self.refused_ns = 0, -REFUSAL_NS
        self.beat_ns = 0
        self.open_ns: int | None = None
        self.acted_ns = self.wire.now_ns
        self.torques = (0.0, 0.0)
        self.speeds = [0, 0]
        self.setpoint = (*setpoint, 0.0, 0.0)
        self.bring_up()
        self.work(60)
        drives = self.axes.drives
        assert drives.permit.enabled and any(abs(torque) > 0.1 for torque in drives.written)

    def teardown(self):
        if hasattr(self, "wire"):
            self.wire.close()

    def see(self, index: int, data: bytes, arrival_ns: int) -> None:
        if len(data) == 8:
            self.shown[index] = int.from_bytes(data[:2], "little")
            self.shown_ns[index] = arrival_ns

    # One tick, as the node does it ---------------------------------------------------------

    def tick(self, periods: float = 1.0) -> None:
        now_ns = self.wire.advance(periods * PERIOD_NS / MS)
        self.far_ends(now_ns)
        self.axes.drives.request(now_ns)
        self.wire.port.pump()
        faulty = any(drive.fault for drive in self.drives)
        self.answered = self.axes.drives.answered(now_ns)
        if self.answered:
            self.axes.controller.wanted.ask(self.setpoint[:2], self.setpoint[2:], now_ns)
            self.axes.act(now_ns)
        else:
            self.axes.zero_without_answers(now_ns)
        self.judge_law(now_ns)
        self.judge(faulty)

    def far_ends(self, now_ns: int) -> None:
        beat = now_ns - self.beat_ns >= 20 * MS
        for end, speed in zip(self.ends, self.speeds, strict=True):
            end.position = (end.position + speed + (1 << 31)) % (1 << 32) - (1 << 31)
            if beat and end.answering:
                self.wire.emit(0x700 + end.node_id, "05" if end.operational else "7F")
        self.beat_ns = now_ns if beat else self.beat_ns

    def judge_law(self, now_ns: int) -> None:
        """Look at what is asked for before gate and drives."""
        output = self.axes.controller.output if self.answered else None
        elapsed = min((now_ns - self.acted_ns) * 1e-9, LONGEST_STEP)
        torques = (output.shoulder_torque, output.elbow_torque) if output else (0.0, 0.0)
        assert output is None or all(map(math.isfinite, output))
        steps = [abs(new - old) for new, old in zip(torques, self.torques, strict=True)]
        assert torques == (0.0, 0.0) or max(steps) <= LAW.torque_rate * elapsed + ROUNDING
        assert all(abs(new) <= most for new, most in zip(torques, LARGEST, strict=True))
        self.torques = torques
        self.acted_ns = now_ns if output else self.acted_ns

    def judge(self, faulty: bool) -> None:
        """Look at what stands on the wire. faulty: a drive was, before the command went out."""
        axes, now_ns = self.axes, self.wire.now_ns
        phase = axes.drives.permit.phase
        self.open_ns = (self.open_ns or now_ns) if phase == OPEN else None
        since = (now_ns - self.open_ns) * 1e-9 if self.open_ns else 0.0
        if faulty or axes.drives.permit.fault.reason or not self.permitted:
            self.asked = False  # only another wish may open it again
        may_pass = (
            phase == OPEN and self.asked and axes.controller.homed
            and now_ns - self.safety_ns <= 100 * MS
            and all(word & 0x6F == 0x27 for word in self.shown)
            and all(now_ns - shown_ns <= FRESH_NS for shown_ns in self.shown_ns)
        )  # fmt: skip
        for index, word, torque in self.commands():
            assert torque == 0.0 or (may_pass and word == 0x0F)
            assert self.asked or word & 0x0F != 0x0F
            wanted = min(abs(self.torques[index]), LAW.torque_rate * since)
            assert abs(torque) <= min(1.0, since / GATE.ramp_time) * wanted + PER_MILLE
        assert all(map(math.isfinite, axes.drives.written))
        if phase == CLOSED:
            self.asked = False

    def commands(self):
        """Return drive, controlword and torque [Nm] of the commands since the last look."""
        new = [(i - 0x203, data) for i, data in self.wire.frames if i in (0x203, 0x204)]
        self.wire.frames.clear()
        return [
            (index, int.from_bytes(data[:2], "little"),
             int.from_bytes(data[2:], "little", signed=True) * PER_MILLE)
            for index, data in new
        ]  # fmt: skip

    # What the far end does -----------------------------------------------------------------

    @rule(drive=which, act=st.sampled_from(("mute", "answer", "fail", "fail for good", "restart")))
    def bad_luck(self, drive, act):
        end = self.ends[drive]
        if act in ("mute", "answer"):
            end.answering = act == "answer"
        elif act == "restart":
            end.boot_up()
            end.state = "switch on disabled"
        else:
            end.cause_stands = act == "fail for good"
            end.fail()
        self.work(5)

    @rule(drive=which, shown=st.one_of(words, st.sampled_from(sorted(STATUSWORDS)), garbage))
    def nonsense(self, drive, shown):
        if isinstance(shown, tuple):
            self.wire.emit(*shown)
        elif isinstance(shown, str):
            self.ends[drive].state = shown
        else:
            self.wire.emit(0x180 + NODES[drive], shown.to_bytes(2, "little") + bytes(6))
        self.work(2)

    @rule(drive=which, position=st.integers(-(2**31), 2**31 - 1))
    def jump(self, drive, position):
        moved = abs(position - self.ends[drive].position)
        self.ends[drive].position = position
        self.work(1)
        far = min(moved, 2**32 - moved) * COUNT > 30.0 * JOINTS.jump  # late ticks count
        assert not (far and self.answered and self.axes.drives.permit.enabled)

    @rule(speeds=st.tuples(*[st.integers(-120, 120)] * 2), count=st.integers(1, 150))
    def push(self, speeds, count):
        """The patient turns the joints, by so many counts a tick."""
        self.speeds = list(speeds)
        self.work(count)
        self.speeds = [0, 0]

    @rule(periods=st.floats(0.1, 30.0))
    def be_late(self, periods):
        self.operate()
        self.tick(periods)

    # What game, supervisor and operator do -------------------------------------------------

    @rule(setpoint=setpoints, count=st.integers(1, 60))
    def play(self, setpoint, count):
        self.operate()
        self.setpoint = setpoint
        self.work(count)

    @rule(change=live_changes(PlanarSettings))
    def change(self, change):
        controller = self.axes.controller
        controller.settings = controller.settings._replace(**dict([change])).validated()

    @rule(permitted=st.sampled_from((True, True, False)), age=st.sampled_from((0, 0, 90, 200)))
    def permit(self, permitted, age):
        self.operate()
        self.told(permitted, self.wire.now_ns - age * MS)
        self.tick()

    def told(self, permitted: bool, stamp_ns: int) -> None:
        self.axes.drives.permit.supervise(permitted, "told so", stamp_ns)
        self.refused_ns = self.refused_ns if permitted else stamp_ns
        self.permitted = stamp_ns - self.refused_ns > REFUSAL_NS
        self.safety_ns = stamp_ns

    def work(self, count: int) -> None:
        """Tick with the supervisor's word, unless it refused."""
        for _ in range(count):
            if self.permitted:
                self.told(True, self.wire.now_ns + PERIOD_NS)
            self.tick()

    @rule()
    def home(self):
        self.axes.take_home(self.wire.now_ns)

    @rule()
    def enable(self):
        if self.axes.controller.homed:
            self.open()
        self.work(5)

    @rule(slow=which)
    def enable_with_one_drive_slow(self, slow):
        """One never shows operation enabled: the other must not turn either."""
        self.disable()
        if self.axes.controller.homed and not self.axes.drives.permit.faulted:
            self.open()
        for _ in range(60):
            if self.ends[slow].state == "operation enabled":
                self.ends[slow].state = "switched on"
            self.work(1)

    @rule()
    def disable(self):
        gate.disable(self.axes.drives.permit, self.requests)
        self.asked = False
        self.work(2)

    @rule()
    def clear(self):
        with suppress(DeviceError):
            self.axes.clear_fault(self.requests)

    @rule()
    def bring_up(self):
        """Mend everything and do all an operator would, in order."""
        for end in self.ends:
            end.answering, end.cause_stands = True, False
        self.refused_ns, self.axes.drives.permit._refused_ns = -REFUSAL_NS, None
        self.told(True, self.wire.now_ns)
        self.disable()
        self.work(40)
        self.clear()
        self.work(40)
        self.home()
        self.enable()
        self.work(40)

    def operate(self) -> None:
        """Have torque pass, so that there is something to lose."""
        if not self.axes.drives.permit.enabled:
            self.setpoint = (0.15, 0.15, 0.0, 0.0)
            self.bring_up()

    def open(self) -> None:
        """Have the gate opened between two ticks, as for a service."""
        self.asked = True
        self.axes.drives.permit.open(self.wire.now_ns)
        self.work(1)


TestPlanarAxes = PlanarAxesMachine.TestCase
TestPlanarAxes.settings = fixed(12, 15)
