# SPDX-License-Identifier: Apache-2.0
"""Encoder and drive position: a frozen encoder is noticed, skew and offset are not."""

import math

import pytest

from screw_module_ros.safety.checks import HOME_AGAIN, Agreement, AgreementSettings

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
