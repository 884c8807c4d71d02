# SPDX-License-Identifier: Apache-2.0
"""MuJoCo's model of the machine against the plant: pose, masses, torques, frequencies, friction.

Tolerances stand beside each comparison; docs/ros.md tells them. Without MuJoCo the tests are
skipped: `pip install mujoco` (extra `mujoco` of setup.py), Python 3.11 or newer.
"""

from __future__ import annotations

import itertools
import math
import re

import numpy as np
import pytest

from screw_module_ros.geometry import forward, inverse, jacobian
from screw_module_ros.nodes import robot_description as described
from screw_module_ros.plant.friction import steady_level
from screw_module_ros.plant.module import FREE, ModuleInput, resting_state, vertical_params
from screw_module_ros.plant.patient import arm_force
from screw_module_ros.plant.planar import (
    ManusInput,
    handle_place,
    planar_params,
    planar_step,
    resting_plane,
)
from screw_module_ros.plant.settings import load_world
from screw_module_ros.plant.vertical import vertical_step
from screw_module_ros.resources import resource_path

mujoco = pytest.importorskip(
    "mujoco", reason="MuJoCo is not installed: pip install mujoco (Python 3.11 or newer)"
)

LOST = {"friction": 1e-9, "viscous": 0.0, "bristle_damping": 0.0, "bristle_stiffness": 1e-9}
STILL = ModuleInput(0.0, True, False, FREE, False, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
PLANE = ManusInput(0.0, 0.0, True, True, False, False, False, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class Machine:
    """MuJoCo's model of a plant file, at the start."""

    def __init__(self, frictionless: bool = True):
        text = described.robot_description(shape=described.SHAPE_MUJOCO)
        self.model = mujoco.MjModel.from_xml_string(text)
        if frictionless:
            self.model.dof_frictionloss[:] = 0.0
            self.model.dof_damping[[self.at(name) for name in ("shoulder", "elbow_motor")]] = 0.0
        self.data = mujoco.MjData(self.model)
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        mujoco.mj_forward(self.model, self.data)

    def at(self, joint: str) -> int:
        """Return the place of a joint in qpos and qvel: each has one of both."""
        return self.model.joint(joint).id

    def stand(self, x: float, y: float, z: float) -> None:
        """Put the handle at a place, the nut at the middle of its play."""
        shoulder, elbow = inverse(x, y)
        world = load_world()
        values = {"shoulder": shoulder, "elbow": elbow - shoulder, "elbow_motor": elbow,
                  "coupler": shoulder - elbow, "vertical": z,
                  "screw": z * 2.0 * math.pi / world.vertical.lead}  # fmt: skip
        self.data.qpos[:] = 0.0
        for joint, value in values.items():
            self.data.qpos[self.at(joint)] = value
        mujoco.mj_forward(self.model, self.data)

    def steps(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / self.model.opt.timestep)):
            mujoco.mj_step(self.model, self.data)

    @property
    def handle(self) -> np.ndarray:
        """x, y, z of the handle [m]."""
        return self.data.site("handle").xpos.copy()

    def frequencies(self) -> np.ndarray:
        """Return the undamped frequencies of the pose [Hz], from the step's own linearization."""
        n = self.model.nv
        step = np.zeros((2 * n + self.model.na, 2 * n + self.model.na))
        mujoco.mjd_transitionFD(self.model, self.data, 1e-7, True, step, None, None, None)
        return frequencies(step, self.model.opt.timestep)


def frequencies(step: np.ndarray, dt: float) -> np.ndarray:
    """Return |log of the eigenvalues| of a step [Hz], of those that swing, sorted."""
    rates = np.log(np.linalg.eigvals(step).astype(complex)) / dt
    return np.sort(np.abs(rates[rates.imag > 1.0])) / (2.0 * math.pi)


def linear(step, state, fields: list[str], small: float = 1e-7) -> np.ndarray:
    """Return the matrix of a plant's step about a state, in some of its fields."""
    def moved(name: str, by: float):
        return step(state._replace(**{name: getattr(state, name) + by}))

    columns = [
        [(getattr(moved(name, small), row) - getattr(moved(name, -small), row)) / (2.0 * small)
         for row in fields]
        for name in fields
    ]  # fmt: skip
    return np.array(columns).T


@pytest.fixture
def plant(tmp_path, monkeypatch):
    """Return a function that changes values of the plant's file, for both sides; returns the world.
    """

    def changed(**values: float):
        text = resource_path(described.MASSES).read_text("utf-8")
        for key, value in values.items():
            text, count = re.subn(rf"^( *{key}: +)\S+", rf"\g<1>{value:.6e}", text, flags=re.M)
            assert count == 1, key
        file = tmp_path / "plant.yaml"
        file.write_text(text, encoding="utf-8")
        monkeypatch.setattr(described, "MASSES", str(file))
        return load_world(file)

    return changed


def vertical_plant(world):
    """Return the vertical module's parameters, without friction."""
    friction = world.friction._replace(
        scale=0.0, roller_amplitude=0.0, stribeck=0.0, smallest=1e-9, load_gain=0.0, wave=0.0,
        stiffness=1e-9, damping=0.0,
    )  # fmt: skip
    module = world.vertical._replace(rail_friction=0.0)
    return vertical_params(
        module, friction, world.amplifier._replace(dead_zone=0.0), world.transducer,
        arm_force(world.arm), world.substep,
    )  # fmt: skip


def planar_plant(world, **changed):
    return planar_params(world.planar._replace(**changed), arm_force(world.arm), world.substep)


def test_the_handle_is_where_the_laws_have_it_and_the_loop_is_closed():
    machine = Machine()
    for place in itertools.product((-0.19, 0.0, 0.19), (-0.22, 0.0, 0.22), (0.0, 0.36)):
        machine.stand(*place)
        assert machine.handle == pytest.approx(place, abs=1e-12)
        assert machine.handle[:2] == pytest.approx(forward(*inverse(*place[:2])), abs=1e-12)
        assert machine.data.efc_pos[:3] == pytest.approx(0.0, abs=1e-12)


def test_mujoco_reads_the_urdf_too():
    """As a tree, without the joints that mimic: a parser that is not ours takes it."""
    model = mujoco.MjModel.from_xml_string(described.robot_description())
    names = {model.joint(number).name for number in range(model.njnt)}
    assert {"shoulder", "elbow", "vertical", "crank", "coupler", "screw"} <= names


def test_masses_are_the_plant_s():
    """The mass matrix of both motors' angles, the loop closed, to 1e-9."""
    machine, planar = Machine(), load_world().planar
    own = planar.joint_inertia
    for x, y in itertools.product((-0.19, 0.0, 0.19), (-0.22, 0.0, 0.22)):
        machine.stand(x, y, 0.2)
        shoulder, elbow = inverse(x, y)
        whole = np.zeros((machine.model.nv, machine.model.nv))
        mujoco.mj_fullM(machine.model, machine.data, whole)
        motors = np.zeros((machine.model.nv, 2))
        for joint, ways in {"shoulder": (1, 0), "elbow": (-1, 1), "elbow_motor": (0, 1),
                            "coupler": (1, -1)}.items():  # fmt: skip
            motors[machine.at(joint)] = ways
        coupling = own.coupling * math.cos(elbow - shoulder)
        ways = np.reshape(jacobian(shoulder, elbow), (2, 2))
        wanted = np.array([[own.shoulder, coupling], [coupling, own.elbow]])
        wanted += planar.module_mass * ways.T @ ways
        assert motors.T @ whole @ motors == pytest.approx(wanted, rel=1e-9)


def test_without_friction_the_handle_falls_as_the_plant_s():
    """And turns the screw: (moving mass) g / (both masses). Within 0.1 % after 0.2 s."""
    world, machine = load_world(), Machine()
    params = vertical_plant(world)
    state = resting_state(params.module, world.start.position, 1.0)._replace(bristle=0.0)
    begun, begun_there = machine.handle[2], state.handle
    for _ in range(round(0.2 / world.substep)):
        state = vertical_step(params, state, STILL._replace(powered=False))
    machine.steps(0.2)
    fallen = begun - machine.handle[2]
    assert fallen > 0.03
    assert fallen == pytest.approx(begun_there - state.handle, rel=1e-3, abs=world.vertical.play)


def test_the_motor_that_carries_the_weight_holds_it_in_both():
    """Static torque of the screw, weight x lead / 2 pi: nothing moves 0.1 mm beyond the play."""
    world, machine = load_world(), Machine()
    params, vertical = vertical_plant(world), world.vertical
    torque = vertical.moving_mass * vertical.gravity * vertical.lead / (2.0 * math.pi)
    state = resting_state(params.module, world.start.position, 1.0)._replace(bristle=0.0)
    current = torque / params.torque_constant
    holding = STILL._replace(current=current)
    state = state._replace(current=current, command_1=current, command_2=current,
                           command_3=current)  # fmt: skip
    begun = state.handle
    for _ in range(round(0.2 / world.substep)):
        state = vertical_step(params, state, holding)
    assert state.handle == pytest.approx(begun, abs=1e-5)
    machine.data.qpos[machine.at("vertical")] -= 0.5 * vertical.play
    machine.data.ctrl[2] = torque
    machine.data.act[2] = torque
    begun = machine.handle[2]
    machine.steps(0.2)
    assert machine.handle[2] == pytest.approx(begun, abs=1e-4)


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.15, -0.18), (-0.17, 0.2)])
def test_joint_torques_of_the_laws_balance_a_force_at_the_handle(place):
    """-J^T F against F: the structure bends by F / k, within 2 %, and the handle stays."""
    machine, planar = Machine(), load_world().planar
    machine.stand(*place, 0.2)
    machine.model.opt.gravity[:] = 0.0
    force = np.array([14.0, -9.0])
    torque = -np.reshape(jacobian(*inverse(*place)), (2, 2)).T @ force
    machine.data.ctrl[:2] = machine.data.act[:2] = torque
    machine.data.body("carriage").xfrc_applied[:2] = force
    machine.steps(0.5)
    bent = [machine.data.qpos[machine.at(joint)] for joint in ("bend_x", "bend_y")]
    turn = machine.data.body("forearm").xmat.reshape(3, 3)[:2, :2]
    limit = 0.02 * math.hypot(*force) / planar.structure_stiffness
    assert turn @ bent == pytest.approx(force / planar.structure_stiffness, abs=limit)
    assert machine.handle[:2] == pytest.approx(place, abs=1e-3)


def test_the_plane_swings_on_its_structure_as_the_plant_s():
    """Both frequencies of the module on the structure, joints free, within 0.5 %."""
    world, machine = load_world(), Machine()
    machine.stand(0.05, -0.1, 0.2)
    machine.model.opt.gravity[:] = 0.0
    params = planar_plant(world, **LOST)
    fields = ["shoulder", "elbow", "shoulder_velocity", "elbow_velocity",
              "bend_x", "bend_y", "handle_vx", "handle_vy"]  # fmt: skip
    state = resting_plane(params.robot, 0.05, -0.1)
    wanted = frequencies(linear(lambda s: planar_step(params, s, PLANE), state, fields),
                         world.substep)  # fmt: skip
    assert len(wanted) == 2 and 30.0 < wanted[0] < wanted[1] < 150.0
    found = machine.frequencies()
    for frequency in wanted:
        assert np.min(np.abs(found / frequency - 1.0)) < 5e-3


@pytest.mark.parametrize("side", [0.0, 1.0], ids=["within the play", "on the nut"])
def test_the_screw_swings_on_its_support_as_the_plant_s(plant, side):
    """Of screw, nut and handle on support and contact, within 2 %; no damping on either side."""
    world = plant(substep=2.5e-5, film_damping=0.0, contact_damping=0.0, support_damping_ratio=0.0)
    machine, params = Machine(), vertical_plant(world)
    gap = side * 0.7 * world.vertical.play
    machine.model.opt.gravity[:] = 0.0
    machine.data.qpos[machine.at("vertical")] += gap
    mujoco.mj_forward(machine.model, machine.data)
    state = resting_state(params.module._replace(gravity=0.0), world.start.position, 1.0)
    state = state._replace(handle=state.nut + gap, support=0.0, bristle=0.0)
    fields = ["nut", "nut_velocity", "handle", "handle_velocity", "support", "support_velocity"]
    wanted = frequencies(
        linear(lambda s: vertical_step(params, s, STILL), state, fields, 1e-9), world.substep
    )
    found = machine.frequencies()
    assert len(wanted) == (2 if side else 1)
    assert wanted[0] > 300.0
    for frequency in wanted:
        assert np.min(np.abs(found / frequency - 1.0)) < 2e-2


def test_torques_move_the_plane_as_in_the_plant():
    """With the joints' friction: the handle's way within 2 % after 0.3 s."""
    world, machine = load_world(), Machine(frictionless=False)
    machine.model.opt.gravity[:] = 0.0
    params = planar_plant(world)
    state = resting_plane(params.robot, world.start.x, world.start.y)
    begun = np.array(handle_place(params.robot, state))
    torques = 3.0, -2.0
    machine.data.ctrl[:2] = torques
    moved = PLANE._replace(shoulder_torque=torques[0], elbow_torque=torques[1])
    for _ in range(round(0.3 / world.substep)):
        state = planar_step(params, state, moved)
    machine.steps(0.3)
    wanted = np.array(handle_place(params.robot, state)) - begun
    assert math.hypot(*wanted) > 0.04
    assert machine.handle[:2] - begun == pytest.approx(wanted, abs=0.02 * math.hypot(*wanted))


def test_play_and_friction_are_there_as_far_as_mujoco_has_them():
    """Nothing holds the handle within the play; friction is one number of the plant's map."""
    world, machine = load_world(), Machine(frictionless=False)
    vertical, model = world.vertical, machine.model
    half = 0.5 * vertical.play
    assert model.tendon_lengthspring[model.tendon("play").id] == pytest.approx([-half, half])
    turn_rate = 2.0 * math.pi / vertical.lead
    friction = model.dof_frictionloss[machine.at("screw")] * turn_rate
    friction += model.dof_frictionloss[machine.at("vertical")]
    levels = [steady_level(world.friction, turn_rate, world.start.position, speed, against)
              for speed in (0.01, 0.03, 0.1) for against in (True, False)]  # fmt: skip
    assert min(levels) < friction < max(levels)
    assert friction == pytest.approx(float(np.mean(levels)), rel=0.2)


def test_a_stiffer_load_is_met_at_the_end_of_travel(plant):
    """The stop gives way by force / stiffness, within 2 %."""
    machine, vertical = Machine(), load_world().vertical
    machine.data.qpos[machine.at("vertical")] = vertical.travel
    machine.data.qpos[machine.at("screw")] = vertical.travel * 2.0 * math.pi / vertical.lead
    machine.data.body("carriage").xfrc_applied[2] = 60.0
    machine.steps(1.5)
    pressed = 60.0 - vertical.moving_mass * vertical.gravity
    deep = machine.data.qpos[machine.at("vertical")] - vertical.travel
    assert deep == pytest.approx(pressed / vertical.stop_stiffness, rel=0.02)
