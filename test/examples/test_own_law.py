# SPDX-License-Identifier: Apache-2.0
"""The example of a law of one's own, on the plant."""

import importlib.util
from pathlib import Path
from statistics import fmean

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_law.py"


def _example():
    spec = importlib.util.spec_from_file_location("own_law", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_force_feedback_makes_the_patient_feel_less_of_the_screw():
    """A gain of 4 leaves a fifth of the friction (eq 6.8)."""
    example = _example()

    def plain(position, velocity, hand):
        spring = example.STIFFNESS * (example.MIDDLE - position) - example.DAMPING * velocity
        return example.WEIGHT + spring

    def error(law):
        return fmean(abs(force - ideal) for t, _, force, ideal in example.felt(law) if t > 2.0)

    assert error(example.law) < 0.3 * error(plain)
    assert error(plain) > 4.0
