# SPDX-License-Identifier: Apache-2.0
"""A drive that gives more torque than asked for is found out, one that is late or weak is not."""

from __future__ import annotations

import math

import pytest

from screw_module_ros.devices.drive_logic import ExcessTorque

MS = 1_000_000
LARGEST, LASTING = 0.1, 0.02


def noticed(asked, given, ticks=1000, period=MS):
    check = ExcessTorque(LARGEST, LASTING, period)
    return next((k for k in range(ticks) if check.check(asked, given, k * period)), None)


TOO_MUCH = [(0.0, 0.2), (0.05, 0.21), (0.05, -0.18), (-0.3, 0.1)]


@pytest.mark.parametrize(("asked", "given"), TOO_MUCH)
def test_too_much_or_the_wrong_way(asked, given):
    """It is a fault after 20 ms, or three periods where these are longer."""
    assert noticed(asked, given) == 20
    assert noticed(asked, given, period=20 * MS) == 3


@pytest.mark.parametrize(
    ("asked", "given", "ticks"), [(0.0, 0.06, 40), (0.05, 0.09, 80), (0.0, -0.03, 160)]
)
def test_less_excess_takes_longer_but_does_not_last(asked, given, ticks):
    assert noticed(asked, given) == pytest.approx(ticks, abs=1)


@pytest.mark.parametrize(
    ("asked", "given"), [(0.3, 0.0), (0.05, 0.069), (0.0, 0.019), (-0.3, -0.1), (0.05, -0.019)]
)
def test_a_weak_or_inaccurate_drive_is_no_danger(asked, given):
    """Less than asked for, or a little more, stops nothing."""
    assert noticed(asked, given, ticks=20_000) is None


def test_excess_that_comes_and_goes_does_not_last_either():
    """Every other tick, and 10 ms of each 30."""
    for on, of in ((1, 2), (10, 30)):
        check = ExcessTorque(LARGEST, LASTING, MS)
        found = [k for k in range(1000) if check.check(0.0, 0.3 * (k % of < on), k * MS)]
        assert found and found[0] < 120


def test_a_step_that_the_drive_follows_late():
    """Some ticks with the old torque now and then are no fault, and do not add up."""
    check = ExcessTorque(LARGEST, LASTING, MS)
    for k in range(0, 10_000, 100):
        assert not any(check.check(0.0, 0.3, (k + i) * MS) for i in range(15))
        assert not any(check.check(0.0, 0.0, (k + i) * MS) for i in range(15, 100))


def test_what_was_asked_a_moment_ago_may_still_be_given():
    """A drive that is 3 ms late with a fast sine gives no excess."""

    check = ExcessTorque(LARGEST, LASTING, MS)
    asked = [0.3 * math.sin(0.5 * k) for k in range(3000)]
    for k in range(3, 3000):
        assert not check.check(asked[k], asked[k - 3], k * MS)


def test_a_restart_forgets():
    check = ExcessTorque(LARGEST, LASTING, MS)
    for k in range(1000):
        if k % 19 == 0:
            check.restart()
        assert not check.check(0.0, 0.3, k * MS)
