# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from screw_module_ros.identification.belt_drive import (
    LEVEL,
    Belt,
    Printed,
    bandwidth,
    chosen,
    mode,
    system,
)

BELT = Belt(1e-3, 3e-3, 0.5, 0.02, 0.05)


def gain(belt: Belt, frequency: float) -> float:
    s, space = 2j * math.pi * frequency, system(belt)
    return abs((space.C @ np.linalg.solve(s * np.eye(3) - space.A, space.B))[0, 0])


def test_two_free_inertias_twist_at_the_textbook_frequency():
    reduced = BELT.motor * BELT.load / (BELT.motor + BELT.load)
    natural = math.sqrt(BELT.stiffness / reduced)
    frequency, factor = mode(BELT._replace(ground=0.0))
    assert frequency == pytest.approx(natural / (2 * math.pi))
    assert factor == pytest.approx(BELT.damping / (2 * natural * reduced))


@pytest.mark.parametrize("belt", [BELT, BELT._replace(ground=0.0), Belt(1e-3, 3e-3, 0.5)])
def test_the_bandwidth_ends_at_the_level_of_the_state_space(belt):
    end = bandwidth(belt)
    assert gain(belt, end) == pytest.approx(LEVEL)
    assert gain(belt, 1.5 * end) < LEVEL


def test_chosen_parameters_give_what_is_printed():
    belt = chosen(Printed())
    free = belt._replace(ground=0.0)
    assert mode(free._replace(damping=0.0)) == pytest.approx((3.0, 0.0))
    assert bandwidth(free._replace(damping=0.0)) == pytest.approx(10.6)
    assert mode(free._replace(damping=belt.damping / 10))[1] == pytest.approx(0.446)
    assert bandwidth(belt) == pytest.approx(40.0)


def test_what_was_not_chosen_comes_out_near_the_paper():
    belt = chosen()
    free = belt._replace(ground=0.0)
    assert bandwidth(free) == pytest.approx(51.7, rel=0.06)
    assert mode(free)[1] > 1.0
    assert mode(belt)[1] > 1.0


@pytest.mark.parametrize(
    ("printed", "said"),
    [(Printed(undamped=2.0), "above the resonance"), (Printed(whole=90.0), "no damping to ground")],
)
def test_what_no_parameters_can_give_is_refused(printed, said):
    with pytest.raises(ValueError, match=said):
        chosen(printed)


def test_a_load_that_never_follows_has_no_bandwidth():
    with pytest.raises(ValueError, match="does not fall"):
        bandwidth(BELT._replace(ground=5.0))
