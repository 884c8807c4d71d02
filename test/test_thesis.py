# SPDX-License-Identifier: Apache-2.0
"""The figures of the thesis, and what code asks of them."""

from __future__ import annotations

import math
import re

import pytest

from screw_module_ros import thesis
from screw_module_ros.identification import friction_model, static_torque
from screw_module_ros.identification.experiments import EXPERIMENTS
from screw_module_ros.identification.results import Published, Quantity, beside
from screw_module_ros.settings import SettingError

LONGEST = 25  # words of a description


def test_the_file_is_whole():
    found = thesis.facts()
    assert len(found) >= 300
    for key, fact in found.items():
        assert key.isidentifier() and fact.where and fact.quantity, key
        assert isinstance(fact.value, (int, float, str, list)), key
        assert len(fact.quantity.split()) <= LONGEST, key


def test_no_text_is_a_number():
    """YAML takes 6e-05, without a point, for text."""
    texts = {key: fact.value for key, fact in thesis.facts().items() if isinstance(fact.value, str)}
    assert {key: text for key, text in texts.items() if re.fullmatch(r"[-+.\de]+", text)} == {}


@pytest.mark.parametrize(
    ("asked", "wanted"),
    [
        (("lead",), 0.01905),
        (("lead", None, "mm"), 19.05),
        (("down_flip", None, "m"), 0.2125),
        (("viscous", 1), 27.0),
        (("viscous", 0, "Ns/m"), 24.0),
        (("d_planar_friction", 1, "N"), 1.1121),
        (("mass",), 5.49),
    ],
)
def test_figures(asked, wanted):
    assert thesis.figure(*asked) == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (("laed",), "no key 'laed'; lead is there"),
        (("qqqq",), "no key 'qqqq'$"),
        (("viscous",), "viscous = .* is not one number"),
        (("viscous", 2), "viscous of .* has no number 2"),
        (("lead", 0), "lead of .* has no number 0"),
        (("lead", None, "kg"), "a value in m cannot be given in kg"),
        (("grommet",), "is not one number"),
        (("patient_faces_robot",), "is not one number"),
    ],
)
def test_what_there_is_not_is_told(asked, said):
    with pytest.raises(SettingError, match=said):
        thesis.figure(*asked)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ([1], "a mapping of keys"),
        ({"a": 1.0}, "a lacks kind, quantity, unit, value, where"),
        ({"a": {"value": 1, "unit": "", "where": "1", "quantity": "b"}}, "a lacks kind$"),
        (
            {"a": {"value": 1, "unit": "", "where": "1", "kind": "heard", "quantity": "b"}},
            "kind = 'heard': one of requirement, ",
        ),
    ],
)
def test_a_wrong_file_is_told(content, said):
    with pytest.raises(SettingError, match=said):
        thesis.facts_of(content, "made.yaml")


def test_what_is_published_has_the_value_and_section_of_its_key():
    printed = Published("down_flip", 0.005, unit="m")
    assert printed.value == pytest.approx(0.2125) and printed.where == "5.2.5"
    factor = Published("up_low_speed", 0.1, computed=0.68)
    assert factor.value == 0.68 and factor.where == "5.2.5, computed"
    assert Published("simulated_reduction", 1.0, part=1).value == 2.0


def test_a_figure_in_another_unit_than_its_quantity_is_refused():
    height = Quantity("flip", 0.21, 0.0, "m", "where the ripple turns")
    assert beside({"flip": Published("down_flip", 0.01, unit="m")}, [height])[0].thesis
    with pytest.raises(SettingError, match="flip is in m, down_flip in mm"):
        beside({"flip": Published("down_flip", 0.01)}, [height])


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_figure_beside_a_quantity_is_in_the_file(experiment):
    module = __import__(EXPERIMENTS[experiment].run.__module__, fromlist=["THESIS"])
    for name, printed in getattr(module, "THESIS", {}).items():
        assert printed.where and math.isfinite(printed.value), name


def test_computed_figures_follow_from_the_printed_ones():
    """Speed factors at 150 and 0.5 mm/s, the lack of a correlation, the middle of a range."""
    found = friction_model.THESIS
    fastest = thesis.figure("stage_fastest", unit="mm/s")
    slowest = thesis.figure("stage_slowest", unit="mm/s")
    for way in ("up", "down"):
        slope, offset = thesis.fact(f"{way}_high_speed").value
        gain, power = thesis.fact(f"{way}_low_speed").value
        assert found[f"factor_fastest_{way}"].value == pytest.approx(
            slope * fastest + offset, rel=1e-3
        )
        assert found[f"factor_slowest_{way}"].value == pytest.approx(
            gain * slowest**power, rel=1e-3
        )
        assert found[f"viscous_{way}"].value == sum(thesis.fact("viscous").value) / 2.0
    lack = 1.0 - thesis.figure("linearized_correlation")
    assert static_torque.THESIS["lack"].value == pytest.approx(lack)
