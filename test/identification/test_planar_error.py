# SPDX-License-Identifier: Apache-2.0
"""The plane's law on the simulated arm, with and without compensation; simulated time alone."""

import math

import pytest

from screw_module_ros.identification.bench import InProcessBench
from screw_module_ros.identification.planar_error import (
    CASES,
    Settings,
    error_of,
    law_of,
    reduced,
)


def found(bench, kind, case, settings=None):
    trial = CASES[case].trial._replace(settings=law_of(settings or Settings(), kind))
    return error_of(reduced(trial, bench.record(trial, lambda share: None)))


def other_arm(module, friction, mass):
    """Another friction and module mass than the law assumes."""
    planar = module.planar
    planar = planar._replace(
        friction=friction * planar.friction, module_mass=mass * planar.module_mass
    )
    return InProcessBench(module._replace(planar=planar))


@pytest.mark.parametrize("case", ["fast_x", "fast_y", "fast_between"])
def test_the_hand_feels_less_mass_in_every_direction(bench, case):
    before, after = found(bench, "none", case), found(bench, "both", case)
    assert after.rms < 0.65 * before.rms
    assert after.share == 1.0, "a false alarm of the guard"


@pytest.mark.parametrize("case", ["slow_x", "slow_y", "heavy"])
def test_the_hand_feels_less_friction(bench, case):
    assert found(bench, "friction", case).rms < 0.85 * found(bench, "none", case).rms


@pytest.mark.parametrize(("friction", "mass"), [(0.8, 0.86), (1.35, 1.16)])
@pytest.mark.parametrize("case", ["holding", "released", "wall_1e4_badly", "wall_1e5_badly"])
def test_a_handle_at_rest_stays_there(module, case, friction, mass):
    """Carried at rest as well, the mass kept 1.7 N rms up on the wall of 1e5 N/m."""
    error = found(other_arm(module, friction, mass), "both", case)
    assert error.travel < 0.05e-3
    assert error.swing < 0.1
    assert error.shaking < 0.5


def test_a_trembling_hand_keeps_the_compensation(bench):
    error = found(bench, "both", "tremor")
    assert error.share == 1.0
    assert error.rms <= found(bench, "none", "tremor").rms


def test_samples_have_two_columns_and_the_hand_lets_go(bench):
    trial = CASES["released"].trial._replace(settings=law_of(Settings(), "none"))
    samples = bench.record(trial, lambda share: None)
    assert samples.handle.shape == (len(samples.time), 2)
    held = round(trial.released_after / (samples.time[1] - samples.time[0]))
    assert math.hypot(*samples.true_force[held - 5]) > 1.0
    assert abs(samples.true_force[held + 1 :]).max() == 0.0
