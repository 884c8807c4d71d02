# SPDX-License-Identifier: Apache-2.0
"""The plane as one sampled loop in one function: what the in-process bench compiles.

One tick is one sample: both joints' counts in, the planar law, and the plant's substeps, in which
the torques of the tick before act until the delay is over. Law and plant are the functions that the
node `manus` and the simulated rig run; buses, gate and guide are left out.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..compiled import compiled, packed
from ..control.guard import share_left
from ..control.planar import PlanarInput, initial_state
from ..control.planar import planar_step as law_step
from ..control.planar_settings import PlanarSettings
from ..filters import (
    LowpassCoefficients,
    VelocityState,
    lowpass_coefficients,
    velocity_settled,
    velocity_step,
)
from ..plant.patient import HandPath, HumanArm, arm_force, hand_point
from ..plant.planar import (
    ManusInput,
    ManusState,
    PlanarParams,
    planar_params,
    planar_step,
    resting_plane,
    tip,
)
from ..plant.settings import WorldSettings
from .trials import WAY_S, OnProgress, PlanarTrial, Samples

RATE = 500.0  # of the node `manus` [1/s]
DELAY = 0.0007  # from a sample to its torque [s]
RADIAN = 9.587e-5  # of a count of the joints' encoders
CUTOFF = 30.0  # of the velocity filter [Hz]
COLUMNS = 7  # x, y, vx, vy of the handle; force of the patient x, y; share of the carried mass
_SETTLE_S = 1.5


class PlaneParams(NamedTuple):
    """What stays the same: plant, law, the hand's paths, filter of the velocities; period [s];
    steps: substeps in it; late: those before a torque acts; attached: a hand holds the handle."""

    plant: PlanarParams
    law: PlanarSettings
    path_x: HandPath
    path_y: HandPath
    smooth: LowpassCoefficients
    period: float
    steps: int
    late: int
    attached: bool


class PlaneState(NamedTuple):
    """ticks: since the trial began; the arm; the law's `PlanarState` from `compiled.packed`, which
    a tick changes in place; filters of both velocities; torques in force [Nm]."""

    ticks: int
    arm: ManusState
    law: Any
    shoulder: VelocityState
    elbow: VelocityState
    shoulder_torque: float
    elbow_torque: float


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
    robot = p.plant.robot
    shoulder, elbow = counted(s.arm.shoulder), counted(s.arm.elbow)
    shoulder_speed, first = velocity_step(p.smooth, s.shoulder, shoulder, p.period)
    elbow_speed, second = velocity_step(p.smooth, s.elbow, elbow, p.period)
    inp = PlanarInput(
        shoulder, elbow, shoulder_speed, elbow_speed, 0.0, 0.0, 0.0, 0.0, True, 0.0, 0.0, 0.0
    )
    output = law_step(p.law, s.law[0], inp, p.period)
    x, y = tip(robot, s.arm.shoulder, s.arm.elbow)
    w1, w2 = s.arm.shoulder_velocity, s.arm.elbow_velocity
    row[0], row[1] = x, y
    row[2] = -robot.upper_arm * math.sin(s.arm.shoulder) * w1
    row[2] -= robot.forearm * math.sin(s.arm.elbow) * w2
    row[3] = robot.upper_arm * math.cos(s.arm.shoulder) * w1
    row[3] += robot.forearm * math.cos(s.arm.elbow) * w2
    row[4], row[5] = s.arm.force_x, s.arm.force_y
    row[6] = min(share_left(s.law[0].x.chatter), share_left(s.law[0].y.chatter))
    arm = s.arm
    time = s.ticks * p.period
    hand_x, speed_x = hand_point(p.path_x, time)
    hand_y, speed_y = hand_point(p.path_y, time)
    for step in range(p.steps):
        now = step >= p.late
        arm = planar_step(
            p.plant, arm,
            ManusInput(
                output.shoulder_torque if now else s.shoulder_torque,
                output.elbow_torque if now else s.elbow_torque,
                True, True, False, False, p.attached, hand_x, hand_y, speed_x, speed_y,
            ),
        )  # fmt: skip
        hand_x += speed_x * p.plant.dt
        hand_y += speed_y * p.plant.dt
    return PlaneState(
        s.ticks + 1, arm, s.law, first, second, output.shoulder_torque, output.elbow_torque
    )


def counted(angle: float) -> float:
    """Return a joint angle [rad] as its encoder shows it."""
    return math.floor(angle / RADIAN) * RADIAN


def plane_samples(
    world: WorldSettings, trial: PlanarTrial, on_progress: OnProgress
) -> Samples:
    """Let the hand move in the plane; arrays of shape (n, 2), x and y. Raises as `on_progress`."""
    on_progress(0.0)
    params = _params(world, trial)
    arm = resting_plane(world.planar, 0.0, 0.0)
    state = PlaneState(
        0, arm, packed(initial_state(trial.settings)), velocity_settled(counted(arm.shoulder)),
        velocity_settled(counted(arm.elbow)), 0.0, 0.0,
    )  # fmt: skip
    still = HandPath(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    _, state = _ticks(params._replace(path_x=still, path_y=still), state, _SETTLE_S)
    held = min(trial.duration, trial.released_after)
    rows, state = _ticks(params, state._replace(ticks=0), held)
    if held < trial.duration:
        loose, _ = _ticks(params._replace(attached=False), state, trial.duration - held)
        rows = np.concatenate((rows, loose))
    time = np.arange(len(rows)) * params.period
    place, speed, force, share = rows[:, :2], rows[:, 2:4], rows[:, 4:6], rows[:, 6]
    nothing = np.zeros_like(place)
    return Samples(
        time, place, speed, force, nothing, nothing, nothing, place, speed, force, share
    )


def _ticks(
    params: PlaneParams, state: PlaneState, seconds: float
) -> tuple[np.ndarray, PlaneState]:
    rows = np.empty((round(seconds / params.period), COLUMNS))
    return rows, compiled(run_plane)(packed(params), state, rows)


def _params(world: WorldSettings, trial: PlanarTrial) -> PlaneParams:
    steps = round(1.0 / RATE / world.substep)
    arm = HumanArm("active", *trial.arm, 0.0)
    east, north = math.cos(trial.direction), math.sin(trial.direction)
    return PlaneParams(
        plant=planar_params(
            world.planar, arm_force(arm, world.vertical.gravity), world.substep
        ),
        law=trial.settings.validated(),
        path_x=_path(trial, east),
        path_y=_path(trial, north),
        smooth=lowpass_coefficients(CUTOFF, 1.0 / RATE),
        period=steps * world.substep,
        steps=steps,
        late=math.ceil(DELAY / world.substep * (1.0 - 1e-9)),
        attached=True,
    )


def _path(trial: PlanarTrial, share: float) -> HandPath:
    """Return the hand's path along one axis; share: of the direction of motion."""
    return HandPath(
        0.0, trial.way * share, 0.0, WAY_S if trial.way else 0.0, trial.amplitude * share,
        trial.omega, trial.tremor * share,
    )  # fmt: skip
