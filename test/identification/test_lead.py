# SPDX-License-Identifier: Apache-2.0
"""A screw with another lead than encoder and amplifier take for granted is found, and named.

Drive and encoder count the same shaft, so they agree with each other whatever the lead is; only
the stage, which has a scale of its own, tells.
"""

from __future__ import annotations

import pytest

from screw_module_ros.geometry import SCREW
from screw_module_ros.identification import friction_map, friction_spectrum, repeatability
from screw_module_ros.identification.bench import InProcessBench
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.trials import StageTrial
from screw_module_ros.plant.settings import load_world

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
