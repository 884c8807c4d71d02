# SPDX-License-Identifier: Apache-2.0
"""The positioning stage finds the thesis's friction map in the mean, and gravity (5.2)."""

from __future__ import annotations

import statistics

import pytest

from screw_module_ros.plant.world import World

pytestmark = pytest.mark.long

LEAD = 0.01905


def stage_forces(settings, speed, start, turns=2, upside_down=False):
    """Run the stage over whole turns; return (height of the middle, mean force)."""
    world = World(settings)
    world.set_fixture("free", upside_down=upside_down)
    way = 1.0 if speed > 0.0 else -1.0
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
    up = speed > 0.0
    v = abs(speed) * 1000.0
    if up:
        factor = 0.754 * v**0.15 if v <= 2.5 else 0.00296 * v + 0.857
    else:
        factor = 0.8098 * v**0.15 if v <= 2.5 else 0.0025 * v + 0.923

    def at(z):
        if up:
            return (((((((-7.27e-16 * z - 9.97e-14) * z + 6.63e-10) * z - 3.54e-7) * z + 7.57e-5)
                      * z - 0.0069) * z + 0.2334) * z + 13.6820)  # fmt: skip
        return (((((((4.76e-15 * z - 5.56e-12) * z + 2.50e-9) * z - 5.39e-7) * z + 5.66e-5)
                  * z - 0.0028) * z + 0.0676) * z + 2.7001)  # fmt: skip

    places = [1000.0 * (middle + turns * LEAD * (i / 100.0 - 0.5)) for i in range(101)]
    return statistics.fmean(factor * (at(z) - 10.0) + 10.0 for z in places)


@pytest.mark.parametrize("speed", [0.02, 0.05, 0.15, -0.02, -0.05, -0.15])
@pytest.mark.parametrize("middle", [0.05, 0.18, 0.3])
def test_mean_force_is_the_thesis_map(settings, speed, middle):
    start = middle - (1.0 if speed > 0.0 else -1.0) * LEAD
    force = stage_forces(settings, speed, start)
    assert force == pytest.approx(thesis_trend(middle, speed), abs=0.5)


@pytest.mark.parametrize("speed", [0.002, 0.005])
def test_slow_motion_averages_to_the_map_over_the_height(settings, speed):
    """The Stribeck term shifts the halves apart and leaves the mean."""
    places = [0.0177 + 0.0355 * i for i in range(10)]
    extra = []
    for middle in places[1::2] + places[0::2]:
        start = middle - 0.5 * LEAD
        extra.append(
            stage_forces(settings, speed, start, turns=1) - thesis_trend(middle, speed, turns=1)
        )
    assert statistics.fmean(extra) == pytest.approx(0.0, abs=0.3)
    assert max(map(abs, extra)) > 0.5


def test_upside_down_the_map_follows_gravity_not_the_screw(settings):
    """Thesis 5.2.4: moving with gravity takes the same force whichever way the screw turns."""
    for speed in (0.02, -0.02):
        start = 0.18 - (1.0 if speed > 0.0 else -1.0) * LEAD
        upright = stage_forces(settings, speed, start)
        turned = stage_forces(
            settings, -speed, 0.36 - start, upside_down=True
        )  # the same stretch, 0.18 being its middle
        assert turned == pytest.approx(-upright, abs=0.3)


def test_half_the_difference_upright_and_upside_down_is_gravity(settings):
    rig = settings._replace(
        friction=settings.friction._replace(along=settings.friction.against)
    )  # no difference between against and along: what is left is 2 m g
    start = 0.1
    upright = stage_forces(rig, 0.02, start)
    turned = stage_forces(rig, 0.02, start, upside_down=True)
    assert (upright - turned) / 2.0 == pytest.approx(10.04, abs=0.15)
