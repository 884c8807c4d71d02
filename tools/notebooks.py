# SPDX-License-Identifier: Apache-2.0
"""Run the notebooks of docs/thesis and examples; with their output they lie in build/notebooks.

    tools/run python tools/notebooks.py [NAME...]

The repository stores them without output: what they show is what this version of the code finds.
"""

from __future__ import annotations

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOKS = sorted((ROOT / "docs/thesis").glob("*.ipynb"))
EXAMPLES = sorted((ROOT / "examples/notebooks").glob("*.ipynb"))
_LONGEST_S = 300


def executed(file: Path, last: str = "") -> nbformat.NotebookNode:
    """Return a notebook with its output, run in a kernel of its own beside its file.

    last: code of one more cell. Raises CellExecutionError where a cell fails.
    """
    notebook = nbformat.read(file, as_version=4)
    if last:
        notebook.cells.append(nbformat.v4.new_code_cell(last))
    place = {"metadata": {"path": str(file.parent)}}
    return NotebookClient(notebook, timeout=_LONGEST_S, resources=place).execute()


def main() -> int:
    """Run those that are named, or all of them; return the exit code."""
    folder, named = ROOT / "build/notebooks", sys.argv[1:]
    folder.mkdir(parents=True, exist_ok=True)
    chosen = [file for file in (*NOTEBOOKS, *EXAMPLES) if file.stem in named or not named]
    if not chosen:
        sys.exit(f"there are {', '.join(file.stem for file in (*NOTEBOOKS, *EXAMPLES))}")
    for file in chosen:
        nbformat.write(executed(file), folder / file.name)
        print(folder / file.name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
