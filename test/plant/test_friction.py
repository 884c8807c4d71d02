# SPDX-License-Identifier: Apache-2.0
"""Friction: the thesis's figures in the mean, and what goes beyond them."""

from __future__ import annotations

import math
import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.plant.friction import (
    ELASTIC,
    bristle_terms,
    settled_bristle,
    steady_level,
)

TURN_RATE = 2.0 * math.pi / 0.01905
STIFFNESS, DAMPING, DT = 4.0e5, 300.0, 50e-6


def without_ripples(friction):
    """The thesis's trend alone."""
    flat = {"rotation": (0.0,) * 6}
    return friction._replace(
        against=friction.against._replace(**flat),
        along=friction.along._replace(**flat),
        roller_amplitude=0.0,
        stribeck=0.0,
    )


@pytest.mark.parametrize(
    ("height", "against", "force"),
    [
        (0.0, True, 13.7),
        (0.2, True, 20.0),
        (0.35, True, 14.7),
        (0.0, False, 2.7),
        (0.2, False, -0.3),
        (0.35, False, -6.0),
    ],
)
def test_trend_is_the_thesis(settings, height, against, force):
    # Force to push the handle, gravity of 10 N included, at the speed where the factor is 1.
    m = settings.friction.against if against else settings.friction.along
    speed = (1.0 - m.intercept) / m.slope / 1000.0
    level = steady_level(without_ripples(settings.friction), TURN_RATE, height, speed, against)
    assert (10.0 + level if against else 10.0 - level) == pytest.approx(force, abs=0.05)


@pytest.mark.parametrize(("against", "largest"), [(True, 2.2), (False, 3.2)])
def test_turn_ripple_is_as_large_as_in_the_thesis(settings, against, largest):
    bare = without_ripples(settings.friction)
    rippled = bare._replace(against=settings.friction.against, along=settings.friction.along)
    m = settings.friction.against if against else settings.friction.along
    speed = (1.0 - m.intercept) / m.slope / 1000.0
    ripple = [
        steady_level(rippled, TURN_RATE, z / 1e4, speed, against)
        - steady_level(bare, TURN_RATE, z / 1e4, speed, against)
        for z in range(3550)
    ]
    assert max(map(abs, ripple)) == pytest.approx(largest, abs=0.15)


@pytest.mark.parametrize(
    ("speed", "against", "factor"),
    [(0.0005, True, 0.680), (0.15, True, 1.301), (0.0005, False, 0.730), (0.15, False, 1.298)],
)
def test_speed_factor_is_the_thesis(settings, speed, against, factor):
    bare = without_ripples(settings.friction)
    m = bare.against if against else bare.along
    mean_speed = (1.0 - m.intercept) / m.slope / 1000.0
    ratio = steady_level(bare, TURN_RATE, 0.2, speed, against) / steady_level(
        bare, TURN_RATE, 0.2, mean_speed, against
    )
    assert ratio == pytest.approx(factor, abs=0.002)


def test_map_is_held_beyond_its_range(settings):
    for against in (True, False):
        top = steady_level(settings.friction, TURN_RATE, 0.355, 0.02, against)
        bottom = steady_level(settings.friction, TURN_RATE, 0.0, 0.02, against)
        for beyond in (0.356, 0.36, 1.0):
            assert steady_level(settings.friction, TURN_RATE, beyond, 0.02, against) == top
        assert steady_level(settings.friction, TURN_RATE, -0.01, 0.02, against) == bottom


def test_breakaway_is_above_slow_motion_everywhere(settings):
    for z in range(0, 356, 5):
        for against in (True, False):
            stuck = steady_level(settings.friction, TURN_RATE, z / 1000, 0.0, against)
            for speed in (0.0005, 0.001, 0.0025, 0.02):
                moving = steady_level(settings.friction, TURN_RATE, z / 1000, speed, against)
                assert stuck > moving, (z, speed, against)


def test_stribeck_falls_in_the_lower_half_only_and_has_no_mean(settings):
    friction = settings.friction._replace(roller_amplitude=0.0)

    def mean_level(low, high, speed, f=friction):
        heights = range(low, high)
        return statistics.fmean(steady_level(f, TURN_RATE, z / 1000, speed, True) for z in heights)

    assert mean_level(30, 80, 0.003) > mean_level(30, 80, 0.02) + 0.3
    assert mean_level(230, 280, 0.003) < mean_level(230, 280, 0.02) - 0.3
    without = friction._replace(stribeck=0.0)
    assert mean_level(0, 356, 0.003) == pytest.approx(mean_level(0, 356, 0.003, without), abs=0.01)


def test_roller_ripple_is_four_per_turn(settings):
    points = 400
    levels = [
        steady_level(settings.friction, TURN_RATE, 0.2 + 0.01905 * i / points, 0.0477, True)
        for i in range(points)
    ]

    def harmonic(order):
        angle = 2.0 * math.pi * order / points
        a = sum(level * math.cos(angle * i) for i, level in enumerate(levels))
        b = sum(level * math.sin(angle * i) for i, level in enumerate(levels))
        return 2.0 * math.hypot(a, b) / points

    assert harmonic(4) == pytest.approx(settings.friction.roller_amplitude, rel=0.1)
    assert harmonic(1) > 3.0 * harmonic(4)
    assert harmonic(2) < 0.3 * harmonic(4)


def step(bristle, velocity, level):
    keep, slope, micro = bristle_terms(STIFFNESS, DAMPING, bristle, velocity, level, DT)
    after = settled_bristle(keep * bristle + slope * velocity, bristle, level)
    return after, after + micro * velocity


@pytest.mark.parametrize("velocity", [1e-4, 0.02, 0.5, -0.003, -1.0])
def test_steady_sliding_gives_the_level(velocity):
    bristle = friction = 0.0
    for _ in range(20_000):
        bristle, friction = step(bristle, velocity, 9.0)
    assert friction == pytest.approx(math.copysign(9.0, velocity), rel=1e-6)


def test_bristles_give_back_what_bent_them_below_the_elastic_limit():
    level, bristle = 9.0, 0.0
    reach = ELASTIC * level / STIFFNESS
    for velocity in [0.9 * reach / (40 * DT)] * 40 + [-0.9 * reach / (40 * DT)] * 40:
        bristle, _ = step(bristle, velocity, level)
    assert bristle == pytest.approx(0.0, abs=1e-9)


def test_presliding_is_tens_of_micrometres(settings):
    assert 5e-6 < 10.0 / settings.friction.stiffness < 1e-4


@given(st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(0.5, 50.0)), min_size=1, max_size=200))
def test_bristles_never_give_back_more_than_they_got(steps):
    bristle = work = 0.0
    for velocity, level in steps:
        bristle, friction = step(bristle, velocity, level)
        work += friction * velocity * DT
        assert bristle * bristle / (2.0 * STIFFNESS) <= work + 1e-12


@given(st.floats(-50.0, 50.0), st.floats(-3.0, 3.0), st.floats(0.5, 50.0))
def test_bristle_never_shoots_past_the_level(bristle, velocity, level):
    after, _ = step(bristle, velocity, level)
    assert abs(after) <= max(abs(bristle), level) * (1.0 + 1e-12)


def test_rollers_that_slip_do_not_repeat_with_the_height(settings):
    slipping = settings.friction._replace(roller_amplitude=1.0, roller_slip=2.0)
    first, again, later = (
        steady_level(slipping, TURN_RATE, 0.2, 0.05, True, way) for way in (0.0, 0.0, 0.7)
    )
    assert first == again
    assert abs(later - first) > 0.05
    assert abs(later - first) <= 2.0 * 1.2


def test_cold_grease_rubs_more_until_it_has_travelled(settings):
    cold = settings.friction._replace(cold=0.2, cold_way=5.0, roller_slip=0.0)
    warm = steady_level(cold._replace(cold=0.0), TURN_RATE, 0.2, 0.05, True)
    levels = [steady_level(cold, TURN_RATE, 0.2, 0.05, True, way) for way in (0.0, 5.0, 100.0)]
    assert levels[0] > levels[1] > levels[2]
    assert levels[2] == pytest.approx(warm)
    assert 1.1 < levels[0] / warm < 1.3
