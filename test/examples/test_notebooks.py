# SPDX-License-Identifier: Apache-2.0
"""The notebooks of examples/: stored without output, they run and find what they did."""

from __future__ import annotations

import json

import pytest

nbformat = pytest.importorskip("nbformat")
pytest.importorskip("nbclient")

from notebooks import EXAMPLES, executed  # noqa: E402

NAMES = {"identify_module", "own_law", "session_bag", "thesis_figures"}


def test_there_are_the_four():
    assert {file.stem for file in EXAMPLES} == NAMES


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_a_notebook_is_stored_without_output(file):
    notebook = nbformat.read(file, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == [None] * len(code)
    assert not any(cell.outputs for cell in code)


@pytest.mark.long
@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_a_notebook_runs_in_a_kernel_and_finds_what_it_did(file, kept):
    last = "import json\nprint(json.dumps({name: float(value) for name, value in found.items()}))"
    (told,) = executed(file, last).cells[-1].outputs
    kept(json.loads(told.text), rel=1e-6)
