# SPDX-License-Identifier: Apache-2.0
"""Pain and tiredness, 0 to 10, as the patient tells on his screen; what is not asked is unknown.

He is asked before a session, after it, and in a pause that he asked for or that a spasm caused.
When one of them is above `HIGH`, or `RISE` more than at first, the therapist is asked whether to
go on.
"""

from __future__ import annotations

import math
from enum import IntEnum
from itertools import pairwise

HIGH, RISE, MOST = 5, 3, 10  # the first two are ours
BEFORE, PAUSE, AFTER = "before", "pause", "after"
ANSWERS = "the patient is asked for pain and tiredness"
"""Reason why a session has not begun yet."""
LASTS_NS = 300_000_000_000
"""After this time nobody answers any more, and the next patient must not [ns]: ours."""
_BASE = 16  # an answer is so many times the question, and the value


class Question(IntEnum):
    """What is asked, the constants of TherapyState.msg."""

    NOTHING = 0
    PAIN = 1
    TIREDNESS = 2


class GoesOn(IntEnum):
    """The therapist's word, the constants of TherapyState.msg."""

    NOT_ASKED = 0
    ASKED = 1
    YES = 2
    NO = 3


_SCALE = {Question.PAIN: "pain", Question.TIREDNESS: "tired"}
_NEXT = dict(pairwise((Question.PAIN, Question.TIREDNESS, Question.NOTHING)))


class Asked:
    """What one patient is asked in a session.

    is_wanted: whether he is asked at all; asks: now; goes_on: the therapist's word; told: newest
    answer by scale, NaN for none; scores: scale and value of what was told and was not kept yet.
    """

    def __init__(self, is_wanted: bool = False):
        self.is_wanted = is_wanted
        self.asks, self.goes_on = Question.NOTHING, GoesOn.NOT_ASKED
        self.told = dict.fromkeys(_SCALE.values(), math.nan)
        self.scores: list[tuple[str, float]] = []
        self._first: dict[str, int] = {}
        self._when, self._since_ns = "", 0

    @property
    def is_open(self) -> bool:
        """Whether an answer is waited for, of the patient or the therapist."""
        return self.asks != Question.NOTHING or self.goes_on == GoesOn.ASKED

    def ask(self, when: str, now_ns: int) -> None:
        """Ask him, if that is wanted; when: BEFORE, PAUSE or AFTER; now_ns: time [ns]."""
        if self.is_wanted:
            self.asks, self._when, self._since_ns = Question.PAIN, when, now_ns
            if when != AFTER:  # else the last word stays
                self.goes_on = GoesOn.NOT_ASKED

    def answer(self, data: int) -> None:
        """Take a message of therapy/answer; what was not asked, or no answer can be, is left."""
        question, value = divmod(data, _BASE)
        if not self.asks or question != self.asks or value > MOST:
            return
        scale = _SCALE[self.asks]
        first = self._first.setdefault(scale, value)
        self.told[scale] = float(value)
        self.scores.append((f"{scale}_{self._when}", float(value)))
        self.asks = _NEXT[self.asks]
        if self._when != AFTER and (value > HIGH or value >= first + RISE):
            self.goes_on = GoesOn.ASKED

    def settle(self, goes_on: bool) -> None:
        """Take the therapist's word: whoever goes on or ends asks no more."""
        self.asks = Question.NOTHING
        if self.goes_on == GoesOn.ASKED:
            self.goes_on = GoesOn.YES if goes_on else GoesOn.NO
            self.scores.append(("went_on", float(goes_on)))

    def follow(self, now_ns: int) -> None:
        """Give up what nobody has answered for `LASTS_NS`, at now_ns [ns]."""
        if self._when == AFTER and now_ns - self._since_ns > LASTS_NS:
            self.asks = Question.NOTHING
