# SPDX-License-Identifier: Apache-2.0
"""A joint that stands still to the last count is doubted only while it cannot stand still."""

import math

import pytest

from screw_module_ros.geometry import inverse
from screw_module_ros.loop.plane import hand_torques
from screw_module_ros.safety.checks import FreezeSettings, Frozen

SETTINGS = FreezeSettings()
COUNT = 2.0 * math.pi / 65536
DT = 0.002
NEEDED = round(SETTINGS.time / DT)


def frozen_at(steps):
    """Return the step at which (position, torque) pairs are judged frozen, None when never."""
    check = Frozen(SETTINGS)
    for number, (position, torque) in enumerate(steps):
        if check.check(position, torque, DT):
            return number
    return None


@pytest.mark.parametrize(("torque", "counts"), [(3.0, 0), (3.0001, 1), (-3.0, 0), (-3.0001, 1)])
def test_torque_and_time_at_their_edges(torque, counts):
    """An eighth of a second is a sum without rounding; the first call only notes the position."""
    check = Frozen(SETTINGS._replace(time=0.5))
    found = [bool(check.check(1.0, torque, 0.125)) for _ in range(13)]
    assert [number for number, frozen in enumerate(found) if frozen] == [4, 8, 12][: 3 * counts]
    check.check(1.0, torque, 0.375)
    check.restart()
    assert not check.check(1.0, torque, 0.375)
    reason = check.check(1.0, torque, 0.125)
    assert ("in 0.5 s of more than 3 Nm on the joint: it is frozen" in reason) == bool(counts)


def test_the_default_is_a_tenth_of_a_second():
    assert frozen_at([(1.0, 3.1)] * 200) in (50, 51)


def test_the_sum_counts_motion_to_and_fro_has_moments_of_little_torque():
    swing = [(1.0, 6.0 * math.sin(0.05 * k)) for k in range(1000)]
    assert NEEDED < frozen_at(swing) < 4 * NEEDED


@pytest.mark.parametrize("torque", [0.0, 2.9, math.nan])
def test_rest_balance_and_the_unknown_are_no_reason(torque):
    assert frozen_at([(1.0, torque)] * 5000) is None


def test_one_count_takes_the_doubt_away():
    held = [(1.0 + COUNT * (k // (NEEDED - 2) % 2), 20.0) for k in range(5000)]
    assert frozen_at(held) is None


def test_off():
    check = Frozen(SETTINGS._replace(time=0.0))
    assert not any(check.check(1.0, 50.0, 1.0) for _ in range(10))


def test_a_hand_s_force_does_its_work_at_the_joints():
    """Power at the handle is power at the joints: F v = tau w, for a small turn of each."""
    s, e = inverse(0.05, 0.03)
    torques = hand_torques(s, e, 7.0, -3.0)
    from screw_module_ros.geometry import forward

    (x, y), turn = forward(s, e), 1e-6
    for torque, (ds, de) in zip(torques, ((turn, 0.0), (0.0, turn)), strict=True):
        moved_x, moved_y = forward(s + ds, e + de)
        assert 7.0 * (moved_x - x) - 3.0 * (moved_y - y) == pytest.approx(torque * turn, rel=1e-4)
