# SPDX-License-Identifier: Apache-2.0
"""Missing samples by their numbers, in bags of today and in older ones."""

from __future__ import annotations

import random

import pytest

from screw_module_ros.therapy.gaps import gaps_of
from screw_module_ros.therapy.hand import HandSample


def at(*numbers):
    return [HandSample(number % 2**32, 0, *[0.0] * 9) for number in numbers]


@pytest.mark.parametrize("step", [1, 5, 10])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.1, 0.3])
def test_each_sample_that_is_missing_is_counted(step, share):
    """In older bags the numbers are those of the encoder's ticks, of which some were shown."""
    chance = random.Random(f"{step} {share}")
    samples = at(*range(2**32 - 1_000, 2**32 + 5_000, step))
    kept = samples[:2] + [s for s in samples[2:-1] if chance.random() >= share] + samples[-1:]
    assert sum(gap.missing for gap in gaps_of(kept)) == len(samples) - len(kept)


def test_every_second_one_is_missing():
    """From the first sample to the last without exception that is no gap but another step.

    `session verify` knows the due one and finds it.
    """
    assert gaps_of(at(*range(0, 100, 2))) == ()
    assert sum(gap.missing for gap in gaps_of(at(*range(0, 100, 2), 99))) == 49


def test_a_repeated_or_older_number_is_no_gap():
    assert gaps_of([]) == gaps_of(at(7)) == gaps_of(at(7, 7, 7)) == ()
    assert gaps_of(at(7, 8, 8, 9, 5, 6)) == ()


def test_gaps_say_after_which_sample_and_how_many():
    assert gaps_of(at(0, 5, 20, 25, 30)) == ((5, 2),)
    assert gaps_of(at(2**32 - 10, 2**32 - 5, 2**32, 2**32 + 5, 2**32 + 15)) == ((5, 1),)
