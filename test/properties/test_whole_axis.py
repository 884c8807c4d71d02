# SPDX-License-Identifier: Apache-2.0
"""Controller, gate, driver and the simulated rig in one loop, with the rig's faults at any time."""

from __future__ import annotations

import math

import pytest
from anything import fixed, near
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from screw_module_ros.control.laws import names, variants
from screw_module_ros.control.limits import LONGEST_STEP, CommandLimits
from screw_module_ros.control.linearization import default_linearization, torque_command
from screw_module_ros.control.modes import FORCE_FEEDBACK
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.geometry import force_to_torque
from screw_module_ros.safety.permit import CLOSED, OPEN
from screw_module_ros.trials.one_thread import OneThreadRobot

pytestmark = pytest.mark.long

LARGEST = torque_command(default_linearization(), force_to_torque(max(CommandLimits()))) + 0.001
FORCE_RATE = VerticalSettings().force_rate
ROUNDING = 1e-9
FAULTS = st.sampled_from(
    (
        ("encoder", "freeze", 0.0), ("encoder", "jump", 0.0), ("encoder", "cable_out", 0.0),
        ("force_sensor", "saturate", 0.0), ("force_sensor", "status", 5.0),
        ("force_sensor", "cable_out", 0.0), ("drive", "fault", 0.0), ("drive", "cable_out", 0.0),
    )
)  # fmt: skip


class WholeAxis(RuleBasedStateMachine):
    """An operator, a game and bad luck, each doing anything; every tick is judged."""

    @initialize(mode=st.sampled_from(list(variants())))
    def begin(self, mode):
        self.bench = OneThreadRobot()
        self.bench.ready()
        self.bench.rows.clear()
        self.asked = False
        self.force = 0.0
        self.acted_ns = self.bench.controller.answered.monotonic_ns
        self.open_ticks = 0
        self.bench.controller.mode = mode
        self.bench.setpoint = (0.3, 0.0)
        self.bring_up()
        assert self.bench.axis.permit.enabled

    def teardown(self):
        if hasattr(self, "bench"):
            self.bench.close()

    @rule(count=st.integers(1, 60))
    def work(self, count):
        bench = self.bench
        for _ in range(count):
            bench.tick()
            self.judge(bench.rows[-1])

    def judge(self, row) -> None:
        permit = self.bench.axis.permit
        assert math.isfinite(row.torque) and math.isfinite(row.force)
        step, elapsed = abs(row.force - self.force), self.elapsed()
        assert row.force == 0.0 or step <= FORCE_RATE * elapsed + ROUNDING
        self.force = row.force
        self.open_ticks = self.open_ticks + 1 if permit.phase == OPEN else 0
        ramp = min(1.0, self.open_ticks / 500.0)
        assert abs(row.torque) <= ramp * LARGEST + 0.001
        if not (self.asked and self.bench.permitted and permit.phase == OPEN):
            assert row.torque == 0.0
        if self.bench.controller.faulted:
            assert self.bench.controller.output.force == 0.0
        if permit.phase == CLOSED:
            self.asked = False

    def elapsed(self) -> float:
        """Return the time from the sample acted upon before to the newest, as it counts [s]."""
        before, self.acted_ns = self.acted_ns, self.bench.controller.answered.monotonic_ns
        return min((self.acted_ns - before) * 1e-9, LONGEST_STEP)

    @rule(
        mode=st.sampled_from(list(names())),
        setpoint=st.tuples(near(-0.2, 0.6), near(-1.0, 1.0)),
    )
    def play(self, mode, setpoint):
        self.bench.controller.mode, self.bench.setpoint = mode, setpoint
        self.work(40)

    @rule(fault=FAULTS)
    def bad_luck(self, fault):
        device, name, value = fault
        self.bench.rig.inject(device, name, value, 0.0, self.bench.now_ns)
        self.work(60)

    @rule(permitted=st.booleans())
    def supervisor(self, permitted):
        self.bench.permitted = permitted
        self.work(5)

    @rule()
    def mend(self):
        """Take every fault away; nothing may come back by that alone."""
        asked = self.asked
        for device in ("encoder", "force_sensor", "drive"):
            self.bench.rig.inject(device, "clear", 0.0, 0.0, self.bench.now_ns)
        self.work(60)
        assert asked or not self.bench.axis.permit.enabled

    @rule()
    def bring_up(self):
        """All an operator would do, in order."""
        bench = self.bench
        self.mend()
        bench.permitted = True
        if bench.drive.fault:
            bench.drive.clear_fault()
        self.work(150)
        bench.controller.reset(bench.now_ns)
        permit = bench.axis.permit
        permit.clear(permit.fault.reason)
        self.work(10)
        permit.open(bench.now_ns)
        self.asked = True
        self.work(110)

    @rule()
    def disable(self):
        self.bench.axis.permit.close()
        self.asked = False
        self.work(5)


TestWholeAxis = WholeAxis.TestCase
TestWholeAxis.settings = fixed(3, 12)


def test_frozen_gauges_are_not_fed_back():
    """Half a second after they stood still the force is zero, and stays it when they move again."""
    machine = WholeAxis()
    try:
        machine.begin(FORCE_FEEDBACK)
        bench = machine.bench
        bench.rig.inject("force_sensor", "freeze", 0.0, 0.0, bench.now_ns)
        machine.work(495)
        assert bench.axis.permit.enabled and bench.controller.reason == ""
        machine.work(15)
        assert "have not changed for 0.5 s" in bench.force_sensor.fault
        assert bench.controller.reason.startswith("force sensor: no sample")
        assert bench.controller.output.force == 0.0
        machine.mend()  # thaws it; only `tare` or a new start of the node clears the fault
        bench.controller.reset(bench.now_ns)
        machine.work(20)
        assert bench.controller.output.force == 0.0
    finally:
        machine.teardown()
