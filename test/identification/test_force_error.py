# SPDX-License-Identifier: Apache-2.0
"""The laws on the simulated module, by the force error over all samples and by the thesis's offset.

In simulated time alone.
"""

import itertools
import math
import random

import numpy as np
import pytest
from formula_stand import keep_calibration

from screw_module_ros.control.modes import (
    COMBINED,
    FORCE_FEEDBACK,
    FRICTION_COMPENSATION,
    IMPEDANCE,
    OBSERVER,
)
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.identification import force_error, force_gain, force_position
from screw_module_ros.identification.force_error import reduced, rms_of, trial_of, with_damping
from screw_module_ros.identification.force_metric import ErrorOf
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.report import (
    Module,
    Outcome,
    robustness_head,
    robustness_rows,
)
from screw_module_ros.identification.stand import LoopSettings, SimulatedStand
from screw_module_ros.identification.trials import MotionTrial
from screw_module_ros.offset import Spring, offsets
from screw_module_ros.plant.settings import load_world

UNSEEN = (7101, 7102, 7103)
"""Rigs that no law was tuned on."""
DEFAULT = VerticalSettings()
BENCH = LoopSettings(rate=1000.0, command_delay=1.2e-3)


def nothing(share):
    """Take no notice of progress."""


def rig(seed, drawn=False):
    """Return a stand at 1 kHz with a rig; drawn: with play of 0.1 to 0.2 mm, 1.0 to 1.7 ms late."""
    world, loop = load_world(None, seed), BENCH
    if drawn:
        draw = random.Random(f"study10 {seed}")
        world = world._replace(vertical=world.vertical._replace(play=draw.uniform(1e-4, 2e-4)))
        loop = loop._replace(command_delay=draw.uniform(1.0e-3, 1.7e-3))
    return SimulatedStand(world, loop, seed or 1)


def found(stand, mode, case, law=DEFAULT):
    """Return the metric of a case."""
    trial = trial_of(case, mode, with_damping(law, mode))
    part = reduced(trial, stand.record(trial, nothing))
    return ErrorOf(**{name: float(value) for name, value in part.items()})


WALLS = ("wall_1e4_badly", "wall_1e6_badly")


@pytest.mark.parametrize(
    ("rigs", "modes", "cases", "limits", "drawn"),
    [
        # With a ramp over the velocity mode 2 shook the hand by 0.29 mm here, mode 4 by 0.06 mm.
        ((None,), (FRICTION_COMPENSATION, COMBINED), ("holding",),
         {"travel": 0.05e-3, "swing": 0.1}, False),
        # Rigs with less friction than the model. Fed forward in full, whatever the observer finds,
        # it let a held hand slip by 13 and 17 mm, and a released handle by 9 mm.
        ((6002, 6003), (COMBINED,), ("holding",), {"travel": 0.05e-3}, False),
        ((6008,), (COMBINED,), ("released",), {"travel": 0.05e-3}, False),
        (UNSEEN, (OBSERVER,), ("slow",), {"rms": 0.5}, False),
        (UNSEEN, (OBSERVER,), ("small",), {"rms": 0.4}, False),
        (UNSEEN, (OBSERVER,), ("fast",), {"rms": 0.8}, False),
        (UNSEEN, (OBSERVER,), ("holding",), {"rms": 0.3, "travel": 0.2e-3}, False),
        # The guard ends what no gain can be stable against.
        ((7101,), (FORCE_FEEDBACK, COMBINED, OBSERVER), WALLS, {"swing": 1.5}, False),
        # Missed in modes 3 and 4 since the screw has an axial support (here 9.5e6 N/m with a
        # damping ratio of 0.02): 1.8 and 1.6 N to the end of the trial, 0.01 and 0.1 if rigid.
        ((7101,), (FORCE_FEEDBACK, COMBINED), ("heavy_holding",), {"swing": 1.9}, False),
        ((7101,), (OBSERVER,), ("heavy_holding",), {"swing": 0.3}, False),
        # It swung by 2, 8 and 12 mm, with the model in where nobody holds the handle.
        ((6009, 6021, 6029), (COMBINED,), ("released",), {"travel": 0.3e-3}, True),
        # It hunted by 0.2 to 0.7 mm on some of these rigs: one count ended its rest.
        ((6003, 6015, 7001, 7002, 7026, 9004, 9017, 11017), (OBSERVER,),
         ("holding", "released"), {"travel": 0.05e-3}, True),
        # It shook for 0.69 s: 3 to 6 Hz, as a tremor.
        ((6012,), (OBSERVER,), ("wall_1e3_badly",), {"shaking": 0.5}, True),
        # It shook for 0.65 s on the second rig, with a guard's damper of 80 Ns/m.
        ((7021, 9029), (OBSERVER,), ("wall_1e4_badly",), {"shaking": 0.5}, True),
    ],
)  # fmt: skip
def test_limits_of_the_laws(rigs, modes, cases, limits, drawn):
    """On these rigs (drawn: as in `rig`) these modes keep the limits in these cases."""
    for seed, mode, case in itertools.product(rigs, modes, cases):
        error = found(rig(seed, drawn), mode, case)
        for name, limit in limits.items():
            assert getattr(error, name) < limit, (seed, mode, case, name)


@pytest.mark.parametrize("seed", UNSEEN)
def test_a_known_mass_is_carried_in_fast_motion_and_not_by_a_released_handle(seed):
    """Carried without a hand as well, the handle swung with 3.7 N rms."""
    stand = rig(seed)
    v = stand.world.vertical
    law = VerticalSettings(mass=v.turning_mass + v.moving_mass, gravity=v.moving_mass * v.gravity)
    carrying = law._replace(observer_inertia=0.7)
    before, after = (found(stand, OBSERVER, "fast", each) for each in (law, carrying))
    assert after.rms < 0.9 * before.rms
    released = found(stand, OBSERVER, "released", carrying)
    assert released.travel < 0.1e-3
    assert released.rms < 0.5  # tolerated at rest (`observer_rest`)


@pytest.mark.parametrize(("seed", "case"), [(6007, "fast"), (6007, "tremor"), (6013, "tremor")])
def test_the_guard_takes_no_hand_for_an_oscillation(seed, case):
    """Rigs on which hands come nearest to what the guard looks for."""
    assert found(rig(seed, drawn=True), OBSERVER, case).share == 1.0


def test_changed_mode_and_released_hand_make_no_jump():
    trial = trial_of("released", OBSERVER, with_damping(DEFAULT, OBSERVER))
    samples = rig(7101).record(trial, nothing)
    assert abs(samples.true_force[2900]) > 3.0
    assert abs(samples.true_force[3001:]).max() == 0.0, "let go"
    assert abs(samples.handle_velocity[3000:]).max() < 0.6
    assert reduced(trial, samples)["travel"] < 1e-3


def test_without_the_handle_s_truth_the_sensors_take_its_place(module):
    """As on the live graph: encoder and transducer, with the noise of the latter."""
    stand = SimulatedStand(module, LoopSettings(rate=1000.0))
    trial = trial_of("small", OBSERVER, with_damping(DEFAULT, OBSERVER), 0.0)
    assert trial.side_force == 0.0
    samples = stand.record(trial, nothing)
    known = float(reduced(trial, samples)["rms"])
    seen = samples._replace(handle=None, handle_velocity=None, true_force=None)
    noise = module.sensor.force_noise
    assert float(reduced(trial, seen)["rms"]) == pytest.approx(np.hypot(known, noise), rel=0.1)


def test_experiment_reports_every_case_in_every_mode(stand, tmp_path):
    chosen = force_error.Settings(modes=(IMPEDANCE, OBSERVER), cases=("small", "holding"))
    result = force_error.run(Lab(stand, tmp_path), chosen)
    assert {q.name for q in result.quantities} == {
        f"rms_{mode}_{case}" for mode in ("impedance", "observer") for case in ("small", "holding")
    }
    assert result.value("rms_observer_small") < 0.1 * result.value("rms_impedance_small")


@pytest.fixture
def calibrated(stand, tmp_path):
    """A lab with an exact calibration of the thesis's module."""
    keep_calibration(tmp_path, stand.world)
    return Lab(stand, tmp_path)


def test_observer_gains_from_a_calibration_in_fast_motion_also_when_the_rig_changed(calibrated):
    chosen = force_error.RobustnessSettings(modes=(OBSERVER,), cases=("fast",))
    result = force_error.run_changed(calibrated, chosen)
    without, known, changed = rms_of(result, OBSERVER, "fast")
    assert known < 0.9 * without and changed < 0.95 * without
    assert changed != known, "another rig"
    outcomes = {"robustness": Outcome(result, "", 1.0)}
    module = Module(4, load_world(), LoopSettings(), calibrated.folder, outcomes)
    assert robustness_head([module]) == ("module", "mode", "fast")
    ((name, mode, cell),) = robustness_rows([module])
    assert (name, mode) == ("seed 4", "OBSERVER")
    shown = [float(number) for number in cell.split(" / ")]
    assert shown == pytest.approx((without, known, changed), abs=0.005)
    assert robustness_rows([module._replace(outcomes={})]) == []


def test_change_makes_the_friction_model_wrong(calibrated):
    """The same trial on the same stand, but for the seed of the change."""
    mode = FRICTION_COMPENSATION
    chosen = force_error.RobustnessSettings(modes=(mode,), cases=("slow",), change=3)
    _, known, changed = rms_of(force_error.run_changed(calibrated, chosen), mode, "slow")
    assert abs(changed - known) > 0.1


@pytest.fixture(scope="module")
def curves(stand, tmp_path_factory):
    """All force-position curves with one cycle each."""
    lab = Lab(stand, tmp_path_factory.mktemp("curves"))
    return force_position.run(lab, force_position.Settings(cycles=1.0))


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("pd_100", 7.0, 13.0),  # fig 6-1: roughly 10 N each way
        ("pd_1000", 6.0, 14.0),  # fig 6-2: again roughly 10 N
        ("feedback_5", 0.8, 3.0),  # fig 6-10: perhaps 2 N
        ("simulated_pd", 7.0, 13.0),
        ("simulated_feedback_5", 0.8, 3.0),
        ("combined_5", 0.0, 0.6),
    ],
)
def test_offsets_are_the_thesis_s(curves, name, low, high):
    assert low < curves.value(f"offset_{name}") < high


def test_order_of_the_controllers_is_the_thesis_s(curves):
    names = ("pd_100", "damping_-25", "damping_-50", "feedback_1", "feedback_2", "feedback_5")
    offsets = [curves.value(f"offset_{name}") for name in names]
    assert offsets == sorted(offsets, reverse=True)


def test_firm_hand_reaches_the_limit_below(curves):
    # 45 N down is all the spring may push: below that the curve bulges away from it.
    assert 1000.0 * (0.18 - curves.data["pd_1000/position"].min()) > 45.0


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ({1.0: (1, 0.1), 2.0: (1, 0.2)}, (2.0, math.inf)),
        ({1.0: (1, 0.1), 2.0: (1, 0.9), 3.0: (1, 0.2)}, (1.0, 2.0)),
        ({0.0: (1, 0.9)}, (0.0, 0.0)),
    ],
)
def test_onset(rows, expected):
    assert force_gain.onset(rows, 0.5) == expected


@pytest.mark.parametrize(
    ("support", "with_backlash", "without"),
    [(1e7, (4.0, 6.0), (5.0, 7.0)), (1e12, (9.0, 13.0), (13.0, 18.0))],
)
def test_support_and_backlash_limit_the_gain(module, tmp_path, support, with_backlash, without):
    """On the support that is assumed, the support does, near the thesis's 5; on a rigid one play.

    Over 31 s the onset on the first is 4.3 with backlash: bursts come where friction is low.
    """
    vertical = module.vertical._replace(support_stiffness=support)
    stand = SimulatedStand(module._replace(vertical=vertical))
    settings = force_gain.Settings(gains=(0.0, 4.0, 5.0, 12.0, 20.0), resolution=1.0, duration=8.0)
    result = force_gain.run(Lab(stand, tmp_path), settings)
    loose, tight = (result.value(f"gain_{end}_backlash") for end in ("with", "without"))
    assert with_backlash[0] <= loose < with_backlash[1] and without[0] <= tight < without[1]
    assert result.quantity("gain_with_backlash").uncertainty <= 0.5, "half of the resolution"


@pytest.mark.parametrize(
    ("mode", "without"), [(IMPEDANCE, 9.2), (FORCE_FEEDBACK, 1.5), (OBSERVER, 0.10)]
)
def test_a_damper_adds_its_own_force_to_the_offset_of_every_mode(stand, mode, without):
    """What mode 5 leaves is not the damper's doing: without one, unchecked, it leaves as little."""
    free = DEFAULT._replace(damping=0.0, observer_damping_ratio=0.0)
    spring = Spring(DEFAULT.stiffness, 0.18)
    bare, damped = (
        offsets(samples.position, samples.velocity, samples.force, spring).mean
        for law in (free, free._replace(damping=6.0))
        for samples in [stand.record(MotionTrial(mode, law, duration=15.8), nothing)]
    )
    assert bare == pytest.approx(without, rel=0.1)
    assert 0.25 < damped - bare < 0.55
