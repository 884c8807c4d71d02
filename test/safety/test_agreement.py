# SPDX-License-Identifier: Apache-2.0
"""Encoder and drive position: a frozen encoder is noticed, skew and offset are not."""

import math

from screw_module_ros.safety.checks import Agreement, AgreementSettings

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


def test_ages_of_two_hundredths_of_a_second_apart_agree():
    assert run([(0.005 * k, 0.005 * max(0, k - 2), 0.5) for k in range(60)]) is None


def test_a_frozen_encoder_is_noticed():
    step, reason = run([(0.1, 0.1 + 0.0009 * k, 0.0) for k in range(50)])
    assert step == 8  # more than 2 mm after three steps, and 50 ms of patience
    assert reason.endswith("disagree by -7.2 mm"), "nothing moved that could be compared"


def test_positions_on_different_leads_name_the_parameter():
    """The amplifier was told the new screw, the encoder was not."""
    _, reason = run([(0.1 + 0.0019 * k, 0.1 + 0.00127 * k, 0.0) for k in range(50)])
    assert "mm after " in reason and "compare `lead`" in reason


def test_positions_that_move_apart_name_the_direction():
    _, reason = run([(0.1 + 0.001 * k, 0.1 - 0.001 * k, 0.0) for k in range(50)])
    assert "compare `direction`" in reason


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
