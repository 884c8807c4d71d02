# SPDX-License-Identifier: Apache-2.0
"""Both laws under any sequence of samples, modes and settings: what they ask for stays bounded."""

from __future__ import annotations

import math

import pytest
from anything import ROUNDING, absurd, all_finite, fixed, live_changes, near
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import modes, plane_envelope
from screw_module_ros.control.envelope import enveloped, initial_state
from screw_module_ros.control.laws import all_names
from screw_module_ros.control.laws.plane_impedance import PLANE_IMPEDANCE
from screw_module_ros.control.laws.thesis import THESIS, Own
from screw_module_ros.control.limits import LONGEST_STEP
from screw_module_ros.control.planar import PlanarInput
from screw_module_ros.control.planar_settings import STUDIED_GAIN, PlanarSettings
from screw_module_ros.control.vertical import VerticalInput
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.safety.checks import WatchSettings
from screw_module_ros.settings import fields, validated

MODEL = thesis_friction()
vertical_step = enveloped(THESIS)
planar_step = plane_envelope.enveloped(PLANE_IMPEDANCE)
periods = st.one_of(st.sampled_from((0.0005, 0.001, 0.002, 0.05)), near(1e-4, 0.1))


class VerticalLaw(RuleBasedStateMachine):
    """Any mode at any time, live settings changed at any time, any sample."""

    def __init__(self):
        super().__init__()
        self.settings = VerticalSettings().validated()
        self.state = initial_state(self.settings, THESIS, Own(self.settings, MODEL))
        self.mode = modes.OFF
        self.force = 0.0
        self.since_zero = 0.0

    @rule(mode=st.integers(-1, max(all_names())))
    def switch(self, mode):
        self.mode = mode

    @rule(change=live_changes(VerticalSettings))
    def change(self, change):
        self.settings = self.settings._replace(**dict([change])).validated()

    @rule(
        position=near(-0.05, 0.41),
        velocity=near(-1.5, 1.5),
        force=near(-150.0, 150.0),
        wanted=near(-1.0, 1.0),
        speed=near(-1.0, 1.0),
        active=st.sampled_from((True, True, True, False)),
        slot=st.sampled_from(((0.0, 0.0), (0.0, 0.0), (45.0, 1.0), (-45.0, 0.5))),
        dt=periods,
        repeats=st.integers(1, 20),
    )
    def sample(self, position, velocity, force, wanted, speed, active, slot, dt, repeats):
        inp = VerticalInput(self.mode, position, velocity, force, wanted, speed, active, *slot)
        for _ in range(repeats):
            output = vertical_step(self.settings, Own(self.settings, MODEL), self.state, inp, dt)
            self.judge(inp, dt, output)

    def judge(self, inp, dt, output):
        settings = self.settings
        assert all_finite(output) and all_finite(self.state)
        assert -settings.command_down <= output.force <= settings.command_up
        assert -settings.force_down <= output.impedance <= settings.force_up
        assert abs(output.friction) <= settings.friction_limit
        assert abs(output.feedback) <= settings.feedback_limit
        assert abs(output.carried) <= settings.force_up + settings.force_down
        assert settings.travel_low <= output.desired_position <= settings.travel_high
        believable = all_finite(inp[1:4]) and dt > 0.0
        if not (inp.active and believable):
            assert output.force == 0.0
        counted = min(dt, LONGEST_STEP) if believable else 0.0
        step = abs(output.force - self.force)
        assert output.force == 0.0 or step <= settings.force_rate * counted + ROUNDING
        if output.force == 0.0 and self.state.base == 0.0:
            self.since_zero = 0.0
        else:
            self.since_zero += counted
        # From enabling on, what is asked for comes in with a weight that time alone raises.
        assert self.state.base <= self.since_zero / settings.fade_time + ROUNDING
        self.force = output.force


class PlanarLaw(RuleBasedStateMachine):
    """The same for the plane: angles, set points and settings."""

    def __init__(self):
        super().__init__()
        self.settings = PlanarSettings(force_gain=STUDIED_GAIN).validated()
        self.state = plane_envelope.initial_state(
            self.settings, PLANE_IMPEDANCE, self.settings
        )
        self.torques = (0.0, 0.0)

    @rule(change=live_changes(PlanarSettings))
    def change(self, change):
        self.settings = self.settings._replace(**dict([change])).validated()

    @rule(
        angles=st.tuples(near(-1.75, 0.65), near(-3.3, -1.3)),
        velocities=st.tuples(near(-6.0, 6.0), near(-6.0, 6.0)),
        wanted=st.tuples(near(-0.5, 0.5), near(-0.5, 0.5)),
        speed=st.tuples(near(-1.0, 1.0), near(-1.0, 1.0)),
        active=st.sampled_from((True, True, True, False)),
        dt=periods,
        repeats=st.integers(1, 20),
    )
    def sample(self, angles, velocities, wanted, speed, active, dt, repeats):
        inp = PlanarInput(*angles, *velocities, *wanted, *speed, active)
        for _ in range(repeats):
            output = planar_step(self.settings, self.settings, self.state, inp, dt)
            self.judge(inp, dt, output)

    def judge(self, inp, dt, output):
        settings = self.settings
        assert all_finite(output) and all_finite(self.state)
        torques = (output.shoulder_torque, output.elbow_torque)
        largest = (settings.shoulder_torque, settings.elbow_torque)
        assert all(abs(t) <= limit for t, limit in zip(torques, largest, strict=True))
        assert math.hypot(output.force_x, output.force_y) <= settings.force_limit + ROUNDING
        assert abs(output.desired_x) <= settings.half_width
        assert abs(output.desired_y) <= settings.half_depth
        believable = all_finite(inp[:4]) and dt > 0.0
        if not (inp.active and believable):
            assert torques == (0.0, 0.0)
        counted = min(dt, LONGEST_STEP) if believable else 0.0
        steps = [abs(t - before) for t, before in zip(torques, self.torques, strict=True)]
        assert torques == (0.0, 0.0) or max(steps) <= settings.torque_rate * counted + ROUNDING
        self.torques = torques


TestVerticalLaw = VerticalLaw.TestCase
TestVerticalLaw.settings = fixed(40, 30)
TestPlanarLaw = PlanarLaw.TestCase
TestPlanarLaw.settings = fixed(40, 30)


@pytest.mark.parametrize("kind", [VerticalSettings, PlanarSettings, WatchSettings])
@fixed(30)
@given(data=st.data())
def test_no_setting_out_of_its_range_is_taken(kind, data):
    floats = [f for f in fields(kind).values() if f.kind is float]
    field = data.draw(st.sampled_from(floats))
    value = data.draw(absurd)
    fits = math.isfinite(value) and field.setting.low <= value <= field.setting.high
    changed = kind()._replace(**{field.name: value})
    if fits:
        assert validated(changed) is changed
    else:
        with pytest.raises(ValueError, match=field.name):
            validated(changed)
