# SPDX-License-Identifier: Apache-2.0
"""Missing samples by their tick numbers, at whatever rates the robot ticks and shows the hand."""

from __future__ import annotations

import random

import pytest

from screw_module_ros.graph import DECIMATED_RATE
from screw_module_ros.therapy.gaps import gaps_of
from screw_module_ros.therapy.hand import HandSample

_US = 1_000_000


def at(*numbers):
    return [HandSample(number, 0, *[0.0] * 9) for number in numbers]


def shown(robot: int, hand: int, count: int = 600, first: int = 7_000) -> list[HandSample]:
    """What a robot ticking at `robot` [Hz] shows at `hand` [Hz]: the newest decimated sample.

    Its encoder publishes each n-th tick so that about 200 a second result; the hand's state comes
    a half tick after the whole multiples of its period.
    """
    tick, period = _US // robot, _US // hand
    every = max(1, round(robot / DECIMATED_RATE))
    moments = (number * period + tick // 2 for number in range(first, first + count))
    return at(*(moment // (every * tick) * every % 2**32 for moment in moments))


RATES = [
    (robot, hand) for robot in (125, 200, 250, 400, 500, 625, 800, 1000, 1250, 2000)
    for hand in (100, 125, 200, 250, 400)
]  # fmt: skip


@pytest.mark.parametrize(("robot", "hand"), RATES)
def test_what_was_never_due_is_not_missing(robot, hand):
    for first in range(7_000, 7_004):
        assert gaps_of(shown(robot, hand, first=first)) == ()


@pytest.mark.parametrize(("robot", "hand"), RATES)
@pytest.mark.parametrize("place", [300, 303])
def test_samples_that_are_missing_are_found(robot, hand, place):
    """A sample that only repeats a number is no loss: it would tell nothing new."""
    samples = shown(robot, hand)
    lost = 5
    before, after = samples[place - 1].sequence, samples[place + lost].sequence
    new = {sample.sequence for sample in samples[place : place + lost]} - {before, after}
    gaps = gaps_of(samples[:place] + samples[place + lost :])
    assert sum(gap.missing for gap in gaps) == len(new)
    assert [gap.after for gap in gaps[:1]] == [before] * bool(new)


@pytest.mark.parametrize("lost", [300, 301, 302, 303])
def test_one_lost_sample_counts_once_whatever_its_step(lost):
    """Of the steps 1, 1, 1, 2, two that are merged may look like one that is due."""
    samples = shown(250, 200)
    (gap,) = gaps_of(samples[:lost] + samples[lost + 1 :])
    assert gap.missing == 1
    assert abs(gap.after - samples[lost].sequence) <= 5


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3, 0.5])
@pytest.mark.parametrize(("robot", "hand"), [(1000, 200), (200, 200), (2000, 400)])
def test_losses_by_chance_are_no_schedule(share, robot, hand):
    chance = random.Random(f"{share} {robot}")
    samples = shown(robot, hand)
    kept = [sample for sample in samples if chance.random() >= share]
    due = {sample.sequence for sample in samples if kept[0].sequence <= sample.sequence}
    lost = sum(number < kept[-1].sequence for number in due) + 1 - len(
        {sample.sequence for sample in kept}
    )
    assert sum(gap.missing for gap in gaps_of(kept)) == lost


def test_a_loss_now_and_then_at_even_distances_is_a_loss():
    samples = shown(1000, 200)
    kept = [sample for index, sample in enumerate(samples) if index % 60 != 59]
    assert sum(gap.missing for gap in gaps_of(kept)) == 9


def test_gaps_say_after_which_sample_and_how_many():
    assert gaps_of([]) == gaps_of(at(7)) == gaps_of(at(7, 7, 7)) == ()
    assert gaps_of(at(0, 5, 20, 25, 30)) == ((5, 2),)
    assert gaps_of(at(2**32 - 10, 2**32 - 5, 0, 5, 15)) == ((5, 1),)
