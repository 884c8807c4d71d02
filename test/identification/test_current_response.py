# SPDX-License-Identifier: Apache-2.0
"""Software delay of a known chain is found again through the current sensor (thesis 4.1.2)."""

from __future__ import annotations

import numpy as np
import pytest
from sampled_bench import SampledBench, keep_linearization

from screw_module_ros.identification import current_response
from screw_module_ros.identification.current_response import Settings
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.results import Quantity, Result

FEW = Settings(count=8, low=5.0)


@pytest.fixture
def lab(tmp_path):
    keep_linearization(tmp_path)
    return Lab(SampledBench(delay=280e-6), tmp_path)


def test_delay_with_an_honest_error(lab):
    result = current_response.run(lab, FEW)
    found = result.quantity("delay")
    assert found.value == pytest.approx(280e-6, abs=5e-6)
    assert abs(found.value - 280e-6) < 4.0 * found.uncertainty
    assert result.value("gain") == pytest.approx(1.0, rel=0.01)
    assert np.abs(result.data["model"] / result.data["measured"] - 1.0).max() < 0.02
    assert "as in the settings: 1000 Hz, 60 us" in result.notes[0]


def test_a_second_hold_takes_half_a_sample_from_the_delay(lab):
    result = current_response.run(lab, FEW)
    assert result.value("delay_two_holds") == pytest.approx(30e-6, abs=25e-6)


def test_the_measured_amplifier_is_used(lab):
    """With an assumed amplifier delay 50 us longer, the software delay is 50 us shorter."""
    measured = (Quantity("pole", 1000.0, 0.0, "Hz", ""), Quantity("delay", 110e-6, 0.0, "s", ""))
    Result("amplifier_response", measured, {}).save(lab.folder)
    result = current_response.run(lab, FEW)
    assert result.value("delay") == pytest.approx(230e-6, abs=5e-6)
    assert "as measured" in result.notes[0]
