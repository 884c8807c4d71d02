# SPDX-License-Identifier: Apache-2.0
"""The laws on the simulated module, by the force error over all samples; simulated time alone."""

import random

import numpy as np
import pytest

from screw_module_ros.control import modes
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.identification.bench import InProcessBench, LoopSettings
from screw_module_ros.identification.force_error import (
    Settings,
    reduced,
    run,
    trial_of,
    with_damping,
)
from screw_module_ros.identification.force_metric import ErrorOf
from screw_module_ros.identification.lab import Lab
from screw_module_ros.plant.settings import load_world

UNSEEN = (7101, 7102, 7103)
"""Rigs that no law was tuned on."""


DEFAULT = VerticalSettings()


def found(seed, mode, case, law=DEFAULT, **given):
    """Metric of a case on a rig at 1 kHz with 1.2 ms of delay."""
    world = load_world(None, seed)
    bench = InProcessBench(world, LoopSettings(rate=1000.0, command_delay=1.2e-3), seed or 1)
    trial = trial_of(case, mode, with_damping(law, mode), **given)
    part = reduced(trial, bench.record(trial, nothing))
    return ErrorOf(**{name: float(value) for name, value in part.items()})


@pytest.mark.parametrize("mode", [modes.FRICTION_COMPENSATION, modes.COMBINED])
def test_feed_forward_lets_a_held_hand_rest(mode):
    """With a ramp over the velocity mode 2 shook it by 0.29 mm here, mode 4 by 0.06 mm."""
    error = found(None, mode, "holding")
    assert error.travel < 0.05e-3
    assert error.swing < 0.1


@pytest.mark.parametrize(
    ("seed", "case"), [(6002, "holding"), (6003, "holding"), (6008, "released")]
)
def test_a_friction_model_that_is_too_strong_lets_a_hand_rest(seed, case):
    """Rigs with less friction than the model. Fed forward in full, whatever the observer finds, it
    let a held hand slip by 13 and 17 mm, and a released handle by 9 mm."""
    assert found(seed, modes.COMBINED, case).travel < 0.05e-3


@pytest.mark.parametrize("seed", UNSEEN)
@pytest.mark.parametrize(
    ("case", "rms"), [("slow", 0.5), ("small", 0.4), ("fast", 0.8), ("holding", 0.3)]
)
def test_observer_on_rigs_that_nobody_calibrated(seed, case, rms):
    error = found(seed, modes.OBSERVER, case)
    assert error.rms < rms
    if case == "holding":
        assert error.travel < 0.2e-3


def known(seed):
    """Numbers of the law with the mass that a calibration finds."""
    v = load_world(None, seed).vertical
    mass = v.turning_mass + v.moving_mass
    return VerticalSettings(mass=mass, gravity=v.moving_mass * v.gravity)


@pytest.mark.parametrize("seed", UNSEEN)
def test_a_known_mass_is_carried_in_fast_motion(seed):
    law = known(seed)
    before = found(seed, modes.OBSERVER, "fast", law)
    after = found(seed, modes.OBSERVER, "fast", law._replace(observer_inertia=0.7))
    assert after.rms < 0.9 * before.rms


@pytest.mark.parametrize("seed", UNSEEN)
def test_a_released_handle_does_not_swing_on_the_mass_that_is_carried(seed):
    """Carried without a hand as well, it swung with 3.7 N rms."""
    error = found(seed, modes.OBSERVER, "released", known(seed)._replace(observer_inertia=0.7))
    assert error.travel < 0.1e-3
    assert error.rms < 0.5  # tolerated at rest (`observer_rest`)


@pytest.mark.parametrize("case", ["wall_1e4_badly", "wall_1e6_badly", "heavy_holding"])
@pytest.mark.parametrize("mode", [modes.FORCE_FEEDBACK, modes.COMBINED, modes.OBSERVER])
def test_the_guard_ends_what_no_gain_can_be_stable_against(mode, case):
    error = found(7101, mode, case)
    assert error.swing < 1.5


def test_changed_mode_and_released_hand_make_no_jump():
    world = load_world(None, 7101)
    bench = InProcessBench(world, LoopSettings(rate=1000.0, command_delay=1.2e-3))
    law = with_damping(VerticalSettings(), modes.OBSERVER)
    trial = trial_of("released", modes.OBSERVER, law)
    samples = bench.record(trial, lambda share: None)
    assert abs(samples.true_force[2900]) > 3.0
    assert abs(samples.true_force[3001:]).max() == 0.0, "let go"
    assert abs(samples.handle_velocity[3000:]).max() < 0.6
    assert reduced(trial, samples)["travel"] < 1e-3


def test_experiment_reports_every_case_in_every_mode(tmp_path):
    bench = InProcessBench(load_world())
    chosen = Settings(modes=(modes.IMPEDANCE, modes.OBSERVER), cases=("small", "holding"))
    result = run(Lab(bench, tmp_path), chosen)
    assert {q.name for q in result.quantities} == {
        f"rms_{mode}_{case}" for mode in ("impedance", "observer") for case in ("small", "holding")
    }
    assert result.value("rms_observer_small") < 0.1 * result.value("rms_impedance_small")


def on_drawn_rig(seed, mode, case, law=DEFAULT):
    """Metric of a case on a rig with play of 0.1 to 0.2 mm and 1.0 to 1.7 ms of delay."""
    draw = random.Random(f"study10 {seed}")
    world = load_world(None, seed)
    world = world._replace(vertical=world.vertical._replace(play=draw.uniform(1e-4, 2e-4)))
    loop = LoopSettings(rate=1000.0, command_delay=draw.uniform(1.0e-3, 1.7e-3))
    trial = trial_of(case, mode, with_damping(law, mode))
    part = reduced(trial, InProcessBench(world, loop, seed).record(trial, nothing))
    return ErrorOf(**{name: float(value) for name, value in part.items()})


def nothing(share):
    """Take no notice of progress."""


@pytest.mark.parametrize("seed", [6009, 6021, 6029])
def test_a_friction_model_that_is_right_lets_a_released_handle_rest(seed):
    """It swung by 2, 8 and 12 mm on these rigs, with the model in where nobody holds the handle."""
    error = on_drawn_rig(seed, modes.COMBINED, "released")
    assert error.travel < 0.3e-3


@pytest.mark.parametrize("case", ["holding", "released"])
def test_observer_lets_a_handle_rest(case):
    """It hunted by 0.2 to 0.7 mm on some of these rigs: one count ended its rest."""
    rigs = (6003, 6015, 7001, 7002, 7026, 9004, 9017, 11017)
    assert max(on_drawn_rig(seed, modes.OBSERVER, case).travel for seed in rigs) < 0.05e-3


def test_the_guard_ends_a_slow_oscillation_that_the_robot_feeds():
    """It shook for 0.69 s: 3 to 6 Hz, as a tremor."""
    assert on_drawn_rig(6012, modes.OBSERVER, "wall_1e3_badly").shaking < 0.5


@pytest.mark.parametrize("seed", [7021, 9029])
def test_what_grows_before_the_guard_acts_dies_away_soon(seed):
    """It shook for 0.65 s on the second rig, with a guard's damper of 80 Ns/m."""
    assert on_drawn_rig(seed, modes.OBSERVER, "wall_1e4_badly").shaking < 0.5


@pytest.mark.parametrize(("seed", "case"), [(6007, "fast"), (6007, "tremor"), (6013, "tremor")])
def test_the_guard_takes_no_hand_for_an_oscillation(seed, case):
    """Rigs on which hands come nearest to what the guard looks for."""
    assert on_drawn_rig(seed, modes.OBSERVER, case).share == 1.0


def test_without_the_handle_s_truth_the_sensors_take_its_place():
    """As on the live graph: encoder and transducer, with the noise of the latter."""
    bench = InProcessBench(load_world(), LoopSettings(rate=1000.0))
    law = with_damping(DEFAULT, modes.OBSERVER)
    trial = trial_of("small", modes.OBSERVER, law, 0.0)
    assert trial.side_force == 0.0
    samples = bench.record(trial, nothing)
    known = float(reduced(trial, samples)["rms"])
    seen = samples._replace(handle=None, handle_velocity=None, true_force=None)
    noise = bench.world.sensor.force_noise
    measured = float(reduced(trial, seen)["rms"])
    assert measured == pytest.approx(np.hypot(known, noise), rel=0.1)
