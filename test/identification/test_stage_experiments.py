# SPDX-License-Identifier: Apache-2.0
"""Runs of the stage: reduced, and what they find in a module by formulas (thesis 5.2).

Drive and encoder count the same shaft, so they agree with each other whatever the lead is; only
the stage, which has a scale of its own, tells.
"""

from __future__ import annotations

import numpy as np
import pytest
from formula_stand import COUNT, FormulaBench, Module

from screw_module_ros.control import modes
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.geometry import SCREW, Screw
from screw_module_ros.identification import friction_map, friction_spectrum, repeatability
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.stage_runs import (
    BINS,
    CENTRES_MM,
    binned,
    cutoff_hz,
    lowpass_taps,
    steady_part,
)
from screw_module_ros.identification.stand import LoopSettings, SimulatedStand
from screw_module_ros.identification.trials import MotionTrial, Samples, StageTrial

RATE = 2000.0
SPEEDS = (0.005, 0.010, 0.020, 0.030, 0.050, 0.100, 0.150)


def stage_run(speed: float, force_of, noise: float = 0.0) -> tuple[StageTrial, Samples]:
    """A stage that gets going at 2 m/s^2 and crosses 0.1 mm of play; the force is of the height."""
    start, end = (0.0, 0.36) if speed > 0.0 else (0.36, 0.0)
    time = np.arange(round(0.36 / abs(speed) * RATE) + 100) / RATE
    fast, ramp = abs(speed), abs(speed) / 2.0
    gone = np.where(time < ramp, time**2, fast * time - 0.5 * fast * ramp)
    position = start + np.sign(speed) * np.clip(gone - 1e-4, 0.0, 0.36)
    force = force_of(position) + 11.0 * np.sign(speed) * (time < ramp)
    force = force + np.random.default_rng(1).normal(0.0, noise, len(time))
    nothing = np.zeros_like(time)
    counted = np.floor(position / COUNT) * COUNT
    samples = Samples(time, counted, nothing, force, nothing, nothing, nothing)
    return StageTrial(speed, start, end), samples


def ripple(z: np.ndarray) -> np.ndarray:
    return 15.0 + 20.0 * z + 2.0 * np.sin(2.0 * np.pi * z / 0.01905)


@pytest.mark.parametrize("speed", [0.005, -0.02, 0.15, -0.15])
def test_bins_hold_the_mean_force_of_their_height_and_its_error(speed):
    part = binned(*stage_run(speed, ripple, noise=0.05), SCREW)
    edges = np.linspace(CENTRES_MM - 1.25, CENTRES_MM + 1.25, 101) / 1e3
    known = np.isfinite(part["force"])
    assert known.mean() > 0.95
    beyond = np.abs(part["force"] - ripple(edges).mean(axis=0))[known]
    assert beyond.max() < 0.1 and np.median(beyond) < 0.02
    assert part["force"].shape == part["count"].shape == (BINS,)
    middle = slice(20, 120)
    assert part["count"][middle] == pytest.approx(5.0 / abs(speed), abs=2)
    noise = 0.05 / np.sqrt(part["count"][middle])
    assert np.mean(part["error"][middle] / noise) == pytest.approx(1.0, abs=0.1)


def test_getting_going_is_left_out_not_smeared():
    trial, samples = stage_run(0.15, lambda z: np.full_like(z, 12.0))
    force = binned(trial, samples, SCREW)["force"]
    assert np.isnan(force[:2]).all()  # 5.6 mm to reach the speed
    assert force[np.isfinite(force)] == pytest.approx(12.0, abs=1e-6)
    assert steady_part(trial, samples, SCREW).start / RATE > 0.075


@pytest.mark.parametrize("rate", [1000.0, 2000.0, 4000.0])
@pytest.mark.parametrize("speed", [0.0005, 0.025, 0.15])
def test_the_filter_passes_a_decade_and_stops_30_hz_above(speed, rate):
    taps = lowpass_taps(speed, rate, SCREW)
    assert len(taps) == pytest.approx(400 * rate / 2000.0, rel=0.03)
    passed = cutoff_hz(speed, SCREW)
    frequency = np.array([0.0, passed, passed + 30.0, 0.49 * rate])
    time = np.arange(len(taps)) / rate
    gain = np.abs(np.exp(-2j * np.pi * np.outer(frequency, time)) @ taps)
    assert gain == pytest.approx([1.0, 1.0, 0.0, 0.0], abs=1e-3)


def test_a_nut_that_does_not_follow_the_stage_is_refused():
    trial, samples = stage_run(0.05, ripple)
    slipping = samples.position * (1.0 - samples.time / samples.time[-1])
    with pytest.raises(ValueError, match="is the stage coupled"):
        binned(trial, samples._replace(position=slipping), SCREW)
    with pytest.raises(ValueError, match="a lead of 38.10 mm"):
        binned(trial, samples._replace(position=0.5 * samples.position), SCREW)


ONE_SPEED = {"speeds": (0.06,), "inverted_speeds": (), "low": 0.135, "high": 0.165}


@pytest.fixture
def bench_with(module):
    """Return a function that makes the simulated module with another lead."""
    return lambda lead: SimulatedStand(
        module._replace(vertical=module.vertical._replace(lead=lead))
    )


@pytest.mark.parametrize(
    ("experiment", "settings", "lead"),
    [
        (friction_map, ONE_SPEED, 0.0200),
        (friction_map, ONE_SPEED, 0.0254),
        (friction_map, ONE_SPEED, 0.0186),
        (repeatability, {}, 0.0200),
        (friction_spectrum, {}, 0.0200),
    ],
)
def test_a_rig_with_another_lead_is_found(tmp_path, bench_with, experiment, settings, lead):
    said = f"a lead of {1e3 * lead:.1f}. mm, encoder and amplifier are set for 19.05"
    with pytest.raises(ValueError, match=said):
        experiment.run(Lab(bench_with(lead), tmp_path), experiment.Settings(**settings))


@pytest.mark.parametrize("lead", [0.0127, 0.0254])
def test_the_lines_of_another_screw_are_found_at_its_own_turns(tmp_path, lead):
    bench = FormulaBench(Module(lead=lead, rollers=0.8))
    found = friction_spectrum.run(Lab(bench, tmp_path), friction_spectrum.Settings())
    assert found.value("screw_up") == pytest.approx(0.020 / lead, rel=0.05)
    assert found.value("rollers_up") == pytest.approx(4.0 * 0.020 / lead, rel=0.05)


def test_a_rig_whose_encoder_is_set_for_its_own_lead_passes(tmp_path, module):
    """Heights are heights again, and no run is refused."""
    other = module._replace(vertical=module.vertical._replace(lead=0.0127))
    bench = SimulatedStand(other, screw=Screw(0.0127))
    result = friction_map.run(Lab(bench, tmp_path), friction_map.Settings(**ONE_SPEED))
    assert result.value("filled_up") > 0.05
    samples = bench.record(StageTrial(0.06, 0.135, 0.165), lambda share: None)
    assert np.ptp(samples.position) == pytest.approx(0.030, rel=2e-3)


def test_a_law_presses_as_hard_through_another_screw(module):
    """The amplifier gives the torque that makes the force on this screw."""

    def held(lead):
        world = module._replace(vertical=module.vertical._replace(lead=lead))
        bench = SimulatedStand(world, LoopSettings(rate=1000.0), screw=Screw(lead))
        law = VerticalSettings(stiffness=400.0)
        trial = MotionTrial(modes.IMPEDANCE, law, amplitude=0.0, way=0.05, duration=4.0)
        return bench.record(trial, lambda share: None).true_force[-500:].mean()

    assert held(0.0127) == pytest.approx(held(0.01905), abs=3.0)


def test_the_rig_of_the_thesis_passes(tmp_path, stand):
    result = friction_map.run(Lab(stand, tmp_path), friction_map.Settings(**ONE_SPEED))
    assert result.value("filled_up") > 0.05


def test_the_encoder_shows_turns_not_heights(bench_with):
    """It was counted with the laws' lead, whatever screw the plant had."""
    samples = bench_with(0.020).record(StageTrial(0.06, 0.135, 0.165), lambda share: None)
    assert np.ptp(samples.position) == pytest.approx(0.030 * SCREW.lead / 0.020, rel=2e-3)
    assert np.ptp(samples.handle) == pytest.approx(0.030, abs=2e-4)


@pytest.mark.parametrize("worn", [0.0, 0.5])
def test_what_changes_between_two_runs_is_told_from_noise(tmp_path, worn):
    """Each run has more friction than the one before; a run downward feels it downward."""
    stand = FormulaBench(Module(noise=0.1, worn=worn))
    result = repeatability.run(Lab(stand, tmp_path), repeatability.Settings())
    for way, sign in (("up", 1.0), ("down", -1.0)):
        change = sign * worn * (0.9 + 2.5 * 0.05)
        assert result.value(f"difference_{way}") == pytest.approx(change, abs=0.01)
        noise = result.value(f"noise_{way}")
        assert result.value(f"deviation_{way}") == pytest.approx(noise, rel=0.4)


@pytest.mark.parametrize("rollers", [0.4, 0.0])
def test_screw_and_rollers_are_found_in_the_spectrum(tmp_path, rollers):
    stand = FormulaBench(Module(noise=0.05, rollers=rollers))
    result = friction_spectrum.run(Lab(stand, tmp_path), friction_spectrum.Settings())
    for way in ("up", "down"):
        for what, turns, force in (("screw", 1.0, 1.5), ("rollers", 4.0, rollers)):
            there = turns * 20.0 / 19.05 if force else np.nan
            force = force * (0.9 + 2.5 * 0.02) if force else np.nan
            found = result.value(f"{what}_{way}"), result.value(f"{what}_force_{way}")
            assert found[0] == pytest.approx(there, abs=0.06, nan_ok=True)
            assert found[1] == pytest.approx(force, rel=0.15, nan_ok=True)
    peaks = [friction_spectrum.Peak(*row) for row in result.data["peaks_up"]]
    assert friction_spectrum.nearest(peaks, 40.0 / 19.05) is None, "twice the screw's rate"
    assert any("no line of the rollers" in note for note in result.notes) == (not rollers)


def test_noise_alone_has_no_lines():
    frequency = np.arange(0.0, 1000.0, 0.056)
    noise = np.abs(np.random.default_rng(2).normal(0.0, 1e-3, len(frequency)))
    assert friction_spectrum.modes(frequency, noise, 1.05) == []


@pytest.fixture(scope="module")
def maps(tmp_path_factory):
    """Maps of the module by formulas at a few speeds."""
    settings = friction_map.Settings(speeds=SPEEDS, inverted_speeds=(0.005, 0.050))
    return friction_map.run(Lab(FormulaBench(), tmp_path_factory.mktemp("lab")), settings)


@pytest.mark.parametrize(
    ("name", "sign", "upright"),
    [("up", 1, 1), ("down", -1, 1), ("up_inverted", 1, -1), ("down_inverted", -1, -1)],
)
def test_the_maps_are_the_module(maps, name, sign, upright):
    z = np.linspace(-1.25e-3, 1.25e-3, 51)[:, None] + maps.data["centres"] / 1e3
    level = Module().level(z, 0.05, sign * upright > 0).mean(axis=0)
    measured = maps.data[name][SPEEDS.index(0.05)]
    beyond = measured - (sign * level + upright * Module().weight)
    assert np.nanmax(np.abs(beyond)) < 0.15
    assert np.isfinite(beyond).mean() > 0.97


def test_the_module_s_stribeck_velocity_is_found(maps):
    assert maps.value("stribeck_up") == pytest.approx(0.02, abs=0.008)
    assert maps.value("viscous_lower_up") == pytest.approx(2.5 * 7.7, rel=0.1)


def test_speeds_not_driven_upside_down_stay_empty_and_undrawn(maps):
    assert friction_map.measured(maps.data, "up_inverted").tolist() == [0, 4]
    assert np.isnan(maps.data["down_inverted"][1]).all()
    assert friction_map.nearest(maps.data, "up_inverted", 0.02) == 0
    data = {**maps.data, "up_inverted": np.full((7, 142), np.nan)}
    assert "5-20" not in friction_map.draw(maps._replace(data=data))


def test_the_default_is_the_thesis_s_plan():
    trials = friction_map._trials(friction_map.Settings())
    assert len(trials) == 14 * 2 * 2
    assert sum(trial.upside_down for trial in trials.values()) == 28
