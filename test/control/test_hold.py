# SPDX-License-Identifier: Apache-2.0
"""Whether a hand holds the handle: a zero crossing is no release, a lasting zero is one."""

import math

from screw_module_ros.control.hold import FIRM, FORGET, free_share, hold_step

DT = 0.001


def shares(force, seconds):
    largest, found = 0.0, []
    for tick in range(round(seconds / DT)):
        largest = hold_step(largest, force(tick * DT), DT)
        found.append(free_share(largest))
    return found


def test_a_hand_that_moves_through_the_middle_of_the_spring_holds_on():
    """15 N at 0.8 rad/s, as in slow motion, and 3 N at 1.5 rad/s, as in small motion."""
    for size, omega in ((15.0, 0.8), (3.0, 1.5)):
        found = shares(lambda t, s=size, w=omega: s * math.cos(w * t), 8.0)
        assert max(found) == 0.0


def test_a_released_handle_is_free_soon():
    found = shares(lambda t: 5.0 if t < 1.0 else 0.0, 6.0)
    assert max(found[:1000]) == 0.0
    assert found[1000 + round(FORGET * math.log(5.0 / FIRM) / DT) + 2] > 0.0
    assert found[-1] > 0.9
