# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from scipy.linalg import eigh

from screw_module_ros.identification import compliant_mounting as mounting
from screw_module_ros.identification.compliant_mounting import (
    Settings,
    absorber,
    half_length_for,
    profile,
    resonances,
    response,
)
from screw_module_ros.identification.screw_geometry import Bar

DEFAULT = Settings()
THIN = Bar(0.6, 0.5, 0.0)


@pytest.fixture(scope="module")
def result():
    return mounting.run(None, DEFAULT)


def test_a_thin_bar_on_equal_springs_has_the_textbook_frequencies():
    stiffness = 2e6
    found = profile(THIN, np.array([0.0, THIN.half_length]), stiffness, stiffness)[1]
    centre, end = math.sqrt(6 * stiffness / THIN.mass), math.sqrt(3 * stiffness / THIN.mass)
    assert found == pytest.approx(np.array([centre, end]) / (2 * math.pi))


def test_the_softest_springs_of_case_2_give_the_wanted_frequency(result):
    softest = result.value("case2_softest")
    again = mounting.run(None, DEFAULT._replace(case2_top=softest, case2_bottom=softest))
    assert again.value("case2_frequency_least") == pytest.approx(DEFAULT.wanted)


def test_the_half_length_for_500_hz_gives_500_hz():
    half = half_length_for(DEFAULT)
    thin = Bar(3 * DEFAULT.inertia_across / half**2, 2 * half, 0.0)
    assert mounting.case1(thin, mounting.positions(DEFAULT), DEFAULT)[1].min() == (
        pytest.approx(500.0)
    )


def test_the_dip_is_where_the_top_mass_resonates_on_its_two_springs(result):
    expected = math.sqrt((DEFAULT.case3_top + DEFAULT.case3_ground) / DEFAULT.top_mass)
    assert result.value("case3_antiresonance") == pytest.approx(expected)
    assert result.value("case3_resonance_low") < expected < result.value("case3_resonance_high")


@pytest.mark.parametrize("z", [0.0, 0.1, -0.15])
def test_peaks_are_those_of_two_masses_on_three_springs(z):
    settings = DEFAULT._replace(case3_top=4e6, case3_bottom=1e6, case3_ground=2e6, case3_nut=z)
    up, down = THIN.half_length - z, THIN.half_length + z
    stiffness = [[4e6 * up**2 + 1e6 * down**2, -4e6 * up], [-4e6 * up, 6e6]]
    inertia = np.diag([THIN.mass * (THIN.length**2 / 12 + z**2), settings.top_mass])
    expected = np.sqrt(eigh(stiffness, inertia, eigvals_only=True))
    assert resonances(absorber(THIN, settings)) == pytest.approx(expected)


def test_the_response_is_that_of_the_state_space():
    system, omega = absorber(THIN, DEFAULT), np.array([150.0, 1500.0, 4000.0])
    expected = [
        (system.C @ np.linalg.solve(1j * w * np.eye(5) - system.A, system.B))[0, 0] for w in omega
    ]
    assert response(system, omega) == pytest.approx(np.array(expected))
