# SPDX-License-Identifier: Apache-2.0
"""The example that learns runs to its end, and finds the same policy again."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("gymnasium")  # an extra
pytestmark = pytest.mark.long
EXAMPLE = Path(__file__).parents[2] / "examples/learn_assistance.py"
SHORT = ("--rounds", "1", "--size", "2", "--episodes", "1", "--judged", "1")


def told() -> str:
    done = subprocess.run(
        [sys.executable, EXAMPLE, *SHORT], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return re.sub(r"learned in \d+ s", "", done.stdout)


def test_it_learns_and_judges_and_the_same_seed_finds_the_same():
    first = told()
    assert "round 1: reward" in first
    for policy in ("learned", "adaptation", "guidance, fixed", "adaptation, arm carried"):
        assert re.search(rf"^{policy} +all( +-?\d+\.\d+){{4}}$", first, re.MULTILINE), policy
    assert told() == first
