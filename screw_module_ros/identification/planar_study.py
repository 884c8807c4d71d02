# SPDX-License-Identifier: Apache-2.0
"""The plane on rigs drawn by seed, for the command `study`: without and with force feedback.

A rig is one of `load_world(seed)` whose arm, rate, delay, age of the force and counts of the joints
are drawn as well, the grip, and the place and direction of the motion in the workspace. The trials
are those of `planar_error`, and a hand that moves over the far edge of the workspace.
"""

from __future__ import annotations

import math
import random
from typing import NamedTuple

import numpy as np

from ..control.planar_settings import STUDIED_GAIN, PlanarSettings
from ..plant.patient import RIGID, ArmForce, soft_grip
from ..plant.settings import WorldSettings, load_world
from .bench import InProcessBench
from .planar_error import CASES as TRIALS
from .planar_error import Case, error_of, hand_to, reduced
from .trials import PlanarTrial, PlaneLoop

WITHOUT, WITH = 0, 1
FAR = 0.5 * math.pi  # direction of the far edge


class Rig(NamedTuple):
    """One robot, its patient's hand, and where and in which direction he moves it [m], [rad]."""

    world: WorldSettings
    loop: PlaneLoop
    grip: ArmForce
    centre: tuple[float, float]
    direction: float


def drawn(family: str, seed: int) -> Rig:
    """Return the rig of a family, of `study.FAMILIES`, and seed; the same for the same seed."""
    draw = random.Random(f"planar study {family} {seed}")

    def between(low: float, high: float) -> float:
        return math.exp(draw.uniform(math.log(low), math.log(high)))

    world = load_world(perturb_seed=seed)
    robot = world.planar
    robot = robot._replace(
        friction=robot.friction * between(0.7, 1.4),
        module_mass=robot.module_mass * between(0.85, 1.2),
        viscous=robot.viscous * between(0.5, 2.0),
        bristle_stiffness=robot.bristle_stiffness * between(0.5, 2.0),
        bandwidth=between(300.0, 1000.0),
    )
    radian = 2.0 * math.pi / draw.choice((16384, 32768, 65536))
    world = world._replace(planar=robot, start=world.start._replace(joint_resolution=radian))
    rate = draw.choice((250.0, 500.0, 500.0))
    loop = PlaneLoop(rate, between(0.4e-3, 1.8e-3), between(1e-3, 3e-3))
    grip = soft_grip(between(2e3, 2e4), between(10.0, 60.0), draw.uniform(0.3, 0.6))
    centre = draw.uniform(-0.08, 0.08), draw.uniform(-0.1, 0.1)
    return Rig(world, loop, grip if family == "B" else RIGID, centre, draw.uniform(0.0, math.pi))


def _over(way: float, seconds: float) -> Case:
    """Return a hand that moves from the middle by `way` [m] over the far edge, at 0.23 m."""
    trial = PlanarTrial(PlanarSettings(), direction=FAR, path=hand_to(way, seconds), duration=3.0)
    return Case("", trial, "over blow shaking")


CASES = {
    **TRIALS,
    "far_edge_slow": _over(0.30, 2.0),
    "far_edge_1.0": _over(0.26, 0.4),
    "far_edge_1.3": _over(0.30, 0.35),
}


def measured(family: str, seed: int, kind: int, name: str) -> dict[str, float]:
    """Return the figures of one case on one rig, without or with feedback."""
    law = PlanarSettings(force_gain=STUDIED_GAIN)
    return measured_with(family, seed, law if kind == WITH else law._replace(force_gain=0.0), name)


def measured_with(family: str, seed: int, law: PlanarSettings, name: str) -> dict[str, float]:
    """Return the figures of one case on one rig with a law."""
    rig, case = drawn(family, seed), CASES[name]
    trial = case.trial._replace(
        settings=law._replace(stiffness=case.trial.settings.stiffness), loop=rig.loop,
        centre=rig.centre, direction=rig.direction,
    )  # fmt: skip
    if case.trial.direction == FAR and "over" in case.figures:
        trial = trial._replace(centre=(rig.centre[0], 0.0), direction=FAR)
    if trial.arm.mass:  # a wall has none, and no grip
        trial = trial._replace(grip=rig.grip)
    samples = InProcessBench(rig.world, seed=seed).record(trial, lambda share: None)
    found = error_of(reduced(trial, samples))
    first = round(trial.first / float(samples.time[1] - samples.time[0]))
    place, velocity, force = samples.felt
    error = force - trial.settings.stiffness * place - trial.settings.damping * velocity
    speed, over = np.hypot(*velocity.T), place[:, 1] + trial.centre[1] > law.half_depth
    figures = {
        "rms": found.rms,
        "share": float(samples.share[first:].min()),
        "shaking": found.shaking,
        "peak": float(np.hypot(*error[first:].T).max()),
        "travel": 1e3 * found.travel,
        "over": float(speed[over].max(initial=0.0)),
        "blow": float(np.hypot(*force.T).max()),
    }
    return {figure: figures[figure] for figure in case.figures.split()}
