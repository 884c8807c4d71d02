# SPDX-License-Identifier: Apache-2.0
"""Some cases of each fuzzer on every run; `make fuzz` runs as many as wanted."""

from __future__ import annotations

import fuzz
import pytest

pytestmark = pytest.mark.long

CASES = {"bags": 20, "yaml": 150, "can": 60, "nodes": 200, "state": 300, "therapy": 10}


@pytest.mark.parametrize("name", fuzz.TARGETS)
def test_odd_input_ends_in_sentences(name, tmp_path, capsys):
    failures = fuzz.fuzz(name, 1, tmp_path, range(CASES[name]), 1e9)
    assert not failures, failures[0]
    assert f"cases: {CASES[name]}" in capsys.readouterr().out
