# SPDX-License-Identifier: Apache-2.0
"""Every experiment can be listed, ordered, given settings in YAML, and refuses what cannot be."""

from types import SimpleNamespace

import pytest
import yaml

from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.identification.experiments import EXPERIMENTS, listing, settings_from_yaml
from screw_module_ros.identification.lab import Lab, MissingResult
from screw_module_ros.identification.reproduce import ON_EVERY_MODULE
from screw_module_ros.identification.trials import (
    MOTION,
    WAYS_OUT,
    AnalyzerTrial,
    MotionTrial,
    NotPossible,
    PlanarTrial,
    StageTrial,
    TorqueTrial,
    require,
)
from screw_module_ros.settings import fields, plain, validated


def test_every_module_gets_what_its_experiments_need_first():
    """The calibration came to need the loop's delay, which only the thesis's module had."""
    for number, name in enumerate(ON_EVERY_MODULE):
        assert set(EXPERIMENTS[name].needs) <= set(ON_EVERY_MODULE[:number]), name


def test_needs_come_first():
    seen = set()
    for name, experiment in EXPERIMENTS.items():
        assert experiment.name == name
        assert set(experiment.needs) <= seen
        seen.add(name)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_defaults_are_valid_and_declared(name):
    kind = EXPERIMENTS[name].settings
    validated(kind())
    assert all(field.setting.text for field in fields(kind).values())
    assert settings_from_yaml("", kind) == kind()


def test_listing_names_every_experiment_with_a_line():
    lines = listing().splitlines()
    assert [line.split(" ")[0] for line in lines] == list(EXPERIMENTS)
    assert all(len(line.split(": ", 1)[1]) > 10 for line in lines)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("{omega: 1.5, curves: [pd_100]}", ""),
        ("{cycles: 3}", ""),
        ("[1, 2]", "a mapping of names"),
        ("{omega: [", "no YAML"),
        ("{speed: 1.0}", "speed is unknown; known are centre"),
        ("{omega: fast}", "omega = 'fast': a finite number is wanted"),
        (f"{{omega: {'x' * 999}}}", "omega = 'xxx"),
        ("{cycles: 1" + "0" * 350 + "}", "cycles = 1000"),
        ("{omega: 1" + "0" * 350 + "}", "omega = 1000"),
        ("{omega: 1.0e+400}", "omega = inf: a finite number"),
        ("{omega: true}", "omega = True: a finite number is wanted"),
        ("{omega: 99.0}", "omega = 99.0 rad/s: above the largest allowed, 3 rad/s"),
        ("{omega: .nan}", "a finite number is wanted"),
        ("{curves: pd_100}", "a list is wanted"),
        ("{curves: [1]}", "str is wanted"),
    ],
)
def test_settings_from_yaml(text, complaint):
    kind = EXPERIMENTS["force_position"].settings
    if complaint:
        with pytest.raises(ValueError, match=complaint.replace("[", r"\[")):
            settings_from_yaml(text, kind)
    else:
        assert isinstance(settings_from_yaml(text, kind), kind)


SPEEDS = {"speeds": (0.02, 0.01), "inverted_speeds": ()}
REFUSED = [
    ("static_torque", {"duration": 5.0}, "less than one period"),
    ("amplifier_response", {"low": 100.0, "high": 50.0}, "high = 50 Hz is not above low = 100 Hz"),
    ("current_response", {}, "static_torque is missing"),
    ("torque_response", {}, "static_torque is missing"),
    ("friction_spectrum", {"low": 0.1, "high": 0.15}, "four turns"),
    ("friction_map", SPEEDS, "ascending"),
    ("friction_map", {"inverted_speeds": (0.033,)}, "not among the speeds"),
    ("friction_map", {"low": 0.2, "high": 0.21}, "0.03 m or more"),
    ("friction_map", {"speeds": (5.0,), "inverted_speeds": ()}, "above the largest"),
    ("repeatability", {"low": 0.2, "high": 0.21}, "0.03 m or more"),
    ("gravity", {}, "friction_map is missing"),
    ("friction_model", {}, "friction_map is missing"),
    ("inertia", {"omegas": (4.0,)}, "one length"),
    ("inertia", {}, "friction_model is missing"),
    ("force_position", {"curves": ("pd",)}, "'pd': one of 'pd_100'"),
    ("force_error", {"cases": ("smal",)}, "'smal': one of 'slow'"),
    ("planar_stability", {"amplitude": 40.0}, "amplitude = 40"),
    ("planar_stability", {"first_mode": 0.0}, "first_mode = 0"),
    ("robustness", {}, "gravity is missing"),
    ("robustness", {"modes": (9,)}, "= 9: one of 0"),
    ("robustness", {"states": ("new",)}, "'new': one of 'uncalibrated'"),
    ("calibration", {}, "friction_model is missing"),
    ("planar_impedance", {"frequencies": (4.0,)}, "none is 2 Hz or less"),
    ("requirements", {}, "delivered_impedance is missing"),
    ("requirements", {"end_load": 0.0}, "end_load"),
]


@pytest.mark.parametrize(("name", "settings", "said"), REFUSED)
def test_what_cannot_be_done_is_refused(tmp_path, stand, name, settings, said):
    """Before any trial: the folder has no part afterwards."""
    kind, text = EXPERIMENTS[name].settings, yaml.safe_dump(plain(settings))
    with pytest.raises((ValueError, MissingResult), match=said):
        EXPERIMENTS[name].run(Lab(stand, tmp_path), settings_from_yaml(text, kind))
    assert not (tmp_path / "parts").exists()


LAW = VerticalSettings()


@pytest.mark.parametrize(
    ("trial", "said"),
    [
        (TorqueTrial(1.0, 0.1, 1.0), "locked rotor"),
        (AnalyzerTrial(1.0, 1.0, 1.0), "signal analyser"),
        (StageTrial(0.1, 0.1, 0.2), "positioning stage"),
        (PlanarTrial(PlanarSettings()), "plane are only there in process"),
        (MotionTrial(1, LAW, side_force=1.0), "side_force: 0.0"),
        (MotionTrial(1, LAW, tremor=0.001), "trembles"),
        (MotionTrial(1, LAW, changed=3), "a rig that changed"),
        (MotionTrial(1, LAW, preloaded=True), "preloaded: false"),
        (MotionTrial(1, LAW, way=0.05), "needs the simulated rig"),
        (MotionTrial(1, LAW, released_after=1.0), "needs the simulated rig"),
    ],
)
def test_a_trial_that_the_bench_lacks_is_refused_with_the_way_out(trial, said):
    with pytest.raises(NotPossible, match=said):
        require(trial, SimpleNamespace(offers=frozenset({MOTION})))
    require(trial, SimpleNamespace(offers=frozenset(WAYS_OUT)))
