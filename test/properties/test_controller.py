# SPDX-License-Identifier: Apache-2.0
"""The vertical controller: any samples, any word of the amplifier, any mode, reset now and then."""

from __future__ import annotations

import math

from anything import MS, START_NS, fixed, live_changes, near
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control.laws import all_names, variants
from screw_module_ros.control.limits import LONGEST_STEP
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.loop.controller import VerticalController
from screw_module_ros.safety.checks import AgreementSettings, WatchSettings
from screw_module_ros.samples import EncoderReading, ForceReading

MODEL = thesis_friction()
ROUNDING = 1e-9
SPRINGS = list(variants())
FEEDBACKS = [mode for mode, variant in variants().items() if variant.gains]
ages = st.sampled_from((0, 0, 0, MS, 4 * MS, 10 * MS, -5 * MS))
offs = st.sampled_from((0, 0, 0, 1, -1, 2))  # of a sample's number, from that of its tick
setpoints = st.tuples(near(-1.0, 1.0), near(-1.0, 1.0))


class Controller(RuleBasedStateMachine):
    """What goes out is bounded, continuous but for zero, and zero from a fault until a reset."""

    def __init__(self):
        super().__init__()
        self.settings = VerticalSettings().validated()
        self.controller = VerticalController(
            self.settings, MODEL, WatchSettings(), AgreementSettings(), MS
        )
        self.now_ns, self.sent = START_NS, 0.0
        self.acted_ns: int | None = None
        self.fault = ""

    def pass_time(self, wait_ns: int, off: int = 0, age: int = 0) -> tuple[int, int, int]:
        self.now_ns += wait_ns
        stamp_ns = self.now_ns - age
        return (stamp_ns // MS + off) & 0xFFFFFFFF, stamp_ns, 0

    def judge(self, output) -> None:
        """Look at what is sent, and whether a fault that must stay is still there."""
        controller, settings = self.controller, self.controller.settings
        if self.fault:
            assert controller.faulted, f"{self.fault} went away by itself"
        enabled = controller._enabled
        if controller.faulted and (enabled or self.sent != 0.0):
            self.fault = self.fault or "a fault in operation"
        if output is None:
            return
        assert math.isfinite(output.force)
        assert -settings.command_down <= output.force <= settings.command_up
        step = abs(output.force - self.sent)
        assert output.force == 0.0 or step <= settings.force_rate * self.elapsed() + ROUNDING
        if controller.reason or enabled is False:
            assert output.force == 0.0
        self.sent = output.force

    def respond(self, sample, setpoint):
        height, velocity = setpoint
        self.controller.wanted.ask((height,), (velocity,), self.now_ns)
        return self.controller.on_encoder(sample, self.now_ns)

    def elapsed(self) -> float:
        """Return the time between the last two samples acted upon, as long as it counts [s]."""
        before, self.acted_ns = self.acted_ns, self.controller.answered.monotonic_ns
        return min((self.acted_ns - before) * 1e-9, LONGEST_STEP) if before else MS * 1e-9

    @rule(off=offs, age=ages, position=near(-0.005, 0.365), velocity=near(-1.0, 1.0),
          homed=st.sampled_from((True,) * 9 + (False,)), setpoint=setpoints)  # fmt: skip
    def encoder(self, off, age, position, velocity, homed, setpoint):
        begin = self.pass_time(MS, off, age)
        sample = EncoderReading(*begin, 0, position, velocity, homed)
        self.judge(self.respond(sample, setpoint))

    @rule(off=offs, age=ages, wrench=st.tuples(*[near(-80.0, 80.0)] * 6),
          status=st.sampled_from((0, 0, 0, 4, 1 << 14)))  # fmt: skip
    def force(self, off, age, wrench, status):
        begin = self.pass_time(0, off, age)
        self.controller.on_force(ForceReading(*begin, *wrench, status), self.now_ns)
        self.judge(None)

    @rule(count=st.integers(1, 40), position=st.floats(0.05, 0.3), setpoint=setpoints,
          pull=st.floats(-80.0, 80.0))  # fmt: skip
    def work(self, count, position, setpoint, pull=1.0):
        """Both sensors as they should be, for a while."""
        for _ in range(count):
            begin = self.pass_time(MS)
            reading = ForceReading(*begin, 1.0, 1.0, pull, *[0.1] * 3, 0)
            self.controller.on_force(reading, self.now_ns)
            sample = EncoderReading(*begin, 0, position, 0.0, True)
            self.judge(self.respond(sample, setpoint))

    @rule(mode=st.sampled_from(SPRINGS), count=st.integers(20, 200), setpoint=setpoints)
    def bring_up(self, mode, count, setpoint):
        """From whatever there was to a force on the handle."""
        self.controller.mode = mode
        self.work(3, 0.18, setpoint)
        self.reset()
        self.amplifier(True, 0.0)
        self.work(count, 0.18, setpoint)

    @rule(mode=st.sampled_from(FEEDBACKS), pull=st.floats(-80.0, 80.0), count=st.integers(1, 20))
    def pull(self, mode, pull, count):
        """The patient's hand comes suddenly, while its force is fed back."""
        self.bring_up(mode, 100, (0.18, 0.0))
        self.work(count, 0.18, (0.18, 0.0), pull)

    @rule(enabled=st.sampled_from((True, True, False, None)), position=near(-0.2, 0.2))
    def amplifier(self, enabled, position):
        if enabled is None:  # the drive has said nothing for a while
            self.controller._drive.note(0)
            self.controller.end_tick(self.now_ns)
        else:
            self.controller.on_drive(enabled, position, self.now_ns)
        self.judge(None)

    @rule(wait=st.sampled_from((0, 2 * MS, 6 * MS, 300 * MS)))
    def silence(self, wait):
        self.now_ns += wait
        self.judge(self.controller.stop_when_silent(self.now_ns))

    @rule(mode=st.integers(-1, max(all_names())), change=live_changes(VerticalSettings))
    def operator(self, mode, change):
        self.controller.mode = mode
        changed = self.controller.settings._replace(**dict([change]))
        self.controller.settings = changed.validated()

    @rule()
    def reset(self):
        self.fault = ""
        self.controller.reset(self.now_ns)
        self.judge(None)


TestController = Controller.TestCase
TestController.settings = fixed(50, 30)


def test_a_fault_that_the_amplifiers_end_follows_at_once_stays():
    """The sample that cannot be and the amplifier's `off` may come in one pass of the loop."""
    machine = Controller()
    machine.bring_up(1, 50, (0.2, 0.0))
    machine.respond(
        EncoderReading(*machine.pass_time(MS), 0, math.nan, 0.0, True), (0.2, 0.0)
    )
    machine.controller.on_drive(False, 0.0, machine.now_ns)
    machine.work(20, 0.18, (0.2, 0.0))
    assert "not a finite number" in machine.controller.reason
    machine.reset()
    assert machine.controller.reason == ""
