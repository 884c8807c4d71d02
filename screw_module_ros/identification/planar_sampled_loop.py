# SPDX-License-Identifier: Apache-2.0
"""Stability of the plane as a linear sampled system with a structure that bends.

The law is the one that the robot executes, by differences of `control.planar`, with the velocity
filters of both joints, about a handle that rests at its set point. The plant is `plant.planar`
there: inertia and viscous friction of the joints, motors with their pole, the structure's spring,
the module, and the environment as in `sampled_loop`, a mass, a spring and a damper at the handle,
the same in x and y. Sampling, hold, delay and the age of the force are exact. The loop is stable if
the spectral radius is below one. Dry friction is left out, as in sliding: at rest its bristles
stabilise (`stuck`).
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm

from ..compiled import compiled, packed
from ..control.laws.plane_impedance import PLANE_IMPEDANCE
from ..control.planar import PlanarInput
from ..control.planar_settings import PlanarSettings
from ..control.plane_envelope import enveloped, initial_state
from ..filters import lowpass_coefficients, velocity_settled
from ..geometry import inverse
from ..plant.planar import Planar, resting_plane
from .linearized import Linear, answers_of, filtered, floats_in, largest_stable, linear_of
from .trials import Arm, PlaneLoop

MOST = 30.0
"""Largest gain of a search: the law's own."""
_SETTLE_S = 2.0
planar_step = enveloped(PLANE_IMPEDANCE)
_Q, _W, _B, _V, _T = (slice(2 * part, 2 * part + 2) for part in range(5))
_STATES = 10  # angles and velocities of the joints, deflection, handle's velocity, motor torques


class Plane(NamedTuple):
    """robot: the plant's arm; environment: at the handle; x, y: where it rests [m]; stuck: the
    joints do not slide, their bristles act as springs and dampers."""

    robot: Planar
    environment: Arm = Arm()
    x: float = 0.0
    y: float = 0.0
    stuck: bool = False


def first_modes(plane: Plane) -> tuple[float, float]:
    """Return the frequencies of the module on the structure, joints and handle free [Hz].

    sqrt(k (1 / m + 1 / Lambda)) / 2 pi with Lambda the arm's inertia at the tip, in its principal
    directions, lowest first; the environment does not count.
    """
    jacobian, inertia = _geometry(plane)
    mobility = np.linalg.eigvalsh(jacobian @ np.linalg.solve(inertia, jacobian.T))
    robot = plane.robot
    low, high = np.sqrt(robot.structure_stiffness * (1.0 / robot.module_mass + mobility))
    return float(low) / (2.0 * math.pi), float(high) / (2.0 * math.pi)


def _geometry(plane: Plane) -> tuple[np.ndarray, np.ndarray]:
    """Return Jacobian [m] and inertia of the joints without the module [kg m^2]."""
    r = plane.robot
    s = resting_plane(r, plane.x, plane.y)
    jacobian = np.array([
        [-r.upper_arm * math.sin(s.shoulder), -r.forearm * math.sin(s.elbow)],
        [r.upper_arm * math.cos(s.shoulder), r.forearm * math.cos(s.elbow)],
    ])
    joints = r.joint_inertia
    coupling = joints.coupling * math.cos(s.elbow - s.shoulder)
    return jacobian, np.array([[joints.shoulder, coupling], [coupling, joints.elbow]])


def _continuous(plane: Plane) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return dynamics, input [per Nm of both commands] and the hand's force [N] of the states."""
    r, e, one = plane.robot, plane.environment, np.eye(2)
    jacobian, inertia = _geometry(plane)
    damping = 2.0 * r.structure_damping_ratio * math.sqrt(r.structure_stiffness * r.module_mass)
    spring, held = np.zeros((2, _STATES)), np.zeros((2, _STATES))
    spring[:, _B], spring[:, _V] = r.structure_stiffness * one, damping * one
    spring[:, _W] = -damping * jacobian
    held[:, _Q], held[:, _B], held[:, _V] = -e.stiffness * jacobian, -e.stiffness * one, (
        -e.damping * one
    )
    at_joints = jacobian.T @ spring
    at_joints[:, _T] += one
    at_joints[:, _W] -= r.viscous * one
    if plane.stuck:
        at_joints[:, _Q] -= r.bristle_stiffness * one
        at_joints[:, _W] -= r.bristle_damping * one
    a, push = np.zeros((_STATES, _STATES)), np.zeros((_STATES, 2))
    a[_Q, _W] = one
    a[_W] = np.linalg.solve(inertia, at_joints)
    a[_B, _V], a[_B, _W] = one, -jacobian
    a[_V] = (held - spring) / (r.module_mass + e.mass)
    pole = 2.0 * math.pi * r.bandwidth
    a[_T, _T], push[_T] = -pole * one, pole * one
    return a, push, held - e.mass * a[_V]


@functools.lru_cache(maxsize=4096)
def planar_law(law: PlanarSettings, loop: PlaneLoop, x: float, y: float) -> Linear:
    """Return the law about a handle that rests at its set point x, y [m].

    Inputs: both angles [rad], force of the patient x, y [N]; outputs: both torques [Nm]. The guard,
    which the linear loop leaves out, is off.
    """
    period = 1.0 / loop.rate
    settings = law._replace(chatter_limit=math.inf)
    memory = packed(initial_state(settings, PLANE_IMPEDANCE, settings))
    shoulder, elbow = inverse(x, y, law.arm)
    places = floats_in(memory.dtype)
    motions = np.array((velocity_settled(shoulder), velocity_settled(elbow)))
    given = packed(settings), x, y, period, lowpass_coefficients(loop.cutoff, period)
    answers = compiled(answers_of(_tick, 2))(
        given, memory, memory.view(np.float64), places, motions,
        np.array((shoulder, elbow, 0.0, 0.0)), round(_SETTLE_S / period),
    )  # fmt: skip
    return linear_of(answers, len(places) + motions.size)


def _tick(
    given: Any, memory: Any, motions: np.ndarray, seen: np.ndarray, settles: bool, made: np.ndarray
) -> None:
    """Carry out a tick of the law for `answers_of`: angles and force in, both torques out."""
    settings, x, y, period, smooth = given
    shoulder_speed = filtered(smooth, motions[0], seen[0], period)
    elbow_speed = filtered(smooth, motions[1], seen[1], period)
    inp = PlanarInput(
        seen[0], seen[1], shoulder_speed, elbow_speed, x, y, 0.0, 0.0, True, 0.0, 0.0, 0.0,
        seen[2], seen[3],
    )  # fmt: skip
    output = planar_step(settings[0], settings[0], memory[0], inp, period)
    made[0], made[1] = output.shoulder_torque, output.elbow_torque


class Sampled(NamedTuple):
    """The plant over a period: for each part of it the state's transition and input matrix; late:
    number of parts before a command acts, taken: before a force sample is taken; force: of the
    hand [N], of the states; queued: periods that a sample waits."""

    parts: tuple[tuple[np.ndarray, np.ndarray], ...]
    late: int
    taken: int
    force: np.ndarray
    queued: int


def sampled_plane(plane: Plane, loop: PlaneLoop) -> Sampled:
    """Return the plant over a period of the loop.

    Raises ValueError for a loop that `plane_loop` cannot run either: a delay of a period or more,
    a force without age.
    """
    period = 1.0 / loop.rate
    if not 0.0 <= loop.delay < period:
        raise ValueError(f"delay = {loop.delay:g} s: less than a period, {period:g} s, is wanted")
    if loop.force_age <= 0.0:
        raise ValueError(f"force_age = {loop.force_age:g} s: more than 0 is wanted")
    a, push, force = _continuous(plane)
    queued = math.ceil(loop.force_age / period * (1.0 - 1e-9)) - 1
    taken = (queued + 1) * period - loop.force_age
    times = sorted({0.0, loop.delay, taken, period})
    parts = []
    for begin, end in zip(times, times[1:], strict=False):
        whole = np.zeros((_STATES + 2, _STATES + 2))
        whole[:_STATES, :_STATES], whole[:_STATES, _STATES:] = a, push
        over = expm(whole * (end - begin))
        parts.append((over[:_STATES, :_STATES], over[:_STATES, _STATES:]))
    return Sampled(tuple(parts), times.index(loop.delay), times.index(taken), force, queued)


def radius(plant: Sampled, plane: Plane, loop: PlaneLoop, law: PlanarSettings) -> float:
    """Return the spectral radius of the closed loop; plant: of `sampled_plane`."""
    a, b, c, d = planar_law(law, loop, plane.x, plane.y)
    n, m, waiting = _STATES, len(a), plant.queued + 1
    size = n + m + 2 + 2 * waiting
    every = np.eye(size)  # each signal is a matrix: what it is of the loop's states
    state, memory, before = every[:n], every[n : n + m], every[n + m : n + m + 2]
    queue = [every[first : first + 2] for first in range(n + m + 2, size, 2)]
    seen = np.concatenate((state[_Q], queue[0]))
    command = c @ memory + d @ seen
    for number, (step, push) in enumerate(plant.parts):
        if number == plant.taken:
            newest = plant.force @ state
        state = step @ state + push @ (before if number < plant.late else command)
    after = np.concatenate((state, a @ memory + b @ seen, command, *queue[1:], newest))
    return float(np.abs(np.linalg.eigvals(after)).max())


def largest_gain(
    plane: Plane, loop: PlaneLoop, law: PlanarSettings, most: float = MOST
) -> float:
    """Return the largest force gain up to which the loop is stable, 0 for less than 1e-3.

    Its relative error is 1 %. law: its gain is varied; infinite if `most` is stable.
    """
    plant = sampled_plane(plane, loop)
    return largest_stable(
        lambda gain: radius(plant, plane, loop, law._replace(force_gain=gain)), most
    )
