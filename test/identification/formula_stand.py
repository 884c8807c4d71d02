# SPDX-License-Identifier: Apache-2.0
"""A stand that makes samples by formulas: experiments must find what its numbers hide."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control.laws import LAWS
from screw_module_ros.control.linearization import IDENTITY, Linearization, default_linearization
from screw_module_ros.geometry import Screw, counts_to_height
from screw_module_ros.identification import friction_model, sampled
from screw_module_ros.identification.results import Quantity, Result
from screw_module_ros.identification.static_torque import commands
from screw_module_ros.identification.trials import (
    WAYS_OUT,
    AnalyzerTrial,
    MotionTrial,
    Samples,
    StageTrial,
    TorqueTrial,
)

COUNT = 0.01905 / 20_000  # travel of one count on the thesis's screw [m]
PRESLIDING = 2.5e-6  # of the nut [m/N]


class Module(NamedTuple):
    """Friction against gravity is `friction` + `against` [N], with it without `against`.

    rollers: their ripple [N]; guide: friction of the handle's guide, which that friction contains
    [N]; worn: what the friction grows by from trial to trial [N]; lead: of the screw [m], for which
    the encoder is set too.
    """

    weight: float = 10.04
    against: float = -1.0
    friction: float = 8.0
    rollers: float = 0.4
    play: float = 1e-4
    compliance: float = 5e-8
    film: float = 700.0
    guide: float = 0.3
    mass: float = 5.49
    noise: float = 0.02
    worn: float = 0.0
    lead: float = 0.01905

    def level(self, z, speed, against):
        """Return |friction| [N] at heights z [m] and a speed [m/s]."""
        place = self.friction + 8.0 * z + self.against * against
        turn = 2.0 * np.pi / self.lead
        place = place + 1.5 * np.sin(turn * z + 0.7) + self.rollers * np.sin(4.0 * turn * z)
        return place * (0.9 + 2.5 * speed) + 2.0 * (1.0 - z / 0.18) / (1.0 + (speed / 0.008) ** 2)


class Motor(NamedTuple):
    """An amplifier (pole [Hz], lag [s]) behind software (delay [s]), a rotor on a transducer.

    It gives `gain` Nm of torque for a Nm of command beyond a soft dead zone [Nm].
    """

    gain: float = 1.0
    dead: float = 0.0
    pole: float = 1000.0
    lag: float = 60e-6
    delay: float = 280e-6
    damping: float = 5.0
    noise: float = 0.0012

    def torque(self, command):
        """Return what a slow command yields [Nm]."""
        lost = self.dead * np.tanh(0.8 * command / self.dead) if self.dead else 0.0
        return self.gain * (command - lost)


class FormulaBench:
    """Samples of a `Module` and of a `Motor`; asked: the trials so far."""

    rate, name, serial, offers = 2000.0, "made by formulas", "", frozenset(WAYS_OUT)
    laws, law_settings = LAWS, MappingProxyType({})

    def __init__(self, module: Module | None = None, motor: Motor | None = None):
        self.module, self.motor = module or Module(), motor or Motor()
        self.random = np.random.default_rng(5)
        self.asked: list = []
        self.screw = Screw(self.module.lead)

    def record(self, trial, told) -> Samples:
        """Do a trial."""
        self.asked.append(trial)
        if isinstance(trial, TorqueTrial | AnalyzerTrial):
            return self._sine(trial)
        made = self._stage(trial) if isinstance(trial, StageTrial) else self._motion(trial)
        time, position, force = made
        self.module = self.module._replace(friction=self.module.friction + self.module.worn)
        force = force + self.random.normal(0.0, self.module.noise, len(force))
        nothing = np.zeros_like(time)
        count = counts_to_height(1, self.screw)
        counted = np.floor(position / count) * count
        return Samples(time, counted, nothing, force, nothing, nothing, nothing)

    def _stage(self, trial: StageTrial):
        upright = -1.0 if trial.upside_down else 1.0
        # The handle hangs on the side that gravity pulls to, and then where it was left.
        free = self.module.play if trial.speed * upright > 0.0 else 0.0
        nut, load, ways = trial.start, -upright * self.module.weight, []
        for speed, _ in trial.ways:
            run = abs(trial.end - trial.start)
            ways.append(self._way(speed, run, nut, free, load, speed * upright > 0.0))
            (*_, nut), (*_, load) = ways[-1]
            free = self.module.play
        position, pushed = map(np.concatenate, zip(*ways, strict=True))
        time = np.arange(len(position)) / self.rate
        return time, position, pushed + upright * self.module.weight

    def _way(self, speed, run, nut, free, load, against):
        """Return positions of the nut and forces of one way, without the weight.

        run: of the handle; nut: where it is; free: play that the handle crosses first, leaving a
        contact with this load along z. Contact and presliding nut give way in proportion to it.
        """
        m, way, fast = self.module, np.sign(speed), abs(speed)
        gone = fast * np.arange(round(run / fast * self.rate)) / self.rate
        crossing = way * (m.film * fast + m.guide)
        if free:
            leaving = abs(load) * (m.compliance + PRESLIDING)
            left = np.clip(1.0 - gone / leaving, 0.0, 1.0)
            before = left * load + (1.0 - left) * crossing
            nut = nut - (1.0 - left) * load * PRESLIDING
            free += leaving
        else:
            before = np.full_like(gone, crossing)
        pushing = np.maximum(gone - free, 0.0)
        share = np.minimum(pushing / 2e-5, 1.0)
        level = m.level(nut + way * pushing, fast, against)
        nut = nut + way * np.maximum(pushing - share * level * m.compliance, 0.0)
        return nut, np.where(share > 0.0, way * share * level + (1.0 - share) * crossing, before)

    def _motion(self, trial: MotionTrial):
        time, z, v, a = hand(trial, self.rate)
        friction = np.sign(v) * self.module.level(z, np.abs(v), v > 0.0)
        return time, z, self.module.mass * a + friction + self.module.weight

    def _sine(self, trial: TorqueTrial | AnalyzerTrial) -> Samples:
        motor, rate = self.motor, trial.rate or self.rate
        time = np.arange(round(trial.duration * rate)) / rate
        turn = trial.amplitude * np.exp(2j * np.pi * trial.frequency * time)
        draw = np.random.default_rng(len(self.asked))

        def behind(delay, *chain):
            """Return the sine behind amplifier, delay and chain."""
            chain, at = sampled.series(sampled.first_order(motor.pole), *chain), [trial.frequency]
            return (sampled.sampled_response(chain, np.array(at), rate, delay)[0] * turn).imag

        def played(sine):
            line = getattr(trial, "linearization", None) or IDENTITY
            return sine if line == IDENTITY else commands(line, sine)

        nothing, late = np.full_like(time, np.nan), motor.lag + motor.delay
        if isinstance(trial, AnalyzerTrial):
            torque, current = nothing, behind(motor.lag)
        else:
            rotor = sampled.second_order(1.96e-5, motor.damping, 1e4)
            torque = motor.torque(played(behind(late, rotor)))
            torque = torque + draw.normal(0.0, motor.noise, time.size)
            current = behind(late, sampled.current_sensor()) / 0.16
        current = current + draw.normal(0.0, 10.0 * motor.noise, time.size)
        return Samples(time, nothing, nothing, nothing, torque, played(turn.imag), current)


def hand(trial: MotionTrial, rate: float):
    """Return time, height, speed and acceleration of the sine that the hand makes."""
    time = np.arange(round(trial.duration * rate)) / rate
    angle, far, omega = trial.omega * time, trial.amplitude, trial.omega
    return (
        time,
        trial.centre + far * np.sin(angle),
        far * omega * np.cos(angle),
        -far * omega**2 * np.sin(angle),
    )


def keep(folder: Path, experiment: str, data=None, **values: float) -> None:
    """Leave the result of an experiment for those that need it."""
    found = tuple(Quantity(name, value, 0.1, "", name) for name, value in values.items())
    Result(experiment, found, {}, (), data or {}).save(folder)


def keep_line(folder: Path, line: Linearization = IDENTITY) -> None:
    """Leave a linearization as static_torque does."""
    cubic = {f"cubic_{3 - n}": value for n, value in enumerate(line.middle)}
    keep(folder, "static_torque", lower_joint=line.joints_Nm[0], upper_joint=line.joints_Nm[1],
         lower_slope=line.lower.slope, lower_offset=line.lower.offset_Nm,
         upper_slope=line.upper.slope, upper_offset=line.upper.offset_Nm, **cubic)  # fmt: skip


def keep_calibration(folder: Path, module) -> None:
    """Leave the results of an exact calibration of the thesis's module."""
    v = module.vertical
    keep_line(folder, default_linearization(module.amplifier.dead_zone))
    keep(folder, "friction_model", friction_model._as_data(thesis_friction()))
    keep(folder, "gravity", gravity=v.moving_mass * v.gravity, play=v.play)
    keep(folder, "inertia", mass=v.turning_mass + v.moving_mass)
    keep(folder, "torque_response", loop_delay=820e-6, delay=600e-6)
