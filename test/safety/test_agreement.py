# SPDX-License-Identifier: Apache-2.0
"""Two readings of one place: a frozen encoder or joint is noticed, skew and rest are not."""

import math

import pytest

from screw_module_ros.control.arms import FIVE_BAR
from screw_module_ros.geometry import MANUS, forward, inverse
from screw_module_ros.loop.plane_controller import hand_torques
from screw_module_ros.safety.checks import (
    HOME_AGAIN,
    Agreement,
    AgreementSettings,
    FreezeSettings,
    Frozen,
)

STEP_NS = 10_000_000


def run(pairs):
    """First reason over (encoder, drive, velocity) given each 10 ms."""
    agreement = Agreement(AgreementSettings())
    for step, (encoder, drive, velocity) in enumerate(pairs):
        reason = agreement.check(encoder, drive, velocity, step * STEP_NS)
        if reason:
            return step, reason
    return None


def test_the_same_motion_agrees_whatever_the_offset():
    assert run([(0.1 + 0.002 * k, 7.0 + 0.002 * k, 0.2) for k in range(100)]) is None


@pytest.mark.parametrize(
    ("velocity", "allowed"), [(0.0, 0.002), (0.5, 0.022), (-0.5, 0.022)]
)  # the positions may be 40 ms apart
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_tolerance_skew_and_patience_at_their_edges(velocity, allowed, sign):
    for difference, reason in (
        (allowed - 1e-6, ""),
        (allowed + 1e-6,
         f"encoder and drive disagree by {sign * allowed * 1e3:.1f} mm; {HOME_AGAIN}"),
    ):
        agreement = Agreement(AgreementSettings())
        assert agreement.check(0.0, 0.0, velocity, 0) == ""
        apart = sign * difference, 0.0, velocity
        assert agreement.check(*apart, STEP_NS) == ""
        assert agreement.check(*apart, STEP_NS + 49_999_999) == ""
        assert agreement.check(*apart, STEP_NS + 50_000_000) == reason
        assert agreement.check(0.0, 0.0, velocity, STEP_NS + 60_000_000) == ""
        assert agreement.check(*apart, STEP_NS + 70_000_000) == "", "patience begins anew"


@pytest.mark.parametrize(
    ("encoder", "drive", "cause"),
    [
        (0.0019, 0.2, ""), (0.2, -0.0019, ""),
        (0.0021, -0.2, "compare `direction`"), (-0.2, 0.0021, "compare `direction`"),
        (0.2, 0.0021, " after 200.0 and 2.1 mm: compare `lead` and `counts_per_turn`"),
        (-0.3, -0.2, " after -300.0 and -200.0 mm: compare `lead` and `counts_per_turn`"),
    ],
)  # fmt: skip
def test_two_travels_that_differ_name_the_parameter(encoder, drive, cause):
    step, reason = run([(0.1, 5.0, 0.0)] + [(0.1 + encoder, 5.0 + drive, 0.0)] * 10)
    assert step == 6
    assert reason.startswith(f"encoder and drive disagree by {(encoder - drive) * 1e3:.1f} mm")
    assert cause in reason and ("compare" in reason) == bool(cause)


def test_a_frozen_encoder_is_noticed():
    step, reason = run([(0.1, 0.1 + 0.0009 * k, 0.0) for k in range(50)])
    assert step == 8  # more than 2 mm after three steps, and 50 ms of patience
    # No cause is named: nothing moved that could be compared.
    assert reason.endswith(f"disagree by -7.2 mm; {HOME_AGAIN}")


def test_a_single_disagreement_is_tolerated():
    assert run([(0.1, 0.1, 0.0), (0.1, 0.2, 0.0), (0.1, 0.1, 0.0), (0.1, 0.1, 0.0)] * 5) is None


def test_numbers_that_are_none_disagree():
    assert run([(0.1, 0.1, 0.0)] + [(math.nan, 0.1, 0.0)] * 10) is not None


def test_restart_takes_a_new_reference():
    agreement = Agreement(AgreementSettings())
    agreement.check(0.1, 0.1, 0.0, 0)
    agreement.restart()
    assert agreement.check(0.3, 0.1, 0.0, STEP_NS) == ""
    assert agreement.check(0.3, 0.1, 0.0, 20 * STEP_NS) == ""


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
    torques = hand_torques(FIVE_BAR, s, e, 7.0, -3.0, MANUS)
    (x, y), turn = forward(s, e), 1e-6
    for torque, (ds, de) in zip(torques, ((turn, 0.0), (0.0, turn)), strict=True):
        moved_x, moved_y = forward(s + ds, e + de)
        assert 7.0 * (moved_x - x) - 3.0 * (moved_y - y) == pytest.approx(torque * turn, rel=1e-4)
