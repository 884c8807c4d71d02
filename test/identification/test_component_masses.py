# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from screw_module_ros.identification import component_masses
from screw_module_ros.identification.component_masses import PRINTED, Settings
from screw_module_ros.identification.screw_geometry import (
    INERTIA_ACROSS,
    REFLECTED,
    TABLE,
    candidates,
    cylinder,
)

DEFAULT = Settings()


@pytest.fixture(scope="module")
def result():
    return component_masses.run(None, DEFAULT)


def test_reflected_masses_fall_with_the_square_of_the_lead():
    twice = component_masses.run(None, DEFAULT._replace(lead=2 * DEFAULT.lead))
    assert twice.value("motor_rotor") == pytest.approx(2.132 / 4, abs=0.001)


def test_the_sum_is_that_of_the_components_reported(result):
    parts = sum(result.value(name) for name in PRINTED)
    assert result.value("sum_computed") == pytest.approx(parts)


def test_every_candidate_has_the_printed_inertia_across_its_axis():
    for screw in candidates().values():
        across = screw.mass * screw.length**2 / 12.0 + screw.inertia_axis / 2.0
        assert across == pytest.approx(INERTIA_ACROSS)


def test_a_known_cylinder_is_found_from_its_inertia():
    radius, length, density = 0.01, 0.5, 7850.0
    mass = density * math.pi * radius**2 * length
    found = cylinder(2 * radius, mass * (3 * radius**2 + length**2) / 12.0, density)
    assert found.length == pytest.approx(length)
    assert found.mass == pytest.approx(mass)
    assert found.diameter == pytest.approx(2 * radius)
    assert found.half_length == pytest.approx(length / 2)


def test_the_bar_that_reflects_the_tables_mass_is_thicker_than_what_was_measured():
    screw = candidates()[TABLE]
    assert screw.reflected() == pytest.approx(REFLECTED)
    assert screw.diameter > 0.015875


def test_a_groove_makes_the_screw_lighter_per_metre_and_thus_longer():
    screws = candidates()
    grooved, solid = screws["grooved"], screws["outer"]
    assert 0.90 < (grooved.mass / grooved.length) / (solid.mass / solid.length) < 0.96
    assert grooved.length > solid.length
