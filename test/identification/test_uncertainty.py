# SPDX-License-Identifier: Apache-2.0
"""What is stated as an uncertainty: sources together, few degrees of freedom, bounds, a jackknife.

The numbers are those of JCGM 100:2008 and of simulated samples with a known scatter.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from screw_module_ros.identification.results import Result, from_sources, load_result
from screw_module_ros.identification.uncertainty import (
    PER_INTERVAL,
    Source,
    bounded,
    jackknifed,
    stated,
)


@pytest.mark.parametrize(
    ("sources", "half"),
    [
        ([Source("noise", 1.0)], 1.96),
        ([Source("five runs", 1.0, 4.0)], 2.776),
        ([bounded("bound", math.sqrt(3.0))], 1.96),
        ([Source("noise", 3.0), bounded("bound", 4.0 * math.sqrt(3.0))], 5.0 * 1.96),
        # GUM H.1: 32 nm, in H.1.6 with 16.7 effective degrees of freedom, whose t is 2.113.
        ([Source("standard", 25.0, 18.0), Source("comparator", 9.7, 25.6),
          Source("expansion", 2.9, 50.0), Source("temperature", 16.6, 2.0)], 31.66 * 2.113),
        ([], math.nan),
        ([Source("unknown", math.nan), Source("noise", 1.0)], math.nan),
    ],
)  # fmt: skip
def test_half_of_the_interval_is_1_96_of_what_is_stated(sources, half):
    assert PER_INTERVAL * stated(sources) == pytest.approx(half, rel=2e-3, nan_ok=True)
    quantity = from_sources("weight", 10.0, sources, "N", "weight")
    assert quantity.interval == pytest.approx((10.0 - half, 10.0 + half), rel=2e-3, nan_ok=True)


def test_a_jackknife_over_groups_sees_what_their_samples_share():
    """Of a mean of groups with an offset each, it is the scatter of the groups over root n."""
    random = np.random.default_rng(4)
    held, count = 0, 400
    for _ in range(count):
        groups = [offset + random.normal(0.0, 0.1, 50) for offset in random.normal(3.0, 1.0, 5)]
        sources = jackknifed("groups", lambda some: [np.concatenate(some).mean()], groups)
        assert sources[0].standard == pytest.approx(
            np.std([g.mean() for g in groups], ddof=1) / math.sqrt(5.0), rel=1e-9
        )
        value = from_sources("mean", float(np.mean(groups)), sources, "", "mean")
        low, high = value.interval
        held += low < 3.0 < high
    # A fair 95 % holds 380 of 400 times, with a standard deviation of 4.4.
    assert 366 <= held <= 394


def test_two_groups_tell_no_scatter():
    (source,) = jackknifed("groups", lambda some: [float(np.mean(some))], [1.0, 2.0])
    assert math.isnan(source.standard)


def test_the_sources_stand_in_the_result_s_file(tmp_path):
    sources = (Source("runs", 0.1, 9.0), bounded("guide", 0.2))
    Result("gravity", (from_sources("gravity", 10.0, sources, "N", "weight"),), {}).save(tmp_path)
    found = load_result(tmp_path, "gravity").quantity("gravity")
    assert found.sources == sources and found.uncertainty == pytest.approx(stated(sources))
