# SPDX-License-Identifier: Apache-2.0
"""What of the thesis is here: docs/thesis.md is made of docs/thesis.yaml, and both are true."""

from __future__ import annotations

import inspect
import textwrap
from collections import Counter
from pathlib import Path

import pytest
import yaml

from screw_module_ros.identification.experiments import EXPERIMENTS

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/thesis.md"
ROWS = yaml.safe_load((ROOT / "docs/thesis.yaml").read_text(encoding="utf-8"))
STATES = ("done", "part", "no")
FIGURES = {
    "1": 2, "2": 1, "3": 11, "4": 14, "5": 34, "6": 13, "A": 7, "C": 1, "D": 5,
}  # fmt: skip
"""Figures of each chapter and appendix."""


def listed(row: dict, *keys: str) -> list[str]:
    return [item for key in keys for item in row.get(key, ())]


def figure_counts(chapter: str = "") -> tuple[int, int]:
    """Return the figures drawn again and all figures, of a chapter or of all."""
    drawn = [name for row in ROWS for name in listed(row, "drawn") if name.startswith(chapter)]
    every = [name for row in ROWS for name in listed(row, "drawn", "others")
             if name.startswith(chapter)]  # fmt: skip
    return len(drawn), len(every)


def headline() -> str:
    """Return the counts in one sentence."""
    states = Counter(row["state"] for row in ROWS)
    return (
        f"Of {len(ROWS)} sections of the thesis {states['done']} are done, {states['part']} in "
        f"part and {states['no']} not; {'{} of {}'.format(*figure_counts())} figures are drawn "
        "again"
    )


def page() -> str:
    """Return docs/thesis.md."""
    by_chapter = ", ".join(
        f"{'{} of {}'.format(*figure_counts(f'{name}-'))} in {name}" for name in FIGURES
    )
    tables = {name: state for row in ROWS for name, state in row.get("tables", {}).items()}
    lines = [
        "# The thesis's contents",
        "",
        filled("Made of `docs/thesis.yaml` by `test/test_thesis_contents.py`: do not edit. *done*: "
               "in code and report, or in a notebook below `docs/thesis/`; *part*: some of it; "
               "*no*: nothing. Names without a folder are experiments of `make reproduce`; "
               "*figures*: drawn again, of the section's."),
        "",
        filled("The notebooks are stored without output: [appendix A](thesis/appendix_a.ipynb), "
               "[appendix D](thesis/appendix_d.ipynb), [Table 5.1](thesis/table_5_1.ipynb). "
               "`tools/run python tools/notebooks.py` runs them and leaves them with their output "
               "in `build/notebooks/`."),
        "",
        filled(f"{headline()} (by chapter: {by_chapter}). The others are photographs, sketches, "
               "bond graphs and block diagrams. Tables: "
               f"{', '.join(map(' '.join, tables.items()))}."),
        "",
        "| section | about | state | where | figures | what is missing |",
        "|---|---|---|---|---|---|",
    ]
    for row in ROWS:
        where = ", ".join(f"`{name}`" for name in listed(row, "experiments", "files"))
        drawn, every = listed(row, "drawn"), listed(row, "drawn", "others")
        shown = f"{len(drawn)} of {len(every)}" if every else ""
        lines.append(
            f"| {row['section']} | {row['about']} | {row['state']} | {where} | {shown} | "
            f"{row.get('missing', '')} |"
        )
    return "\n".join(lines) + "\n"


def filled(text: str) -> str:
    return textwrap.fill(text, 140, break_long_words=False, break_on_hyphens=False)


def test_the_page_is_that_of_the_data(request):
    if request.config.getoption("--write"):
        PAGE.write_text(page(), encoding="utf-8")
    assert PAGE.read_text(encoding="utf-8") == page()


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row["section"])
def test_what_a_row_names_exists(row):
    known = {"section", "about", "state", "experiments", "files", "drawn", "others", "tables",
             "missing"}  # fmt: skip
    assert set(row) <= known
    assert row["state"] in STATES
    assert set(listed(row, "experiments")) <= set(EXPERIMENTS)
    for file in listed(row, "files"):
        assert (ROOT / file).is_file(), file
    assert listed(row, "experiments", "files") or row["state"] == "no"
    assert bool(row.get("missing")) == (row["state"] != "done"), "what is missing is said"


WITH_FIGURES = [row for row in ROWS if row.get("drawn")]


@pytest.mark.parametrize("row", WITH_FIGURES, ids=lambda row: row["section"])
def test_a_figure_that_counts_is_drawn_by_an_experiment_or_a_notebook_of_its_row(row):
    sources = [inspect.getsource(inspect.getmodule(EXPERIMENTS[name].run))
               for name in listed(row, "experiments")]  # fmt: skip
    books = [(ROOT / name).read_text("utf-8") for name in listed(row, "files")
             if name.endswith(".ipynb")]  # fmt: skip
    for figure in row["drawn"]:
        drawn = any(f'"{figure}"' in source for source in sources)
        assert drawn or any(f"Fig. {figure}: " in book for book in books), figure


def test_every_figure_of_the_thesis_stands_once():
    names = [name for row in ROWS for name in listed(row, "drawn", "others")]
    wanted = {f"{chapter}-{number}" for chapter, most in FIGURES.items()
              for number in range(1, most + 1)}  # fmt: skip
    assert sorted(names) == sorted(wanted)


def test_every_experiment_has_its_section():
    assert {name for row in ROWS for name in listed(row, "experiments")} == set(EXPERIMENTS)
