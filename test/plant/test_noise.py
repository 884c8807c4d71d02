# SPDX-License-Identifier: Apache-2.0
"""The noise generator: normal, uncorrelated, the same compiled."""

from __future__ import annotations

import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.compiled import compiled
from screw_module_ros.plant.sensor import normal_pair, seeded, uniform


def draw(seed, count):
    first, second = seeded(seed)
    numbers = []
    for _ in range(count // 2):
        one, other, first, second = normal_pair(first, second)
        numbers += [one, other]
    return numbers


def test_moments_of_a_normal_distribution():
    numbers = draw(1, 40_000)
    assert statistics.fmean(numbers) == pytest.approx(0.0, abs=0.02)
    assert statistics.stdev(numbers) == pytest.approx(1.0, abs=0.02)
    inside = sum(abs(number) < 1.0 for number in numbers) / len(numbers)
    assert inside == pytest.approx(0.6827, abs=0.01)


def test_neighbours_and_seeds_are_uncorrelated():
    numbers, others = draw(1, 20_000), draw(2, 20_000)
    for shifted in (numbers[1:], numbers[2:], others):
        pairs = list(zip(numbers, shifted, strict=False))
        assert sum(a * b for a, b in pairs) / len(pairs) == pytest.approx(0.0, abs=0.03)


@given(st.integers(0, 2**40))
def test_uniform_stays_between_zero_and_one(seed):
    first, second = seeded(seed)
    for _ in range(20):
        number, first, second = uniform(first, second)
        assert 0.0 < number < 1.0


def test_compiled_noise_is_the_same():
    twin = compiled(normal_pair)
    state = seeded(5)
    for _ in range(100):
        plain, quick = normal_pair(*state), twin(*state)
        assert quick[2:] == plain[2:]
        assert quick[:2] == pytest.approx(plain[:2], rel=1e-12)
        state = plain[2:]
