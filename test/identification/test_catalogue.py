# SPDX-License-Identifier: Apache-2.0
"""The catalogue: every experiment can be listed, ordered, and given settings in YAML."""

import pytest

from screw_module_ros.identification.catalogue import EXPERIMENTS, listing, settings_from_yaml
from screw_module_ros.settings import fields, validated


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
