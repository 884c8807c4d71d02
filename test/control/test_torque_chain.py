# SPDX-License-Identifier: Apache-2.0
"""From force to the torque on the wire: limits in their order, one chain, compiled or not."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.compiled import compiled
from screw_module_ros.control.limits import COLD, CommandLimits, TorqueLimits
from screw_module_ros.control.linearization import default_linearization, torque_command
from screw_module_ros.control.torque_chain import (
    TorqueChain,
    commanded,
    commanded_torque,
    followed,
    largest_command,
    on_the_wire,
)
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.geometry import Screw

DT = 0.001
MAP = default_linearization()
CHAIN = TorqueChain(linearization=MAP)
BARE = TorqueChain()
NEWTON = 0.01905 / (2.0 * math.pi)  # [Nm] that make a newton at the handle


def test_a_newton_is_three_millinewton_metres():
    made, _ = commanded(BARE, COLD, 10.0, 1.0, DT)
    assert made == pytest.approx((0.03032, 0.03032, False), abs=1e-5)
    other = BARE._replace(screw=Screw(lead=2.0 * 0.01905))
    assert commanded(other, COLD, 10.0, 1.0, DT)[0].torque == pytest.approx(20.0 * NEWTON)


@pytest.mark.parametrize(("force", "kept"), [(140.0, 95.0), (-140.0, -75.0)])
def test_force_limits_come_before_the_gate_s_scale(force, kept):
    made, _ = commanded(BARE, COLD, force, 0.5, DT)
    assert made.limited and made.torque == pytest.approx(0.5 * kept * NEWTON)


def test_the_linearization_undoes_the_dead_zone_and_leaves_zero_alone():
    assert commanded(CHAIN, COLD, 20.0, 1.0, DT)[0].command == torque_command(MAP, 20.0 * NEWTON)
    assert commanded(CHAIN, COLD, 0.0, 1.0, DT)[0].command == 0.0
    assert commanded(CHAIN, COLD, 20.0, 0.0, DT)[0] == (0.0, 0.0, False)


def test_the_motor_s_heat_takes_the_torque_back():
    """Twice the continuous torque for long: what stands for ever is left (I2t)."""
    heat, made = COLD, None
    for _ in range(30_000):
        made, heat = commanded_torque(BARE, heat, 0.84, DT)
    assert made.limited and made.torque == pytest.approx(0.42, rel=1e-3)


def test_the_wire_knows_whole_per_mille():
    assert on_the_wire(CHAIN, 0.1001) == pytest.approx(238 * 0.42e-3)
    assert on_the_wire(CHAIN, 1e9) == pytest.approx(32767 * 0.42e-3)


@given(st.floats(-200.0, 200.0), st.floats(0.0, 1.0), st.floats(0.0, 0.18))
def test_the_compiled_chain_is_the_plain_one(force, scale, heat):
    plain, plain_heat = commanded(CHAIN, heat, force, scale, DT)
    quick, quick_heat = compiled(commanded)(CHAIN, heat, force, scale, DT)
    assert tuple(quick) == pytest.approx(tuple(plain), abs=1e-12)
    assert quick_heat == pytest.approx(plain_heat, abs=1e-12)


@given(st.lists(st.tuples(st.floats(-500.0, 500.0), st.floats(0.0, 1.0)), max_size=40))
def test_never_more_than_the_peak_nor_the_scaled_force(steps):
    heat = COLD
    for force, scale in steps:
        made, heat = commanded(CHAIN, heat, force, scale, DT)
        largest = scale * (95.0 if force > 0.0 else 75.0) * NEWTON
        assert abs(made.torque) <= min(largest, CHAIN.limits.peak) + 1e-12


# -- rate ----------------------------------------------------------------------------------------


def test_a_foreign_sender_cannot_make_the_force_jump():
    """True and foreign commands by turns, ten a millisecond: 4 N a millisecond at most."""
    forces = [0.0]
    for asked in [-75.0, 95.0] * 500:
        forces.append(followed(BARE, forces[-1], asked, 1e-4))
    assert max(abs(b - a) for a, b in pairwise(forces)) == pytest.approx(0.4)
    assert abs(forces[-1]) < 1.0


def test_the_controller_s_own_steps_pass_also_with_jitter():
    """`force_rate` moves the force by 2 N a millisecond; writes come 0.5 and 1.5 ms apart."""
    asked = 0.0
    for pause in [1.5, 0.5] * 20:
        before, asked = asked, asked + VerticalSettings().force_rate * DT
        assert followed(BARE, before, asked, DT * pause) == asked


@pytest.mark.parametrize(("force", "zero"), [(95.0, 0.0), (-75.0, -0.0)])
def test_zero_is_followed_at_once(force, zero):
    assert followed(BARE, force, zero, DT) == 0.0


# -- the drive's own limit -----------------------------------------------------------------------


@given(st.floats(-200.0, 200.0), st.floats(0.0, 1.0), st.floats(0.0, 0.2))
def test_no_command_is_beyond_what_the_drive_is_told(force, scale, heat):
    for chain in (BARE, CHAIN):
        made, _ = commanded(chain, heat, force, scale, DT)
        assert abs(made.command) <= largest_command(chain) + 1e-12


@pytest.mark.parametrize(
    ("chain", "largest"),
    [
        (BARE, 95.0 * NEWTON),
        (BARE._replace(commands=CommandLimits(10.0, 60.0)), 60.0 * NEWTON),
        (TorqueChain(CommandLimits(150.0, 150.0), TorqueLimits(peak=0.3)), 0.3),
        (CHAIN, torque_command(MAP, 95.0 * NEWTON)),
    ],
)
def test_the_largest_command_is_that_of_the_larger_force(chain, largest):
    assert largest_command(chain) == pytest.approx(largest)
