# SPDX-License-Identifier: Apache-2.0
"""A bench that knows an analytic module: for the tests of the friction experiments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from screw_module_ros.identification.trials import WAYS_OUT, MotionTrial, Samples, StageTrial

COUNT = 0.01905 / 20_000
TURN = 2.0 * np.pi / 0.01905


class Module(NamedTuple):
    """Friction against gravity is `friction` + `against` [N], with it without `against`."""

    weight: float = 10.04
    against: float = -1.0
    friction: float = 8.0
    play: float = 1e-4
    film: float = 700.0
    mass: float = 5.49
    noise: float = 0.02

    def level(self, z, speed, against):
        """Return |friction| [N] at heights z [m] and a speed [m/s]."""
        place = self.friction + 8.0 * z + self.against * against
        place = place + 1.5 * np.sin(TURN * z + 0.7) + 0.4 * np.sin(4.0 * TURN * z)
        return place * (0.9 + 2.5 * speed) + 2.0 * (1.0 - z / 0.18) / (1.0 + (speed / 0.008) ** 2)


class FakeBench:
    """Samples of `Module`, made by formulas."""

    rate, name, serial, offers = 2000.0, "made by formulas", "", frozenset(WAYS_OUT)

    def __init__(self, module: Module | None = None):
        self.module = module or Module()
        self.random = np.random.default_rng(5)

    def record(self, trial, told) -> Samples:
        """Do a stage or motion trial."""
        made = self._stage(trial) if isinstance(trial, StageTrial) else self._motion(trial)
        time, position, force = made
        force = force + self.random.normal(0.0, self.module.noise, len(force))
        nothing = np.zeros_like(time)
        counted = np.floor(position / COUNT) * COUNT
        return Samples(time, counted, nothing, force, nothing, nothing, nothing)

    def _stage(self, trial: StageTrial):
        m, way, speed = self.module, np.sign(trial.speed), abs(trial.speed)
        time = np.arange(round(abs(trial.end - trial.start) / speed * self.rate)) / self.rate
        handle = speed * time
        upright = -1.0 if trial.upside_down else 1.0
        against = way * upright > 0.0
        free = m.play if against else 0.0  # the handle hangs on the side that gravity pulls to
        nut = np.maximum(handle - free, 0.0)
        position = trial.start + way * nut
        pushed = np.minimum(nut / 2e-5, 1.0) * m.level(position, speed, against)
        if against:
            pushed = np.where(handle < free, m.film * speed, pushed)
        return time, position, way * pushed + upright * m.weight

    def _motion(self, trial: MotionTrial):
        m = self.module
        time = np.arange(round(trial.duration * self.rate)) / self.rate
        angle = trial.omega * time
        z = trial.centre + trial.amplitude * np.sin(angle)
        v = trial.amplitude * trial.omega * np.cos(angle)
        a = -trial.amplitude * trial.omega**2 * np.sin(angle)
        friction = np.sign(v) * m.level(z, np.abs(v), v > 0.0)
        return time, z, m.mass * a + friction + m.weight
