# SPDX-License-Identifier: Apache-2.0
"""A machine that is too slow for real time is told of once, and once when it no longer is."""

from __future__ import annotations

from screw_module_ros.nodes.sim_rig import Slowness


def sentences(factors, speed=1.0):
    slowness = Slowness()
    return [told.split(":")[0] for factor in factors if (told := slowness.told(factor, speed))]


def test_each_change_is_told_once():
    assert sentences([0.0, 0.9, 0.4, 0.3, 0.55, 0.3, 0.7, 0.9, 0.52, 0.45]) == [
        "simulated time runs at 0.40 of real time",
        "simulated time keeps up again",
        "simulated time runs at 0.45 of real time",
    ]


def test_who_asked_for_slow_motion_is_not_told():
    assert sentences([0.04, 0.05], speed=0.05) == []
    assert len(sentences([0.02], speed=0.05)) == 1


def test_as_fast_as_it_goes_is_compared_with_real_time():
    assert len(sentences([0.4], speed=0.0)) == 1
    assert sentences([3.0], speed=0.0) == []
