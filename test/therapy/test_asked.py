# SPDX-License-Identifier: Apache-2.0
"""What the patient is asked and tells, whatever comes in."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.therapy.asked import AFTER, BEFORE, PAUSE, Asked, GoesOn, Question
from screw_module_ros.therapy.scores import SCALES


def told(*values, when=BEFORE, asked=None):
    """Answer pain and tiredness."""
    asked = asked or Asked(True)
    asked.ask(when, 0)
    for question, value in zip((Question.PAIN, Question.TIREDNESS), values, strict=True):
        asked.answer(16 * question + value)
    return asked


@given(st.lists(st.integers(0, 255), max_size=40))
def test_whatever_comes_in_only_what_was_asked_is_kept(data):
    asked = Asked(True)
    asked.ask(BEFORE, 0)
    for each in data:
        asked.answer(each)
    assert [scale for scale, _ in asked.scores] == ["pain_before", "tired_before"][
        : len(asked.scores)
    ]
    assert all(0.0 <= value <= 10.0 for _, value in asked.scores)


def test_who_is_not_to_be_asked_is_not():
    asked = Asked()
    asked.ask(BEFORE, 0)
    asked.answer(16 + 3)
    assert asked.asks == Question.NOTHING and math.isnan(asked.told["pain"])


@pytest.mark.parametrize(("before", "then", "goes_on"), [
    ((5, 5), None, GoesOn.NOT_ASKED), ((6, 0), None, GoesOn.ASKED), ((0, 6), None, GoesOn.ASKED),
    ((2, 2), (4, 4), GoesOn.NOT_ASKED), ((2, 2), (5, 2), GoesOn.ASKED),
    ((2, 2), (2, 5), GoesOn.ASKED),
])  # fmt: skip
def test_above_5_or_3_more_the_therapist_is_asked(before, then, goes_on):
    asked = told(*before)
    if then:
        assert asked.goes_on == GoesOn.NOT_ASKED
        told(*then, when=PAUSE, asked=asked)
    assert asked.goes_on == goes_on and asked.is_open is (goes_on == GoesOn.ASKED)


def test_the_last_word_stays_when_he_is_asked_after_the_session():
    asked = told(9, 1)
    asked.settle(False)
    asked.ask(AFTER, 0)
    assert asked.goes_on == GoesOn.NO and asked.scores[-1] == ("went_on", 0.0)


def test_each_answer_has_its_scale():
    asked = Asked(True)
    for when in (BEFORE, PAUSE, AFTER):
        told(7, 7, when=when, asked=asked)
    asked.settle(True)
    assert {scale for scale, _ in asked.scores} <= set(SCALES)
