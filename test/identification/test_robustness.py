# SPDX-License-Identifier: Apache-2.0
"""Benefit of a calibration, also on a rig that changed after it."""

import pytest

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import modes
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.identification import (
    force_error,
    friction_model,
    gravity,
    inertia,
    static_torque,
)
from screw_module_ros.identification.bench import LoopSettings
from screw_module_ros.identification.friction_model import _as_data
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.report import (
    Module,
    Outcome,
    robustness_head,
    robustness_rows,
)
from screw_module_ros.identification.results import Quantity, Result
from screw_module_ros.identification.trials import MotionTrial
from screw_module_ros.plant.settings import load_world

OBSERVER_FAST = force_error.RobustnessSettings(modes=(modes.OBSERVER,), cases=("fast",))


def result(experiment, data=None, **values):
    quantities = tuple(Quantity(name, v, 0.0, "", name) for name, v in values.items())
    return Result(experiment, quantities, {}, (), data or {})


@pytest.fixture
def lab(bench, tmp_path):
    """The thesis's module with an exact calibration."""
    vertical = bench.world.vertical
    line = default_linearization(bench.world.amplifier.dead_zone)
    cubic = {f"cubic_{3 - n}": v for n, v in enumerate(line.middle)}
    found = (
        result(friction_model.NAME,
               _as_data(thesis_friction())),
        result(static_torque.NAME, lower_joint=line.joints_Nm[0], upper_joint=line.joints_Nm[1],
               lower_slope=line.lower.slope, lower_offset=line.lower.offset_Nm,
               upper_slope=line.upper.slope, upper_offset=line.upper.offset_Nm, **cubic),
        result(gravity.NAME, gravity=vertical.moving_mass * vertical.gravity),
        result(inertia.NAME, mass=vertical.turning_mass + vertical.moving_mass),
    )  # fmt: skip
    for one in found:
        one.save(tmp_path)
    return Lab(bench, tmp_path)


def test_observer_gains_from_a_calibration_in_fast_motion_also_when_the_rig_changed(lab):
    found = force_error.run_changed(lab, OBSERVER_FAST)
    without, calibrated, changed = force_error.rms_of(found, modes.OBSERVER, "fast")
    assert calibrated < 0.9 * without
    assert changed < 0.95 * without
    assert changed != calibrated, "another rig"


def test_change_makes_the_friction_model_wrong(lab):
    """The same trial on the same bench, but for the seed of the change."""
    chosen = OBSERVER_FAST._replace(
        modes=(modes.FRICTION_COMPENSATION,), cases=("slow",), change=3
    )
    found = force_error.run_changed(lab, chosen)
    _, calibrated, changed = force_error.rms_of(found, modes.FRICTION_COMPENSATION, "slow")
    assert abs(changed - calibrated) > 0.1


def test_report_has_a_row_for_each_module_and_mode(lab):
    found = force_error.run_changed(lab, OBSERVER_FAST)
    module = Module(
        4, load_world(), LoopSettings(), lab.folder, {"robustness": Outcome(found, "", 1.0)}
    )
    assert robustness_head([module]) == ("module", "mode", "fast")
    ((name, mode, cell),) = robustness_rows([module])
    assert (name, mode) == ("seed 4", "OBSERVER")
    shown = [float(number) for number in cell.split(" / ")]
    assert shown == pytest.approx(force_error.rms_of(found, modes.OBSERVER, "fast"), abs=0.005)
    assert robustness_rows([module._replace(outcomes={})]) == []


def test_change_is_the_rig_s_own(bench):
    """A change does not persist in the bench."""
    trial = MotionTrial(modes.OBSERVER, VerticalSettings(), duration=0.5)
    before = bench.record(trial, lambda share: None).position
    bench.record(trial._replace(changed=5), lambda share: None)
    assert (bench.record(trial, lambda share: None).position == before).all()
