# SPDX-License-Identifier: Apache-2.0
"""A bench with a rotor on a transducer and a current sensor of known poles and delay."""

from __future__ import annotations

import numpy as np

from screw_module_ros.control.linearization import IDENTITY
from screw_module_ros.identification import sampled as models
from screw_module_ros.identification.results import Quantity, Result
from screw_module_ros.identification.trials import WAYS_OUT, Samples

KNOWN_DELAY = 60e-6


class SampledBench:
    """Answers a TorqueTrial with the exact sines of its models, and noise."""

    rate, name, serial, offers = 2000.0, "fake", "", frozenset(WAYS_OUT)

    def __init__(self, damping=5.0, delay=280e-6, noise=0.0012):
        self.delay, self.noise = delay + KNOWN_DELAY, noise
        amplifier = models.first_order(1000.0)
        self.rotor = models.series(amplifier, models.second_order(1.96e-5, damping, 1e4))
        self.sensor = models.series(amplifier, models.current_sensor())
        self.asked = []

    def record(self, trial, told):
        self.asked.append(trial)
        rate = trial.rate or self.rate
        time = np.arange(round(trial.duration * rate)) / rate
        turn = np.exp(2j * np.pi * trial.frequency * time)
        draw = np.random.default_rng(len(self.asked))

        def answer(chain, per_torque, noise):
            at = np.array([trial.frequency])
            value = per_torque * models.sampled_response(chain, at, rate, self.delay)[0]
            sine = (trial.amplitude * value * turn).imag
            return sine + draw.normal(0.0, noise, time.size)

        nothing = np.full_like(time, np.nan)
        return Samples(
            time, nothing, nothing, nothing,
            answer(self.rotor, 1.0, self.noise),
            trial.amplitude * turn.imag,
            answer(self.sensor, 1.0 / 0.16, 10.0 * self.noise),
        )  # fmt: skip


def keep_linearization(folder):
    """Leave a result of static_torque that changes nothing."""
    i = IDENTITY
    values = {
        "lower_joint": i.joints_Nm[0], "upper_joint": i.joints_Nm[1],
        "lower_slope": i.lower.slope, "lower_offset": i.lower.offset_Nm,
        **{f"cubic_{3 - n}": value for n, value in enumerate(i.middle)},
        "upper_slope": i.upper.slope, "upper_offset": i.upper.offset_Nm,
    }  # fmt: skip
    found = tuple(Quantity(name, value, 0.0, "", "") for name, value in values.items())
    Result("static_torque", found, {}).save(folder)
