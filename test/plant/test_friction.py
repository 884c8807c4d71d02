# SPDX-License-Identifier: Apache-2.0
"""Friction: the thesis's figures in the mean, what goes beyond them, and what the stage finds."""

from __future__ import annotations

import math
import statistics

import numpy
import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.plant.friction import (
    ELASTIC,
    bristle_terms,
    settled_bristle,
    steady_level,
)
from screw_module_ros.plant.world import World

LEAD = 0.01905
TURN_RATE = 2.0 * math.pi / LEAD
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


def mean_speed(friction, against):
    """Return the speed at which the factor is 1 [m/s]."""
    m = friction.against if against else friction.along
    return (1.0 - m.intercept) / m.slope / 1000.0


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
    # Force to push the handle, gravity of 10 N included.
    bare, speed = without_ripples(settings.friction), mean_speed(settings.friction, against)
    level = steady_level(bare, TURN_RATE, height, speed, against)
    assert (10.0 + level if against else 10.0 - level) == pytest.approx(force, abs=0.05)


@pytest.mark.parametrize(("against", "largest"), [(True, 2.2), (False, 3.2)])
def test_turn_ripple_is_as_large_as_in_the_thesis(settings, against, largest):
    bare, speed = without_ripples(settings.friction), mean_speed(settings.friction, against)
    rippled = bare._replace(against=settings.friction.against, along=settings.friction.along)
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
    mean = steady_level(bare, TURN_RATE, 0.2, mean_speed(bare, against), against)
    level = steady_level(bare, TURN_RATE, 0.2, speed, against)
    assert level / mean == pytest.approx(factor, abs=0.002)


@pytest.mark.parametrize("against", [True, False])
@pytest.mark.parametrize(
    ("height", "end"), [(0.356, 0.355), (0.36, 0.355), (1.0, 0.355), (-0.01, 0.0)]
)
def test_map_is_held_beyond_its_range(settings, against, height, end):
    beyond = steady_level(settings.friction, TURN_RATE, height, 0.02, against)
    assert beyond == steady_level(settings.friction, TURN_RATE, end, 0.02, against)


@pytest.mark.parametrize("against", [True, False])
@pytest.mark.parametrize("speed", [0.0005, 0.001, 0.0025, 0.02])
def test_breakaway_is_above_slow_motion_everywhere(settings, against, speed):
    for z in range(0, 356, 5):
        stuck = steady_level(settings.friction, TURN_RATE, z / 1000, 0.0, against)
        assert stuck > steady_level(settings.friction, TURN_RATE, z / 1000, speed, against), z


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
        steady_level(settings.friction, TURN_RATE, 0.2 + LEAD * i / points, 0.0477, True)
        for i in range(points)
    ]
    harmonic = 2.0 * numpy.abs(numpy.fft.rfft(levels)) / points
    assert harmonic[4] == pytest.approx(settings.friction.roller_amplitude, rel=0.1)
    assert harmonic[1] > 3.0 * harmonic[4]
    assert harmonic[2] < 0.3 * harmonic[4]


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
    assert 0.05 < abs(later - first) <= 2.0 * 1.2


def test_cold_grease_rubs_more_until_it_has_travelled(settings):
    cold = settings.friction._replace(cold=0.2, cold_way=5.0, roller_slip=0.0)
    warm = steady_level(cold._replace(cold=0.0), TURN_RATE, 0.2, 0.05, True)
    levels = [steady_level(cold, TURN_RATE, 0.2, 0.05, True, way) for way in (0.0, 5.0, 100.0)]
    assert levels[0] > levels[1] > levels[2]
    assert levels[2] == pytest.approx(warm)
    assert 1.1 < levels[0] / warm < 1.3


# The positioning stage finds the thesis's map in the mean, and gravity (5.2).

# Coefficients of thesis 5.2.5, height in mm, the highest power first.
TREND_UP = (-7.27e-16, -9.97e-14, 6.63e-10, -3.54e-7, 7.57e-5, -0.0069, 0.2334, 13.6820)
TREND_DOWN = (4.76e-15, -5.56e-12, 2.50e-9, -5.39e-7, 5.66e-5, -0.0028, 0.0676, 2.7001)


def stage_forces(settings, speed, start, turns=2, upside_down=False):
    """Run the stage over whole turns; return (height of the middle, mean force)."""
    world = World(settings)
    world.set_fixture("free", upside_down=upside_down)
    way = math.copysign(1.0, speed)
    world.place(start - way * 0.006)
    world.set_fixture("stage", speed=speed, upside_down=upside_down)
    forces = []
    while way * (world.truth().handle_position - start) < turns * LEAD:
        world.advance(1e-3)
        truth = world.truth()
        if way * (truth.handle_position - start) >= 0.0:
            forces.append(truth.patient_force)
    return statistics.fmean(forces)


def thesis_trend(middle, speed, turns=2):
    """Force of thesis 5.2.5 without ripple, its mean over the same way."""
    v = abs(speed) * 1000.0
    if speed > 0.0:
        factor = 0.754 * v**0.15 if v <= 2.5 else 0.00296 * v + 0.857
    else:
        factor = 0.8098 * v**0.15 if v <= 2.5 else 0.0025 * v + 0.923
    places = 1000.0 * (middle + turns * LEAD * numpy.linspace(-0.5, 0.5, 101))
    trend = numpy.polyval(TREND_UP if speed > 0.0 else TREND_DOWN, places)
    return numpy.mean(factor * (trend - 10.0) + 10.0)


@pytest.mark.long
@pytest.mark.parametrize("speed", [0.02, 0.05, 0.15, -0.02, -0.05, -0.15])
@pytest.mark.parametrize("middle", [0.05, 0.18, 0.3])
def test_mean_force_is_the_thesis_map(settings, speed, middle):
    force = stage_forces(settings, speed, middle - math.copysign(LEAD, speed))
    assert force == pytest.approx(thesis_trend(middle, speed), abs=0.5)


@pytest.mark.long
@pytest.mark.parametrize("speed", [0.002, 0.005])
def test_slow_motion_averages_to_the_map_over_the_height(settings, speed):
    """The Stribeck term shifts the halves apart and leaves the mean."""
    places = [0.0177 + 0.0355 * i for i in range(10)]
    extra = [
        stage_forces(settings, speed, middle - 0.5 * LEAD, turns=1)
        - thesis_trend(middle, speed, turns=1)
        for middle in places
    ]
    assert statistics.fmean(extra) == pytest.approx(0.0, abs=0.3)
    assert max(map(abs, extra)) > 0.5


@pytest.mark.long
@pytest.mark.parametrize("speed", [0.02, -0.02])
def test_upside_down_the_map_follows_gravity_not_the_screw(settings, speed):
    """Thesis 5.2.4: moving with gravity takes the same force whichever way the screw turns."""
    start = 0.18 - math.copysign(LEAD, speed)
    upright = stage_forces(settings, speed, start)
    # the same stretch, 0.18 being its middle
    turned = stage_forces(settings, -speed, 0.36 - start, upside_down=True)
    assert turned == pytest.approx(-upright, abs=0.3)


@pytest.mark.long
def test_half_the_difference_upright_and_upside_down_is_gravity(settings):
    rig = settings._replace(
        friction=settings.friction._replace(along=settings.friction.against)
    )  # no difference between against and along: what is left is 2 m g
    upright = stage_forces(rig, 0.02, 0.1)
    turned = stage_forces(rig, 0.02, 0.1, upside_down=True)
    assert (upright - turned) / 2.0 == pytest.approx(10.04, abs=0.15)
