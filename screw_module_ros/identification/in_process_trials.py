# SPDX-License-Identifier: Apache-2.0
"""Translates trials to parameters of the compiled loop, and its rows to samples."""

from __future__ import annotations

import math

import numpy as np

from ..control.friction import FrictionModel
from ..control.linearization import IDENTITY, default_linearization
from ..geometry import COUNTS_PER_TURN, SCREW, counts_to_height
from ..plant.module import HUMAN_ARM, LOCKED_ROTOR, STAGE
from ..plant.patient import HandPath, resting
from ..plant.settings import WorldSettings
from .loop import (
    LAW,
    SINE,
    LoopParams,
)
from .trials import (
    WAY_S,
    AnalyzerTrial,
    MotionTrial,
    Samples,
    StageTrial,
    TorqueTrial,
    Trial,
)

ZERO_S = 0.5  # over which the transducer's zero is averaged
_SIDE_OMEGA = 2.0  # of the sideways force [rad/s]


def asked_for(quiet: LoopParams, trial: Trial, thesis: FrictionModel) -> LoopParams:
    """Return the parameters `quiet` with those of the trial; thesis: default friction model."""
    if isinstance(trial, TorqueTrial):
        return quiet._replace(
            kind=SINE,
            fixture=LOCKED_ROTOR,
            amplitude=float(trial.amplitude),
            omega=2.0 * math.pi * trial.frequency,
            chain=quiet.chain._replace(linearization=trial.linearization or IDENTITY),
        )
    if isinstance(trial, StageTrial):
        return quiet._replace(
            fixture=STAGE,
            upright=-1.0 if trial.upside_down else 1.0,
            stage_speed=abs(float(trial.speed)),
            stage_target=float(trial.end),
        )
    return quiet._replace(
        kind=LAW,
        fixture=HUMAN_ARM,
        mode=trial.mode,
        law=trial.settings.validated(),
        friction=trial.friction or thesis,
        chain=quiet.chain._replace(linearization=trial.linearization or default_linearization()),
        centre=float(trial.centre),
        path=resting(float(trial.centre)),
        side_force=float(trial.side_force),
        side_omega=_SIDE_OMEGA,
    )


def hand_path(trial: MotionTrial) -> HandPath:
    """Return the path of the virtual hand during the excitation."""
    c, way = float(trial.centre), float(trial.way)
    amplitude, omega, tremor = map(float, (trial.amplitude, trial.omega, trial.tremor))
    return HandPath(c, c + way, 0.0, WAY_S if way else 0.0, amplitude, omega, tremor)


def length_of(trial: Trial) -> float:
    """Return the duration of the samples [s], with a stage's acceleration and braking."""
    if isinstance(trial, StageTrial):
        return abs(trial.end - trial.start) / abs(trial.speed) + 0.05
    return trial.duration


def counted(height: float) -> float:
    """Return a height [m] rounded to the encoder's counts."""
    return counts_to_height(math.floor(height / SCREW.lead * COUNTS_PER_TURN))


def tared(params: LoopParams, force: float, torque: float) -> LoopParams:
    """Return the parameters with this force [N] and torque [Nm] as the transducer's zero."""
    t = params.transducer
    tared = t._replace(force_zero=t.force_zero - force, torque_zero=t.torque_zero - torque)
    return params._replace(transducer=tared)


def samples_of(rows: np.ndarray, params: LoopParams, force: float, torque: float) -> Samples:
    """Return the rows as samples, without the zeros' drift to `force` [N] and `torque` [Nm]."""
    time = np.arange(len(rows)) * params.period
    drifted = (time + 0.5 * ZERO_S) / (len(rows) * params.period + ZERO_S)
    return Samples(
        time,
        rows[:, 0],
        rows[:, 1],
        rows[:, 2] - drifted * force,
        rows[:, 3] - drifted * torque,
        rows[:, 4],
        *rows[:, 5:].T,
    )


def analyzer_samples(world: WorldSettings, trial: AnalyzerTrial) -> Samples:
    """Return command and current of an amplifier on an analyser; all other samples are zero."""
    from ..plant.instruments import analyzed

    command, current = analyzed(
        world.amplifier, trial.frequency, trial.amplitude, trial.duration, trial.rate
    )
    nothing = np.zeros_like(command)
    time = np.arange(len(command)) / trial.rate
    return Samples(time, nothing, nothing, nothing, nothing, command, current)
