# SPDX-License-Identifier: Apache-2.0
"""Force error over all samples: what each figure counts."""

import math

import numpy as np
import pytest

from screw_module_ros.identification.force_metric import judged

TIME = np.arange(5000) * 0.001
NOTHING = np.zeros_like(TIME)


def of(error, position=NOTHING, velocity=NOTHING, **more):
    """Metric of a force that is off spring and damper by `error`."""
    force = 100.0 * position + 7.0 * velocity + error
    return judged(0.001, position, velocity, force, np.ones_like(TIME), 100.0, 7.0, **more)


def sine(hertz):
    return np.sin(2.0 * math.pi * hertz * TIME)


def test_the_impedance_asked_for_is_no_error():
    position = 0.1 * np.sin(2.0 * TIME)
    found = of(NOTHING, position, 0.2 * np.cos(2.0 * TIME))
    assert found.rms == pytest.approx(0.0, abs=1e-9)
    assert found.travel == pytest.approx(np.ptp(position[-1000:]))


@pytest.mark.parametrize(
    ("error", "given", "expected"),
    [
        # The thesis's offset drops everything slower than 20 mm/s: this handle does not move.
        (np.full_like(TIME, 3.0), {}, {"mean": 3.0, "rms": 3.0, "p99": 3.0, "rapid": 0.0}),
        (math.sqrt(2.0) * sine(2.0), {}, {"rms": 1.0, "rapid": 0.0}),
        (math.sqrt(2.0) * sine(60.0), {}, {"rms": 1.0, "rapid": 1.0}),
        # Shaking is as long as it lasts, and this one ends long before the last second.
        (np.where((TIME > 1.0) & (TIME < 2.2), 5.0 * sine(20.0), 0.0), {},
         {"shaking": 1.2, "swing": 0.0}),
        # What came before the first sample is not judged.
        (np.where(TIME < 2.0, 50.0, 1.0), {"first": 3000}, {"rms": 1.0}),
    ],
)  # fmt: skip
def test_each_figure_counts_its_own(error, given, expected):
    found = of(error, **given)
    for name, value in expected.items():
        margin = {"shaking": 0.15, "rapid": 0.05, "swing": 0.1}.get(name, 0.01)
        assert getattr(found, name) == pytest.approx(value, abs=margin), name


def test_too_few_samples_are_refused():
    with pytest.raises(ValueError, match="at least 1000 are wanted"):
        of(NOTHING, first=4500)
