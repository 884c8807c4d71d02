# SPDX-License-Identifier: Apache-2.0
"""The slot in the loops: renewed or gone, refused when it cannot be, and no jump in the laws."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import planar, vertical
from screw_module_ros.control.modes import IMPEDANCE
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.slot import Slot, SlotLimits
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.geometry import inverse
from screw_module_ros.loop.inputs import Guide

LIMITS = SlotLimits()
MODEL = thesis_friction()
LINE = Slot(target_y=0.14)
MS = 1_000_000
DT = 0.002


def test_a_wall_goes_by_the_start_tick():
    guide = Guide(LIMITS)
    for step in range(1, 500):
        if step % 20 == 1:
            guide.ask(LINE, 100 * MS, 2 * MS * step)
        force = guide.guidance(0.0, 0.0, 0.0, 0.0, 2 * MS * step, DT).force_y
        if 2 * step < 100:
            assert force == 0.0
    wall = 0.14 * 0.5  # at half of 1.4 s: 100 ms + 700 ms = step 400
    guide = Guide(LIMITS)
    for step in range(1, 401):
        guide.ask(LINE, 100 * MS, 2 * MS * step)
        force = guide.guidance(0.0, 0.0, 0.0, 0.0, 2 * MS * step, DT).force_y
    assert force == pytest.approx(100.0 * wall, rel=1e-6)


def test_a_slot_that_cannot_be_is_refused_and_none_is_left():
    guide = Guide(LIMITS)
    guide.ask(LINE, 0, MS)
    assert not guide.free
    with pytest.raises(ValueError, match="duration"):
        guide.ask(LINE._replace(duration=math.nan), 0, MS)
    assert guide.free
    assert guide.guidance(0.03, 0.0, 0.0, 0.0, 2 * MS, DT).weight == 0.0


def test_no_slot_ends_the_one_there_is():
    guide = Guide(LIMITS)
    guide.ask(LINE, 0, MS)
    guide.ask(None, 0, MS)
    assert guide.free


def planar_input(x, y, setpoint, slot=(0.0, 0.0, 0.0)):
    return planar.PlanarInput(*inverse(x, y), 0.0, 0.0, *setpoint, 0.0, 0.0, True, *slot)


@given(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))
def test_the_plane_takes_the_slot_for_its_spring_and_gives_it_back_without_a_jump(x, y, gx, gy):
    settings = PlanarSettings()
    state, before = planar.initial_state(settings), (0.0, 0.0)
    weights = [0.0] * 300 + [k / 100 for k in range(100)] + [1.0] * 50
    weights += [1.0 - k / 100 for k in range(100)] + [0.0] * 20
    for weight in weights:
        slot = (3.0 * weight, -2.0 * weight, weight)
        output = planar.planar_step(settings, state, planar_input(x, y, (gx, gy), slot), DT)
        force = output.force_x, output.force_y
        # Fading 31 N in 0.2 s, and a set point that runs 0.6 m/s at 100 N/m, take so much a step.
        assert math.dist(force, before) <= 0.01 * 40.0 + 2.0 * 0.6 * DT * 100.0
        if weight == 1.0:
            assert force == pytest.approx((3.0, -2.0))
            assert (output.desired_x, output.desired_y) == pytest.approx((x, y), abs=1e-9)
        before = force


def test_the_vertical_takes_the_slot_for_its_spring():
    settings = VerticalSettings()
    state = vertical.initial_state(settings)
    forces = []
    for step in range(1500):
        weight = min(1.0, step / 200)
        inp = vertical.VerticalInput(
            IMPEDANCE, 0.2, 0.0, 0.0, 0.3, 0.0, True, 5.0 * weight, weight
        )
        output = vertical.vertical_step(settings, MODEL, state, inp, 0.001)
        forces.append(output.force)
    assert output.impedance == pytest.approx(5.0)
    assert output.desired_position == pytest.approx(0.2)
    assert max(abs(b - a) for a, b in zip(forces, forces[1:], strict=False)) <= (
        settings.force_rate * 0.001 + 1e-9
    )


@given(st.floats(allow_nan=True, allow_infinity=True), st.floats(allow_nan=True))
def test_a_slot_force_that_is_none_gives_no_torque(force, weight):
    settings = PlanarSettings()
    state = planar.initial_state(settings)
    slot = (force, 0.0, weight)
    output = planar.planar_step(settings, state, planar_input(0.0, 0.05, (0.0, 0.0), slot), DT)
    assert all(map(math.isfinite, output))
    assert math.hypot(output.force_x, output.force_y) <= settings.force_limit + 1e-9
    if not (abs(force) <= 1e5 and 0.0 <= weight <= 1.0):
        assert (output.shoulder_torque, output.elbow_torque) == (0.0, 0.0)
