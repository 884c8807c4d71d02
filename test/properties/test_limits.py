# SPDX-License-Identifier: Apache-2.0
"""What stands between any force and the motor: I2t, slew, soft stops, speed limit."""

from __future__ import annotations

import math

from anything import absurd, fixed, near
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from screw_module_ros.control.limits import (
    TorqueLimits,
    clamp,
    limit_speed,
    limit_torque,
    slew,
    soft_stop,
)

ROUNDING = 1e-9
forces = st.floats(-200.0, 200.0)


class MotorHeat(RuleBasedStateMachine):
    """Any torque at any period: never above the peak, the heat never above the rating."""

    @initialize(continuous=st.floats(0.01, 5.0), ratio=st.floats(0.5, 4.0),
                time_constant=st.floats(0.5, 100.0))  # fmt: skip
    def begin(self, continuous, ratio, time_constant):
        self.limits = TorqueLimits(continuous, continuous * ratio, time_constant)
        self.heat = 0.0

    @rule(torque=st.one_of(near(-2.0, 2.0), absurd), dt=st.floats(1e-6, 0.2),
          repeats=st.integers(1, 200))  # fmt: skip
    def ask(self, torque, dt, repeats):
        limits = self.limits
        for _ in range(repeats):
            before = self.heat
            allowed, self.heat = limit_torque(limits, before, torque, dt)
            assert math.isfinite(allowed) and math.isfinite(self.heat)
            assert abs(allowed) <= limits.peak * (1.0 + ROUNDING)
            assert 0.0 <= self.heat <= limits.continuous**2 * (1.0 + ROUNDING)
            if not math.isfinite(torque):
                assert allowed == 0.0
            else:
                assert abs(allowed) <= abs(torque) and allowed * torque >= 0.0


TestMotorHeat = MotorHeat.TestCase
TestMotorHeat.settings = fixed(60, 20)


@fixed(200)
@given(st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(0.0, 100.0)), max_size=50))
def test_no_target_moves_a_value_faster_than_its_rate(targets):
    value = 0.0
    for target, step in targets:
        before, value = value, slew(value, target, step)
        assert abs(value - before) <= step + ROUNDING * max(1.0, abs(before))
        assert min(before, target) <= value <= max(before, target)


@fixed(300)
@given(forces, near(-0.5, 0.9, wild=False), st.floats(0.001, 0.05), st.floats(0.0, 1e4))
def test_beyond_an_end_of_travel_nothing_pushes_outward(force, position, zone, stiffness):
    low, high = 0.0, 0.36
    out = soft_stop(force, position, low, high, zone, stiffness)
    if position >= high:
        assert out <= 0.0
    elif position <= low:
        assert out >= 0.0
    elif low + zone <= position <= high - zone:
        assert out == force


@fixed(300)
@given(forces, st.floats(-5.0, 5.0), st.floats(0.0, 200.0))
def test_above_the_speed_limit_no_force_drives(force, velocity, damping):
    out = limit_speed(force, velocity, 0.6, 0.2, damping)
    assert abs(out) <= abs(force) + damping * max(0.0, abs(velocity) - 0.6) + ROUNDING
    if abs(velocity) >= 0.8:
        assert out * velocity <= ROUNDING


@fixed(200)
@given(absurd, st.floats(-100.0, 0.0), st.floats(0.0, 100.0))
def test_a_clamped_number_is_in_its_range_or_no_number(value, low, high):
    out = clamp(value, low, high)
    assert math.isnan(value) if math.isnan(out) else low <= out <= high
