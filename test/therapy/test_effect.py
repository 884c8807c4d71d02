# SPDX-License-Identifier: Apache-2.0
"""Effect sizes: by hand, and where there is none."""

import math

import pytest

from screw_module_ros.therapy.measures import effect_size


def test_cohens_d_by_hand():
    """Means 2 and 5, variances 1 and 4 over 2 and 2 degrees: 3 / sqrt(2.5)."""
    assert effect_size([1.0, 2.0, 3.0], [3.0, 5.0, 7.0]) == pytest.approx(3.0 / math.sqrt(2.5))
    assert effect_size([3.0, 5.0, 7.0], [1.0, 2.0, 3.0]) == pytest.approx(-3.0 / math.sqrt(2.5))


def test_the_larger_group_counts_for_more():
    """Variances 2 over 1 degree and 1 over 2: pooled 4/3."""
    assert effect_size([0.0, 2.0], [2.0, 3.0, 4.0]) == pytest.approx(2.0 / math.sqrt(4.0 / 3.0))


@pytest.mark.parametrize("groups", [([], [1.0]), ([1.0], [1.0, 2.0]), ([1.0, 1.0], [2.0, 2.0])])
def test_no_spread_no_size(groups):
    assert math.isnan(effect_size(*groups))
