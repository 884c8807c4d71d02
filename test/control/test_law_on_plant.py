# SPDX-License-Identifier: Apache-2.0
"""The vertical law on the simulated module, in process: the thesis's offsets (figs 6-1 to 6-13).

The patient moves the handle through the spring of 100 N/m about 0.18 m; the offset is what the hand
feels beyond that spring while it moves.
"""

import math

import pytest

from screw_module_ros import filters, geometry
from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import modes
from screw_module_ros.control.limits import COLD
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.torque_chain import TorqueChain, commanded, on_the_wire
from screw_module_ros.control.vertical import VerticalInput, initial_state, vertical_step
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.plant.world import ArmSettings, World, load_world

DT, DELAY = 0.001, 0.0007  # [s] sample to drive write
SETTINGS = VerticalSettings()
CHAIN = TorqueChain(linearization=default_linearization())
AMPERES_PER_TORQUE = 1.0 / 0.16  # [A/Nm] (thesis 3.1.6)
STAY = math.nan


@pytest.fixture(scope="module")
def model():
    return thesis_friction()


def offsets(mode, model, seconds=9.0):
    """Force beyond the spring [N] at each tick in motion; largest step of the command [N]."""
    world = World(load_world(None))
    world.vertical_powered = True
    world.advance(0.01)
    bias = world.wrench()[2] - world.truth().patient_force
    world.set_arm(
        ArmSettings(
            target=(STAY, STAY, 0.18), duration=2.0, amplitude=(0.0, 0.0, 0.15), omega=(0, 0, 0.8)
        )
    )
    state, heat, felt, largest = initial_state(SETTINGS), COLD, [], 0.0
    zero, start = world.encoder_count, world.truth().nut_position
    smooth, motion = filters.lowpass_coefficients(30.0, DT), filters.velocity_settled(start)
    for tick in range(round(seconds / DT)):
        height = start + geometry.counts_to_height(world.encoder_count - zero)
        velocity, motion = filters.velocity_step(smooth, motion, height, DT)
        inp = VerticalInput(mode, height, velocity, world.wrench()[2] - bias, 0.18, 0.0, True)
        previous = state.force
        output = vertical_step(SETTINGS, model, state, inp, DT)
        largest = max(largest, abs(output.force - previous))
        world.advance(DELAY)
        made, heat = commanded(CHAIN, heat, output.force, 1.0, DT)
        world.vertical_command = on_the_wire(CHAIN, made.command) * AMPERES_PER_TORQUE
        world.advance(DT - DELAY)
        if tick * DT > 4.0 and abs(velocity) > 0.01:
            felt.append(world.truth().patient_force - 100.0 * (height - 0.18))
    return felt, largest


@pytest.mark.parametrize(
    ("mode", "low", "high"),
    [
        (modes.IMPEDANCE, 7.0, 13.0),
        (modes.FRICTION_COMPENSATION, 0.0, 3.0),
        (modes.FORCE_FEEDBACK, 0.5, 3.0),
        (modes.COMBINED, 0.0, 1.0),
    ],
)
def test_mean_offset_of_each_mode(mode, low, high, model):
    felt, largest = offsets(mode, model)
    assert len(felt) > 1000, "the handle must have moved"
    assert low <= sum(map(abs, felt)) / len(felt) <= high
    assert largest <= SETTINGS.force_rate * DT + 1e-9
