# SPDX-License-Identifier: Apache-2.0
"""The example of a law of one's own: the patient feels its floor, and only there."""

import sys
from pathlib import Path
from statistics import fmean

import pytest

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_law"


@pytest.fixture
def example(monkeypatch):
    """The example's modules, as its README runs them."""
    monkeypatch.syspath_prepend(str(EXAMPLE))
    import mylab
    import try_it

    yield mylab, try_it
    for name in ("mylab", "try_it"):
        sys.modules.pop(name, None)


def test_the_hand_feels_the_floor(example):
    mylab, try_it = example
    rows = try_it.felt(6.0)
    assert not any(row.reason for row in rows)
    settled = rows[2000:]
    height, stiffness, _ = mylab.FloorSettings()
    below = [(height - row.position, -row.patient) for row in settled]
    below = [(depth, force) for depth, force in below if depth > 0.01]
    above = [abs(row.patient) for row in settled if 0.19 < row.position < 0.27]
    assert len(below) > 500 and len(above) > 500
    assert fmean(force for _, force in below) == pytest.approx(
        fmean(stiffness * depth for depth, _ in below), abs=2.0
    )
    assert max(above) < 7.0, "what is left of the screw's friction"
