# SPDX-License-Identifier: Apache-2.0
"""Force error over all samples: sensitivity of each figure."""

import math

import numpy as np
import pytest

from screw_module_ros.identification.force_metric import judged

DT = 0.001
TIME = np.arange(5000) * DT
NOTHING = np.zeros_like(TIME)
WHOLE = np.ones_like(TIME)


def of(error, position=NOTHING, velocity=NOTHING, stiffness=100.0, damping=7.0, **more):
    """Metric of a force that is off the impedance by `error`."""
    force = stiffness * position + damping * velocity + error
    return judged(DT, position, velocity, force, WHOLE, stiffness, damping, **more)


def test_the_impedance_asked_for_is_no_error():
    position = 0.1 * np.sin(2.0 * TIME)
    found = of(NOTHING, position, 0.2 * np.cos(2.0 * TIME))
    assert found.rms == pytest.approx(0.0, abs=1e-9)
    assert found.travel == pytest.approx(np.ptp(position[-1000:]))


def test_standstill_counts():
    """The thesis's offset drops everything slower than 20 mm/s: this handle does not move."""
    found = of(np.full_like(TIME, 3.0))
    assert found.mean == found.rms == pytest.approx(3.0)
    assert found.p99 == pytest.approx(3.0)
    assert found.rapid < 0.1


@pytest.mark.parametrize(("frequency", "rapid"), [(2.0, 0.0), (60.0, 1.0)])
def test_rapid_is_above_30_hertz(frequency, rapid):
    found = of(math.sqrt(2.0) * np.sin(2.0 * math.pi * frequency * TIME))
    assert found.rms == pytest.approx(1.0, abs=0.01)
    assert found.rapid == pytest.approx(rapid, abs=0.03)


def test_shaking_is_as_long_as_it_lasts():
    swing = np.where((TIME > 1.0) & (TIME < 2.2), 5.0 * np.sin(2.0 * math.pi * 20.0 * TIME), 0.0)
    found = of(swing)
    assert found.shaking == pytest.approx(1.2, abs=0.15)
    assert found.swing < 0.1, "it ended long before the last second"


def test_what_came_before_is_not_judged():
    found = of(np.where(TIME < 2.0, 50.0, 1.0), first=3000)
    assert found.rms == pytest.approx(1.0)


def test_too_few_samples_are_refused():
    with pytest.raises(ValueError, match="at least 1000 are wanted"):
        of(NOTHING, first=4500)
