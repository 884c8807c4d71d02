# SPDX-License-Identifier: Apache-2.0
"""Gate, limits, driver and its 402 state machine against a drive that may do anything.

What counts is what stands on the wire: every command frame is judged by what the drive had shown
and by what the operator had asked for until then.
"""

from __future__ import annotations

import itertools
import math
import re

import pytest
from anything import MS, absurd, fixed, near
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule
from scripted import Wire
from scripted_devices import STATUSWORDS, ScriptedDrive

from screw_module_ros.control.limits import CommandLimits, TorqueLimits
from screw_module_ros.control.linearization import default_linearization, torque_command
from screw_module_ros.control.torque_chain import TorqueChain
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.errors import NotNow
from screw_module_ros.devices.life import Phase
from screw_module_ros.geometry import SCREW, force_to_torque
from screw_module_ros.loop.drive import VerticalDrive
from screw_module_ros.loop.ticker import Tick
from screw_module_ros.safety.permit import CLOSED, OPEN, PermitSettings

pytestmark = pytest.mark.long

SETTINGS = DriveSettings(listen=0.0, sdo_timeout=0.02, max_torque=1.6)
GATE, LIMITS, FORCES = PermitSettings(), TorqueLimits(), CommandLimits()
PER_MILLE = 0.42 / 1000.0
LINEARIZATION = default_linearization()
CHAIN = TorqueChain(FORCES, LIMITS, SCREW, LINEARIZATION)
names = (f"vertical axis {number}" for number in itertools.count())

words = st.one_of(st.sampled_from(sorted(STATUSWORDS.values())), st.integers(0, 0xFFFF))
garbage = st.tuples(
    st.sampled_from((0x080, 0x081, 0x181, 0x281, 0x581, 0x701, 0x182, 0x000)),
    st.binary(max_size=8),
)


def largest_torque(scale: float, upward: bool) -> float:
    """Return the largest torque that way at a scale of the gate [Nm]."""
    force = FORCES.command_up if upward else FORCES.command_down
    return min(scale * force_to_torque(force), LIMITS.peak)


def largest_command(scale: float, upward: bool) -> float:
    """Return the largest torque that may stand on the wire at a scale of the gate [Nm]."""
    torque = largest_torque(scale, upward)
    return torque_command(LINEARIZATION, torque) if torque else 0.0


class Machine(RuleBasedStateMachine):
    """A drive on a wire, its driver, and an operator whose wishes are kept count of."""

    def __init__(self):
        super().__init__()
        self.wire = Wire(next(names))
        self.end = self.wire.attach(ScriptedDrive(self.wire))
        self.drive = Drive(self.wire.port, SETTINGS, "vertical drive")
        self.drive.configure()
        self.drive.start()
        self.asked = False
        self.shown, self.shown_ns = 0, 0
        self.beat_ns = 0
        self.wire.frames.clear()
        self.wire.port.subscribe(0x181, self._see)

    def _see(self, data: bytes, arrival_ns: int) -> None:
        if len(data) == 8:
            before, self.shown = self.shown, int.from_bytes(data[:2], "little")
            self.shown_ns = arrival_ns
            if before & 0x6F == 0x27 != self.shown & 0x6F:
                self.asked = False  # it left by itself, or we had it leave

    def teardown(self):
        self.wire.close()

    def advance(self, milliseconds: int) -> int:
        """Let time pass, with the frames of one tick; return the time [ns]."""
        now_ns = self.wire.advance(milliseconds)
        if self.end.answering and now_ns - self.beat_ns >= 20 * MS:
            self.beat_ns = now_ns
            self.wire.emit(0x701, "05" if self.end.operational else "7F")
        self.drive.sync(now_ns)
        self.drive.heartbeat(now_ns)
        self.wire.port.pump()
        return now_ns

    def commands(self):
        """Return controlword and torque [Nm] of the commands since the last look."""
        new = [data for can_id, data in self.wire.frames if can_id == 0x201]
        self.wire.frames.clear()
        return [
            (int.from_bytes(data[:2], "little"),
             int.from_bytes(data[2:], "little", signed=True) * PER_MILLE)
            for data in new
        ]  # fmt: skip

    def judge_frame(self, word: int, torque: float) -> None:
        fresh = self.wire.now_ns - self.shown_ns <= 10 * MS
        enabled = self.shown & 0x6F == 0x27 and fresh
        if not (self.asked and enabled):
            assert torque == 0.0
        if not self.asked:
            assert word & 0x0F != 0x0F
        if torque != 0.0:
            assert word == 0x000F

    # What the far end does -----------------------------------------------------------------

    @rule(act=st.sampled_from(("mute", "answer", "fail", "fail for good", "restart", "recovered")))
    def far_end(self, act):
        end = self.end
        if act in ("mute", "answer"):
            end.answering = act == "answer"
        elif act == "restart":
            end.boot_up()
            end.state = "switch on disabled"
        elif act == "recovered":
            end.cause_stands = False
        else:
            end.cause_stands = act == "fail for good"
            end.fail()

    @rule(shown=st.one_of(words, st.sampled_from(sorted(STATUSWORDS)), garbage))
    def nonsense(self, shown):
        if isinstance(shown, tuple):
            self.wire.emit(*shown)
        elif isinstance(shown, str):
            self.end.state = shown
        else:
            self.wire.emit(0x181, shown.to_bytes(2, "little") + bytes(6))


    def mended(self) -> None:
        """The far end works again; a fault reaction ends in fault by itself (CiA 402, 14)."""
        end = self.end
        end.answering, end.cause_stands = True, False
        self.wire.emit(0x281, "00 00 0A 00 00 00 00")  # TPDO2, in which it is in torque mode
        end.state = "fault" if end.state == "fault reaction active" else end.state


class DriveMachine(Machine):
    """The driver alone: any torque, and an operator's requests in any order."""

    @rule(torque=st.one_of(near(-0.8, 0.8), absurd), wait=st.integers(0, 15),
          repeats=st.integers(1, 15))  # fmt: skip
    def write(self, torque, wait, repeats):
        self.tick(torque, wait, repeats)

    @rule(torque=near(-0.8, 0.8, wild=False))
    def bring_up(self, torque):
        """Recover, enable and work, so that there is something to lose."""
        self.mended()
        self.tick(0.0, 1, 2)
        if self.drive.fault:
            self.clear()
        self.tick(0.0, 1, 120)
        self.enable()
        self.tick(torque, 1, 4)
        assert self.drive.logic.enabling or self.drive.fault or self.drive.recovering

    @rule(torque=near(-0.8, 0.8, wild=False))
    def wait_long(self, torque):
        """Past every limit in time of the driver."""
        self.tick(torque, 40, 30)

    def tick(self, torque, wait, repeats):
        for _ in range(repeats):
            now_ns = self.advance(wait)
            self.asked = self.asked and not self.drive.fault
            told = self.drive.write(torque, now_ns)
            self.asked = self.asked and not self.drive.fault
            for word, sent in self.commands():
                self.judge_frame(word, sent)
                assert math.isclose(sent, told, abs_tol=1e-12)
                assert abs(sent) <= min(SETTINGS.max_torque, abs(torque)) + PER_MILLE

    @rule()
    def enable(self):
        fault = self.drive.fault
        try:
            self.drive.poll_slow()  # as its node does: nothing else brings the mode here
            self.drive.request_enable()
        except NotNow:
            return
        assert not fault
        self.asked = True

    @rule()
    def disable(self):
        self.drive.request_disable()
        self.asked = False

    @rule()
    def clear(self):
        self.drive.clear_fault()
        self.asked = False

    @rule()
    def start_anew(self):
        if self.drive.phase is not Phase.NEW:
            self.drive.start()
            self.asked = False


class AxisMachine(Machine):
    """The whole amplifier: commands and permissions of any kind on top of it."""

    def __init__(self):
        super().__init__()
        self.axis = VerticalDrive(self.drive, self.wire.port, MS, GATE, CHAIN)
        self.open_ns = None
        self.permitted, self.safety_ns = False, 0
        self.command_ns = 0

    @rule(force=st.one_of(near(-90.0, 90.0), absurd), off=st.sampled_from((0, 0, 0, 1, -1, 2)),
          age=st.sampled_from((0, 0, MS // 5, 4 * MS, 10 * MS, -5 * MS)),
          wait=st.integers(1, 15), repeats=st.sampled_from((1, 3, 120)))  # fmt: skip
    def command(self, force, off, age, wait, repeats):
        for _ in range(repeats):
            self.advance(wait if repeats == 1 else 1)
            now_ns = self.wire.now_ns
            if age > -MS:
                self.command_ns = max(self.command_ns, now_ns - age)
            number = ((now_ns - age) // MS + off) & 0xFFFFFFFF
            self.axis.command(number, now_ns - age, force, now_ns)
            self.judge()

    @rule(wait=st.integers(1, 15), repeats=st.sampled_from((1, 3, 10)))
    def silence(self, wait, repeats):
        for _ in range(repeats):
            self.advance(wait if repeats == 1 else 1)
            self.axis.serve_without_command(self.wire.now_ns)
            self.judge()

    @rule(permitted=st.sampled_from((True, True, False)), age=st.sampled_from((0, 0, 0, 90, 200)))
    def permit(self, permitted, age):
        self.permitted, self.safety_ns = permitted, self.wire.now_ns - age * MS
        self.axis.permit.supervise(permitted, "told so", self.safety_ns)

    @rule(repeats=st.sampled_from((10, 60)))
    def bring_up(self, repeats):
        """Recover, enable and work."""
        self.mended()
        self.clear()
        self.enable()
        self.work(repeats)

    def work(self, repeats, force=60.0):
        """Everything as it should be for a while, so that there is something to lose."""
        self.end.answering, self.end.cause_stands = True, False
        for _ in range(repeats):
            self.advance(1)
            self.permit(True, 0)
            self.command_ns = self.wire.now_ns
            now_ns = self.wire.now_ns
            self.axis.command(now_ns // MS & 0xFFFFFFFF, now_ns, force, now_ns)
            self.judge()

    @rule()
    def enable(self):
        self.work(1)
        self.axis.permit.open(self.wire.now_ns)
        self.asked = True
        self.work(5)

    @rule()
    def disable(self):
        self.axis.permit.close()
        self.asked = False

    @rule()
    def clear(self):
        for drive in self.axis.permit.drives:
            if drive.fault:
                drive.clear_fault()
        self.work(20)
        if not self.drive.fault:
            self.axis.permit.clear(self.axis.permit.fault.reason)

    @precondition(lambda self: self.axis.permit.enabled)
    @rule(force=st.sampled_from((150.0, 20.0, -20.0, -150.0)))
    def start_of_ramp_is_gentle(self, force):
        """From the gate's opening on the torque grows with time, whichever way it is asked for."""
        self.disable()
        self.work(25, force)  # a disabling takes 20 ms
        self.axis.permit.open(self.wire.now_ns)
        self.asked = True
        self.work(20, force)
        most = largest_torque(1.0, force > 0.0)
        for _ in range(20):
            self.work(1, force)
            if self.open_ns is None:
                assert self.axis.last.torque == 0.0
                continue
            since = (self.wire.now_ns - self.open_ns) * 1e-9
            assert abs(self.axis.last.torque) <= (since + 0.001) / GATE.ramp_time * most
            assert self.axis.last.torque * force > 0.0 or since == 0.0

    def judge(self) -> None:
        permit, now_ns = self.axis.permit, self.wire.now_ns
        phase = permit.phase
        if phase == OPEN:
            self.open_ns = self.open_ns or now_ns
        else:
            self.open_ns = None
        scale = min(1.0, (now_ns - self.open_ns) * 1e-9 / GATE.ramp_time) if self.open_ns else 0.0
        holds = (
            self.permitted
            and now_ns - self.safety_ns <= 100 * MS
            and now_ns - self.command_ns <= 5 * MS
            and not self.drive.fault
        )
        for word, torque in self.commands():
            self.asked = self.asked and holds  # only another wish may open it again
            self.judge_frame(word, torque)
            assert abs(torque) <= largest_command(scale, torque > 0.0) + PER_MILLE
            assert torque == 0.0 or (phase == OPEN and holds)
        if phase == CLOSED:
            self.asked = False


TestDrive = DriveMachine.TestCase
TestDrive.settings = fixed(30, 25)
TestVerticalAxis = AxisMachine.TestCase
TestVerticalAxis.settings = fixed(20, 20)


def test_twenty_missed_in_a_row_stop_the_torque():
    """Though each command is fresh enough by itself; in time again, the torque stays off."""
    machine = AxisMachine()
    try:
        machine.bring_up(60)
        for missed in ("", "2[0-3] deadlines missed in a row"):
            for _ in range(16):  # 3 ms late each; the permission is looked at each fourth tick
                now_ns = machine.advance(1)
                machine.permit(True, 0)
                machine.axis.act(now_ns // MS - 3, now_ns - 3 * MS, 60.0, now_ns)
                machine.axis.end(Tick(now_ns // MS, now_ns, 0, 0), lambda permit, now_ns: None)
            assert re.fullmatch(missed, machine.axis.permit.fault.reason)
        machine.commands()
        machine.work(60)
        assert not machine.axis.permit.enabled and machine.axis.last.torque == 0.0
    finally:
        machine.teardown()
