# SPDX-License-Identifier: Apache-2.0
"""A drive that gives more torque than asked for is found out, one that is late or weak is not."""

from __future__ import annotations

import pytest

from screw_module_ros.devices.drive_torque import ExcessTorque

MS = 1_000_000


def noticed(asked, given, ticks=100, period=MS):
    check = ExcessTorque(0.1, period)
    return next((k for k in range(ticks) if check.check(asked, given, k * period)), None)


TOO_MUCH = [(0.0, 0.2), (0.05, 0.21), (0.05, -0.08), (-0.3, 0.1)]


@pytest.mark.parametrize(("asked", "given"), TOO_MUCH)
def test_too_much_or_the_wrong_way(asked, given):
    """It is a fault after 20 ms, or three periods where these are longer."""
    assert noticed(asked, given) == 20
    assert noticed(asked, given, period=20 * MS) == 3


@pytest.mark.parametrize(("asked", "given"), [(0.3, 0.0), (0.05, 0.14), (0.0, 0.09), (-0.3, -0.1)])
def test_a_weak_or_inaccurate_drive_is_no_danger(asked, given):
    """Less than asked for, or a little more, stops nothing."""
    assert noticed(asked, given) is None


def test_a_step_that_the_drive_follows_late():
    """Some ticks with the old torque are no fault, and do not add up."""
    check = ExcessTorque(0.1, MS)
    for k in range(0, 1000, 30):
        assert not any(check.check(0.0, 0.3, (k + i) * MS) for i in range(19))
        assert not check.check(0.0, 0.0, (k + 20) * MS)
