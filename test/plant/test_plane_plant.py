# SPDX-License-Identifier: Apache-2.0
"""The planar arm of another package in the simulated rig: what is taken, and that it moves."""

from __future__ import annotations

import math
from importlib import metadata

import pytest

from screw_module_ros import plugins
from screw_module_ros.plant import plane_plant
from screw_module_ros.plant.patient import ArmSettings
from screw_module_ros.plant.plane_plant import MANUS_PLANT, PlanePlant
from screw_module_ros.plant.world import World, load_world
from screw_module_ros.settings import SettingError

NO_PLANT = 3.0
NO_STEP = MANUS_PLANT.__class__("none", dict, *(None,) * 5)


@pytest.fixture
def serial(importing):
    """The example's plant."""
    return importing("own_arm", "serial_plant").SERIAL_PLANT


def test_a_plant_is_found_by_module_and_by_entry_point_and_ours_without_a_name(serial, monkeypatch):
    assert plane_plant.load("") is plane_plant.load("five_bar") is MANUS_PLANT
    assert plane_plant.load("serial_plant:SERIAL_PLANT") is serial
    point = metadata.EntryPoint("serial", "serial_plant:SERIAL_PLANT", plane_plant.GROUP)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [point])
    assert plane_plant.load("serial") is serial


@pytest.mark.parametrize(
    ("named", "said"),
    [
        ("six_bar", "nor an entry point of screw_module_ros.plane_plants"),
        (f"{__name__}:NO_PLANT", "is no screw_module_ros.plant.plane_plant.PlanePlant"),
        (f"{__name__}:NO_STEP", "its rest is no function"),
    ],
)
def test_what_is_no_plant_is_told_in_a_sentence(named, said):
    with pytest.raises(SettingError, match=said) as caught:
        plane_plant.load(named)
    assert str(caught.value).startswith(f"plane_plant {named}: ")


@pytest.fixture
def world(serial: PlanePlant):
    return World(load_world(), plane=serial)


def test_a_hand_moves_it_and_feels_its_mass(world):
    """Towards its target, and the force that it takes is that of the whole mass."""
    world.set_arm(ArmSettings("active", target=(0.06, -0.04, 0.2), duration=1.0))
    pushed = 0.0
    for _ in range(3000):
        world.advance(0.001)
        pushed = max(pushed, math.hypot(*world.truth().planar_force))
    assert math.dist(world.truth().planar_position, (0.06, -0.04)) < 0.01
    assert 1.0 < pushed < 20.0


def test_its_motors_drive_it_only_with_power_and_brakes_brake_it(world):
    world.set_fixture("free")
    world.planar_command = (1.0, 0.0)
    world.advance(0.2)
    assert world.planar_torque == (0.0, 0.0), "without power"
    world.planar_powered = (True, True)
    world.advance(0.3)
    moving = world.truth().joint_velocity
    assert world.planar_torque == (1.0, 0.0) and max(map(abs, moving)) > 0.1
    world.planar_powered, world.planar_braked = (False, False), (True, True)
    world.advance(0.001)
    assert world.planar_torque[0] * world.truth().joint_velocity[0] < 0.0
    world.advance(3.0)
    assert max(map(abs, world.truth().joint_velocity)) < 0.1 * max(map(abs, moving))


def test_the_same_seed_is_the_same_run_also_without_machine_code(serial):
    places = []
    for compile_ in (True, False):
        made = World(load_world(), seed=3, compile=compile_, plane=serial)
        made.planar_command, made.planar_powered = (0.5, -0.5), (True, True)
        made.advance(0.05)
        places.append(made.truth().planar_position)
    assert places[0] == pytest.approx(places[1], abs=1e-12)
