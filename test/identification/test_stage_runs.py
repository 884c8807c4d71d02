# SPDX-License-Identifier: Apache-2.0
"""Runs of the stage: reduced, repeated, and with a lead that nobody expects.

Drive and encoder count the same shaft, so they agree with each other whatever the lead is; only
the stage, which has a scale of its own, tells.
"""

from __future__ import annotations

import numpy as np
import pytest
from friction_bench import FakeBench, Module

from screw_module_ros.geometry import SCREW
from screw_module_ros.identification import friction_map, friction_spectrum, repeatability
from screw_module_ros.identification.bench import InProcessBench
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.repeatability import Settings
from screw_module_ros.identification.stage_runs import (
    BINS,
    CENTRES_MM,
    binned,
    cutoff_hz,
    lowpass_taps,
    steady_part,
    zero_phase,
)  # fmt: skip
from screw_module_ros.identification.trials import Samples, StageTrial
from screw_module_ros.plant.settings import load_world

RATE = 2000.0
COUNT = 0.01905 / 20_000


def stage_run(
    speed: float, force_of=lambda z: 0.0 * z, noise: float = 0.0, play: float = 1e-4
) -> tuple[StageTrial, Samples]:
    """A stage that gets going at 2 m/s^2, crosses the play, and brakes; force of the height."""
    start, end = (0.0, 0.36) if speed > 0.0 else (0.36, 0.0)
    time = np.arange(round(0.36 / abs(speed) * RATE) + 100) / RATE
    fast, ramp = abs(speed), abs(speed) / 2.0
    gone = np.where(time < ramp, time**2, fast * time - 0.5 * fast * ramp)
    left = np.maximum(0.36 - gone, 0.0)
    gone = np.minimum(np.maximum(gone - play, 0.0), 0.36)
    rough = np.random.default_rng(1).normal(0.0, noise, len(time)) if noise else 0.0
    position = start + np.sign(speed) * gone
    force = force_of(position) + 11.0 * np.sign(speed) * (time < ramp) + rough
    counted = np.floor(position / COUNT) * COUNT
    nothing = np.zeros_like(time)
    assert left[-1] < 0.01
    samples = Samples(time, counted, nothing, force, nothing, nothing, nothing)
    return StageTrial(speed, start, end), samples


def ripple(z: np.ndarray) -> np.ndarray:
    return 15.0 + 20.0 * z + 2.0 * np.sin(2.0 * np.pi * z / 0.01905)


def ripple_in_bins() -> np.ndarray:
    edges = np.linspace(CENTRES_MM - 1.25, CENTRES_MM + 1.25, 101) / 1e3
    return ripple(edges).mean(axis=0)


@pytest.mark.parametrize("speed", [0.005, -0.02, 0.15, -0.15])
def test_bins_hold_the_mean_force_of_their_height(speed):
    part = binned(*stage_run(speed, ripple, noise=0.05))
    known = np.isfinite(part["force"])
    assert known.mean() > 0.95
    beyond = np.abs(part["force"] - ripple_in_bins())[known]
    assert beyond.max() < 0.1
    assert np.median(beyond) < 0.02


def test_getting_going_is_left_out_not_smeared():
    trial, samples = stage_run(0.15, lambda z: 12.0 + 0.0 * z)
    part = binned(trial, samples)
    assert np.isnan(part["force"][:2]).all()  # 5.6 mm to reach the speed
    assert part["force"][np.isfinite(part["force"])] == pytest.approx(12.0, abs=1e-6)
    assert steady_part(trial, samples).start / RATE > 0.075


def test_error_is_the_noise_over_the_root_of_the_count():
    part = binned(*stage_run(0.02, ripple, noise=0.05))
    middle = slice(20, 120)
    assert part["error"][middle] == pytest.approx(0.05 / np.sqrt(part["count"][middle]), rel=0.1)
    assert part["count"][middle] == pytest.approx(250, abs=2)
    assert part["force"].shape == part["count"].shape == (BINS,)


@pytest.mark.parametrize("rate", [1000.0, 2000.0, 4000.0])
@pytest.mark.parametrize("speed", [0.0005, 0.025, 0.15])
def test_the_filter_passes_a_decade_and_stops_30_hz_above(speed, rate):
    taps = lowpass_taps(speed, rate)
    assert len(taps) == pytest.approx(400 * rate / 2000.0, rel=0.03)
    frequency = np.array([0.0, cutoff_hz(speed), cutoff_hz(speed) + 30.0, 0.49 * rate])
    time = np.arange(len(taps)) / rate
    gain = np.abs(np.exp(-2j * np.pi * np.outer(frequency, time)) @ taps)
    assert gain == pytest.approx([1.0, 1.0, 0.0, 0.0], abs=1e-3)


def test_the_filter_does_not_delay():
    time = np.arange(8000) / RATE
    slow = np.sin(2.0 * np.pi * 3.0 * time)
    smooth = zero_phase(slow, lowpass_taps(0.02, RATE))
    assert smooth[300:-300] == pytest.approx(slow[300:-300], abs=1e-4)


def test_a_nut_that_does_not_follow_the_stage_is_refused():
    trial, samples = stage_run(0.05)
    slipping = samples.position * (1.0 - samples.time / samples.time[-1])
    with pytest.raises(ValueError, match="is the stage coupled"):
        binned(trial, samples._replace(position=slipping))
    with pytest.raises(ValueError, match="a lead of 38.10 mm"):
        binned(trial, samples._replace(position=0.5 * samples.position))


ONE_SPEED = friction_map.Settings(speeds=(0.06,), inverted_speeds=(), low=0.135, high=0.165)


def bench(lead: float) -> InProcessBench:
    world = load_world()
    return InProcessBench(world._replace(vertical=world.vertical._replace(lead=lead)))


@pytest.mark.parametrize("lead", [0.0200, 0.0254, 0.0186])
def test_a_rig_with_another_lead_is_found(tmp_path, lead):
    with pytest.raises(ValueError, match=f"a lead of {1e3 * lead:.1f}. mm, encoder and amplifier"):
        friction_map.run(Lab(bench(lead), tmp_path), ONE_SPEED)


def test_the_rig_of_the_thesis_passes(tmp_path):
    assert friction_map.run(Lab(bench(SCREW.lead), tmp_path), ONE_SPEED).value("filled_up") > 0.05


@pytest.mark.parametrize("experiment", [repeatability, friction_spectrum])
def test_every_experiment_of_the_stage_finds_it(tmp_path, experiment):
    with pytest.raises(ValueError, match="a lead of 20.0"):
        experiment.run(Lab(bench(0.020), tmp_path), experiment.Settings())


def test_the_encoder_shows_turns_not_heights():
    """It was counted with the laws' lead, whatever screw the plant had."""
    trial = StageTrial(0.06, 0.135, 0.165)
    samples = bench(0.020).record(trial, lambda share: None)
    travel = samples.position[-1] - samples.position[0]
    assert travel == pytest.approx(0.030 * SCREW.lead / 0.020, rel=2e-3)
    assert samples.handle[-1] - samples.handle[0] == pytest.approx(0.030, abs=2e-4)


class Worn(FakeBench):
    """A module whose friction grows from one run to the next."""

    def record(self, trial, told):
        self.module = self.module._replace(friction=self.module.friction + 0.5)
        return super().record(trial, told)


def test_runs_of_one_module_differ_by_noise(tmp_path):
    result = repeatability.run(Lab(FakeBench(Module(noise=0.1)), tmp_path), Settings())
    for way in ("up", "down"):
        noise = result.value(f"noise_{way}")
        assert result.value(f"deviation_{way}") == pytest.approx(noise, rel=0.4)
        assert abs(result.value(f"difference_{way}")) < 0.01


def test_a_change_between_runs_is_seen(tmp_path):
    result = repeatability.run(Lab(Worn(Module()), tmp_path), Settings())
    assert result.value("difference_up") == pytest.approx(0.5 * (0.9 + 2.5 * 0.05), abs=0.01)
    assert result.value("difference_down") == pytest.approx(-0.5 * (0.9 + 2.5 * 0.05), abs=0.01)
