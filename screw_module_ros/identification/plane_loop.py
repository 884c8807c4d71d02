# SPDX-License-Identifier: Apache-2.0
"""The plane as one sampled loop in one function: what the in-process stand compiles.

One tick is one sample: both joints' counts and the newest force sample in, the planar law, and the
plant's substeps, in which the torques of the tick before act until the delay is over. Law and plant
are the functions that the node `manus` and the simulated rig run; buses, gate and guide are left
out.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..compiled import compiled, packed
from ..control.laws.plane_impedance import PLANE_IMPEDANCE
from ..control.planar import PlanarInput
from ..control.planar_settings import PlanarSettings
from ..control.plane_envelope import enveloped, initial_state
from ..filters import (
    LowpassCoefficients,
    VelocityState,
    lowpass_coefficients,
    velocity_settled,
    velocity_step,
)
from ..geometry import jacobian
from ..plant.muscles import RESTED, Muscles, muscles_step
from ..plant.patient import ArmForce, HandPath, HumanArm, hand_point, held_up, resting
from ..plant.planar import (
    ManusInput,
    ManusState,
    PlanarParams,
    handle_place,
    planar_params,
    planar_step,
    resting_plane,
)
from ..plant.sensor import counted_force, normal_pair, seeded
from ..plant.settings import WorldSettings
from .trials import SWEPT, OnProgress, PlanarTrial, Samples

# x, y, vx, vy of the handle; force of the patient x, y; share of the force gain; force that the
# motors add; force that the law sees x, y
COLUMNS = 10
_SETTLE_S = 1.5
law_step = enveloped(PLANE_IMPEDANCE)


class PlaneParams(NamedTuple):
    """What stays the same: plant, law, its set point [m], the hand's paths, filter of the
    velocities; period [s]; radian: of a count; noise: of a force sample [N]; steps: substeps in a
    period; late: those before a torque acts; felt_at: that at which a force sample is taken; arm:
    behind a soft grip, which `plant.arm` then is; patient: his muscles; attached, soft: a hand
    holds the handle, with a soft grip; sweep: amplitude of the force that the motors add [N], over
    so many ticks."""

    plant: PlanarParams
    law: PlanarSettings
    centre_x: float
    centre_y: float
    path_x: HandPath
    path_y: HandPath
    smooth: LowpassCoefficients
    period: float
    radian: float
    noise: float
    steps: int
    late: int
    felt_at: int
    arm: ArmForce
    patient: HumanArm
    attached: bool
    soft: bool
    sweep_x: float
    sweep_y: float
    ticks: float


class Palm(NamedTuple):
    """The arm behind a soft grip: x, y [m], vx, vy [m/s]."""

    x: float
    y: float
    vx: float
    vy: float


class Felt(NamedTuple):
    """Newest force sample, x and y [N]; state of the noise."""

    x: float
    y: float
    first: int
    second: int


class PlaneState(NamedTuple):
    """ticks: since the trial began; the plane; the law's `PlaneState` from `compiled.packed`,
    which a tick changes in place; filters of both velocities; torques in force [Nm]; arm behind the
    grip; the patient's muscles; force sample; forces: samples under way, one for each period of
    age, first the one that the law sees, shape (n, 2) [N]."""

    ticks: int
    arm: ManusState
    law: Any
    shoulder: VelocityState
    elbow: VelocityState
    shoulder_torque: float
    elbow_torque: float
    palm: Palm
    muscles: Muscles
    felt: Felt
    forces: np.ndarray


def run_plane(packed_params: Any, state: PlaneState, columns: np.ndarray) -> PlaneState:
    """Run one tick per row of `columns`, shape (n, COLUMNS), and fill it.

    packed_params: PlaneParams from `compiled.packed`.
    """
    p = packed_params[0]
    for row in range(columns.shape[0]):
        state = plane_tick(p, state, columns[row])
    return state


def plane_tick(p: PlaneParams, s: PlaneState, row: np.ndarray) -> PlaneState:
    """Take a sample, answer it, let one period pass."""
    shoulder, elbow = counted(s.arm.shoulder, p.radian), counted(s.arm.elbow, p.radian)
    shoulder_speed, first = velocity_step(p.smooth, s.shoulder, shoulder, p.period)
    elbow_speed, second = velocity_step(p.smooth, s.elbow, elbow, p.period)
    forces = np.empty_like(s.forces)
    forces[:-1] = s.forces[1:]
    forces[-1, 0], forces[-1, 1] = s.felt.x, s.felt.y
    inp = PlanarInput(
        shoulder, elbow, shoulder_speed, elbow_speed, p.centre_x, p.centre_y, 0.0, 0.0, True,
        0.0, 0.0, 0.0, forces[0, 0], forces[0, 1],
    )  # fmt: skip
    output = law_step(p.law, p.law, s.law[0], inp, p.period)
    row[0], row[1] = handle_place(p.plant.robot, s.arm)
    row[2], row[3] = s.arm.handle_vx, s.arm.handle_vy
    row[4], row[5], row[6] = s.arm.force_x, s.arm.force_y, output.share
    turned = SWEPT[0] * s.ticks + 0.5 * (SWEPT[1] - SWEPT[0]) * s.ticks * s.ticks / p.ticks
    row[7] = math.sin(2.0 * math.pi * turned)
    row[8], row[9] = forces[0, 0], forces[0, 1]
    j11, j12, j21, j22 = jacobian(shoulder, elbow, p.law.arm)
    push_x, push_y = p.sweep_x * row[7], p.sweep_y * row[7]
    asked_1 = output.shoulder_torque + j11 * push_x + j21 * push_y
    asked_2 = output.elbow_torque + j12 * push_x + j22 * push_y
    arm, palm, felt = s.arm, s.palm, s.felt
    time = s.ticks * p.period
    hand_x, speed_x = hand_point(p.path_x, time)
    hand_y, speed_y = hand_point(p.path_y, time)
    for step in range(p.steps):
        if step == p.felt_at:
            felt = sampled(p, felt, arm)
        now = step >= p.late
        torque_1 = asked_1 if now else s.shoulder_torque
        torque_2 = asked_2 if now else s.elbow_torque
        if p.soft:
            inputs = ManusInput(
                torque_1, torque_2, True, True, False, False, p.attached, palm.x, palm.y, palm.vx,
                palm.vy, 0.0, 1.0,
            )  # fmt: skip
            palm = palm_step(p, palm, arm, hand_x, hand_y, speed_x, speed_y, -s.muscles.tone)
        else:
            inputs = ManusInput(
                torque_1, torque_2, True, True, False, False, p.attached, hand_x, hand_y, speed_x,
                speed_y, -s.muscles.tone, 1.0,
            )  # fmt: skip
        arm = planar_step(p.plant, arm, inputs)
        hand_x += speed_x * p.plant.dt
        hand_y += speed_y * p.plant.dt
    muscles = muscles_step(
        p.patient, 1.0, s.muscles, arm.force_x, arm.force_y, 0.0, arm.handle_vy, p.period
    )
    return PlaneState(
        s.ticks + 1, arm, s.law, first, second, asked_1, asked_2, palm, muscles, felt, forces,
    )  # fmt: skip


def counted(angle: float, radian: float) -> float:
    """Return a joint angle [rad] as its encoder shows it; radian: of a count."""
    return math.floor(angle / radian) * radian


def sampled(p: PlaneParams, s: Felt, arm: ManusState) -> Felt:
    """Return a new force sample, with noise and counts."""
    n1, n2, first, second = normal_pair(s.first, s.second)
    x, y = counted_force(arm.force_x + p.noise * n1), counted_force(arm.force_y + p.noise * n2)
    return Felt(x, y, first, second)


def palm_step(
    p: PlaneParams, s: Palm, arm: ManusState, hand_x: float, hand_y: float, speed_x: float,
    speed_y: float, away: float,
) -> Palm:  # fmt: skip
    """Return the arm behind a soft grip after a substep; hand, speed: of the virtual hand; away:
    pull of its muscles [N]."""
    x, y = handle_place(p.plant.robot, arm)
    grip, own, dt = p.plant.arm, p.arm, p.plant.dt
    push_x = own.stiffness * (hand_x - s.x) + own.damping * (speed_x - s.vx)
    push_y = own.stiffness * (hand_y - s.y) + own.damping * (speed_y - s.vy) + away
    if p.attached:
        push_x -= grip.stiffness * (s.x - x) + grip.damping * (s.vx - arm.handle_vx)
        push_y -= grip.stiffness * (s.y - y) + grip.damping * (s.vy - arm.handle_vy)
    to_vx, to_vy = s.vx + push_x / own.mass * dt, s.vy + push_y / own.mass * dt
    return Palm(s.x + to_vx * dt, s.y + to_vy * dt, to_vx, to_vy)


def plane_samples(
    world: WorldSettings, trial: PlanarTrial, seed: int, on_progress: OnProgress
) -> Samples:
    """Let the hand move in the plane; arrays of shape (n, 2), x and y from the trial's centre.

    seed: of the noise. Raises as `on_progress`, and ValueError for a centre out of reach.
    """
    on_progress(0.0)
    if trial.structure_stiffness:
        bent = world.planar._replace(structure_stiffness=trial.structure_stiffness)
        world = world._replace(planar=bent)
    params = _params(world, trial)
    x, y = trial.centre
    arm = resting_plane(world.planar, x, y)
    whole = (round(trial.loop.force_age / world.substep) - 1) // params.steps
    state = PlaneState(
        0, arm, packed(initial_state(trial.settings, PLANE_IMPEDANCE, trial.settings)),
        velocity_settled(counted(arm.shoulder, params.radian)),
        velocity_settled(counted(arm.elbow, params.radian)), 0.0, 0.0, Palm(x, y, 0.0, 0.0),
        RESTED, Felt(0.0, 0.0, *seeded(seed)), np.zeros((whole + 1, 2)),
    )  # fmt: skip
    to_start = HandPath(0.0, trial.path.start, 0.0, 0.5 * _SETTLE_S, 0.0, 0.0, 0.0)
    _, state = _ticks(_along(params, trial, to_start), state, _SETTLE_S)
    held = min(trial.duration, trial.released_after)
    params = _along(params, trial, trial.path)._replace(
        sweep_x=trial.sweep * math.cos(trial.pushed), sweep_y=trial.sweep * math.sin(trial.pushed)
    )
    rows, state = _ticks(params, state._replace(ticks=0), held)
    if held < trial.duration:
        loose, _ = _ticks(params._replace(attached=False), state, trial.duration - held)
        rows = np.concatenate((rows, loose))
    time = np.arange(len(rows)) * params.period
    place, speed, force, share = rows[:, :2] - (x, y), rows[:, 2:4], rows[:, 4:6], rows[:, 6]
    nothing = np.zeros_like(place)
    return Samples(
        time, place, speed, rows[:, 8:], nothing, trial.sweep * rows[:, 7], nothing, place, speed,
        force, share,
    )  # fmt: skip


def _ticks(
    params: PlaneParams, state: PlaneState, seconds: float
) -> tuple[np.ndarray, PlaneState]:
    rows = np.empty((round(seconds / params.period), COLUMNS))
    return rows, compiled(run_plane)(packed(params), state, rows)


def _params(world: WorldSettings, trial: PlanarTrial) -> PlaneParams:
    loop, dt = trial.loop, world.substep
    steps = round(1.0 / loop.rate / dt)
    arm = held_up(*trial.arm)
    soft = trial.grip.stiffness > 0.0
    return PlaneParams(
        planar_params(world.planar, trial.grip if soft else arm, dt),
        trial.settings.validated(),
        *trial.centre,
        resting(0.0),
        resting(0.0),
        lowpass_coefficients(loop.cutoff, 1.0 / loop.rate),
        period=steps * dt,
        radian=world.start.joint_resolution,
        noise=world.sensor.force_noise,
        steps=steps,
        late=math.ceil(loop.delay / dt * (1.0 - 1e-9)),
        felt_at=-round(loop.force_age / dt) % steps,
        arm=arm,
        patient=world.arm._replace(tone=trial.tone, fatigue=0.0),
        attached=True,
        soft=soft,
        sweep_x=0.0,
        sweep_y=0.0,
        ticks=trial.duration * loop.rate,
    )


def _along(params: PlaneParams, trial: PlanarTrial, path: HandPath) -> PlaneParams:
    """Return the parameters with a path of the hand in the trial's direction."""
    shares = math.cos(trial.direction), math.sin(trial.direction)
    x, y = (
        path._replace(
            start=centre + path.start * share, target=centre + path.target * share,
            amplitude=path.amplitude * share, tremor=path.tremor * share,
        )
        for centre, share in zip(trial.centre, shares, strict=True)
    )  # fmt: skip
    return params._replace(path_x=x, path_y=y)
