# SPDX-License-Identifier: Apache-2.0
"""The notebooks of examples/ run and find what they did."""

from __future__ import annotations

import json

import pytest

pytest.importorskip("nbclient")

from notebooks import EXAMPLES, executed

NAMES = {"identify_module", "own_law", "session_bag", "thesis_figures"}


def test_there_are_the_four():
    assert {file.stem for file in EXAMPLES} == NAMES


@pytest.mark.long
@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_a_notebook_runs_in_a_kernel_and_finds_what_it_did(file, kept):
    last = "import json\nprint(json.dumps({name: float(value) for name, value in found.items()}))"
    (told,) = executed(file, last).cells[-1].outputs
    kept(json.loads(told.text), rel=1e-6)
