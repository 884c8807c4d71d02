# SPDX-License-Identifier: Apache-2.0
import pytest

from screw_module_ros.identification import component_masses
from screw_module_ros.identification.component_masses import PRINTED, Settings

DEFAULT = Settings()


@pytest.fixture(scope="module")
def result():
    return component_masses.run(None, DEFAULT)


def test_the_table_adds_up(result):
    assert sum(PRINTED.values()) == pytest.approx(6.42)  # as the thesis prints it
    assert result.value("sum_printed") == pytest.approx(6.42)


def test_the_rotor_is_computed_from_its_inertia(result):
    assert result.value("motor_rotor") == pytest.approx(2.13, abs=0.005)


def test_reflected_masses_fall_with_the_square_of_the_lead():
    twice = component_masses.run(None, DEFAULT._replace(lead=2 * DEFAULT.lead))
    assert twice.value("motor_rotor") == pytest.approx(2.132 / 4, abs=0.001)


def test_measured_mass_is_about_15_percent_below_the_printed_sum(result):
    assert result.value("measured_below_printed") == pytest.approx(0.15, abs=0.01)
    assert result.value("measured_less_printed") == pytest.approx(-0.93)


def test_the_sum_is_that_of_the_components_reported(result):
    parts = sum(result.value(name) for name in PRINTED)
    assert result.value("sum_computed") == pytest.approx(parts)


def test_the_screw_as_heavy_as_printed_gives_the_printed_sum():
    result = component_masses.run(None, DEFAULT._replace(screw="table"))
    assert result.value("sum_computed") == pytest.approx(6.42, abs=0.01)


def test_gravity_carries_more_than_the_moving_parts_of_the_table(result):
    assert result.value("moving_mass") == pytest.approx(0.82)
    missing = result.quantity("weighed_less_moving")
    assert missing.value == pytest.approx(10.04 / 9.81 - 0.82)
    assert missing.value > 2 * missing.uncertainty


def test_settings_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="rotor_inertia"):
        component_masses.run(None, DEFAULT._replace(rotor_inertia=-1e-5))
