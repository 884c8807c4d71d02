# SPDX-License-Identifier: Apache-2.0
"""Some cases of each fuzzer on every run; `make fuzz` runs as many as wanted."""

from __future__ import annotations

import fuzz
import pytest
import runner

pytestmark = pytest.mark.long

CASES = {"bags": 20, "yaml": 150, "can": 60, "nodes": 200, "state": 300, "therapy": 10}


@pytest.mark.parametrize("name", CASES)
def test_odd_input_ends_in_sentences(name, tmp_path, capsys):
    failures = fuzz.fuzz(name, 1, tmp_path, range(CASES[name]), 1e9)
    assert not failures, failures[0]
    assert f"cases: {CASES[name]}" in capsys.readouterr().out


def test_every_fuzzer_is_run():
    assert CASES.keys() == fuzz.TARGETS.keys()


class Broken:
    """A target whose third case fails, and whose fourth hangs."""

    def __init__(self):
        self.counts = runner.Counter()
        self.number = 0

    def case(self, rng):
        self.number += 1
        if self.number == 3:
            raise KeyError("x")
        if self.number == 4:
            raise runner.Hangs("as its alarm does")

    def close(self):
        pass


def test_failures_are_counted_and_named():
    failures = runner.run(Broken(), "broken", 7, range(5), float("inf"))
    assert [text.splitlines()[0] for text in failures] == [
        "broken, case 2 of seed 7:", "broken, case 3 of seed 7:"
    ]  # fmt: skip


@pytest.mark.parametrize("told", ["", "x" * 10_000, "Traceback (most recent call last)"])
def test_what_is_no_sentence_fails(told):
    with pytest.raises(AssertionError):
        runner.sentence(ValueError(told))
