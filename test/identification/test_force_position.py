# SPDX-License-Identifier: Apache-2.0
"""Force-position curves, the onset of chatter, and their figures."""

import math

import pytest

from screw_module_ros.identification import force_gain, force_position
from screw_module_ros.identification.lab import Lab

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def measured(bench, tmp_path_factory):
    """All curves with one cycle each."""
    lab = Lab(bench, tmp_path_factory.mktemp("curves"))
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
def test_offsets_are_the_thesis_s(measured, name, low, high):
    assert low < measured.value(f"offset_{name}") < high


def test_order_of_the_controllers_is_the_thesis_s(measured):
    names = ("pd_100", "damping_-25", "damping_-50", "feedback_1", "feedback_2", "feedback_5")
    offsets = [measured.value(f"offset_{name}") for name in names]
    assert offsets == sorted(offsets, reverse=True)


def test_firm_hand_reaches_the_limit_below(measured):
    # 45 N down is all the spring may push: below that the curve bulges away from it.
    low = measured.data["pd_1000/position"].min()
    assert 1000.0 * (0.18 - low) > 45.0


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


def test_backlash_limits_the_gain(bench, tmp_path):
    settings = force_gain.Settings(gains=(0.0, 5.0, 12.0, 20.0), resolution=0.5, duration=16.0)
    result = force_gain.run(Lab(bench, tmp_path), settings)
    loose, tight = (result.value(f"gain_{end}_backlash") for end in ("with", "without"))
    assert 4.0 < loose < 13.0, "above the thesis's 5, not far above"
    assert tight > 1.2 * loose
