# SPDX-License-Identifier: Apache-2.0
"""README and pages quote what the runs found: the paragraphs are those of docs/published.yaml."""

import re

import pytest
import yaml

import published

KEPT = yaml.safe_load(published.KEPT.read_text("utf-8"))
TEXTS = {name: (published.ROOT / name).read_text("utf-8") for name in published.PAGES}


@pytest.mark.parametrize("name", published.PAGES)
def test_a_page_quotes_the_kept_figures(name):
    assert published.rendered(TEXTS[name], KEPT) == TEXTS[name]


def test_every_paragraph_stands_somewhere():
    """README and limits say what the predictions are worth."""
    found = {name: set(re.findall(r"<!-- published: (\w+) -->", text))
             for name, text in TEXTS.items()}  # fmt: skip
    assert set.union(*found.values()) == set(published.BLOCKS)
    assert {"demo", "predictions", "requirements"} <= found["README.md"]
    assert "predictions" in found["docs/limits.md"]


def test_the_headline_is_quoted_word_by_word():
    for name in ("README.md", "docs/limits.md", "docs/characterization.md"):
        assert f"{KEPT['reproduction']['headline']}." in " ".join(TEXTS[name].split())


def test_the_caption_has_the_offset_from_the_line_that_the_figure_draws():
    told = published.demo_text(KEPT["demo"])
    for mode in KEPT["demo"]["modes"].values():
        assert mode["moving"] > mode["less_damper"], "the damper is part of it"
        assert f"{mode['moving']:.1f}" in told and f"{mode['less_damper']:.1f}" in told
    assert f"damper of {KEPT['demo']['damping']:g} Ns/m" in told


def demo_results(folder, moving):
    modes = [
        {"name": f"{number} mode", "offset": {"mean": moving}, "held": 0.5,
         "offset_without_damper": {"mean": moving - 0.3}}
        for number in (1, 3, 5)
    ]  # fmt: skip
    spring = {"stiffness": 100.0, "centre": 0.18, "damping": 6.0}
    (folder / "results.yaml").write_text(yaml.safe_dump({"spring": spring, "modes": modes}))
    return published.of_demo(folder)


def test_a_run_that_says_otherwise_is_told(tmp_path):
    kept = {"demo": demo_results(tmp_path, 9.4)}
    assert published.differences(kept, {"demo": demo_results(tmp_path, 9.4)}) == []
    (told,) = published.differences(kept, {"demo": demo_results(tmp_path, 9.8)})
    assert told.startswith("demo: modes is") and "9.8" in told


def test_a_new_run_changes_the_paragraph_alone(tmp_path):
    kept = {"demo": demo_results(tmp_path, 9.4)}
    page = "before\n<!-- published: demo -->\noutdated\n<!-- end -->\nafter\n"
    found = published.rendered(page, kept)
    assert found.startswith("before\n<!-- published: demo -->\n*`make demo`")
    assert found.endswith("*\n<!-- end -->\nafter\n") and "outdated" not in found
    assert published.rendered(found, kept) == found


STUDY = """# Study

Rigs 5 to 6 of each family: 4 trials in 1 s: `study --plane --impedance --rigs 2 --first-seed 5`.

## Family A, rigid hand: median / worst

| case | figure |
|---|---|
| 2 Hz | 0.5 / 0.7 |
"""


def test_the_tables_of_a_study_go_into_their_block_alone():
    blocks = ("plane -->\nkept", "plane impedance -->\nold")
    page = "".join(f"a\n<!-- study: {block}\n<!-- end -->\n" for block in blocks)
    assert published.study_name(STUDY) == "plane impedance"
    found = published.with_study(page, STUDY)
    assert "kept" in found and "old" not in found and "| 2 Hz | 0.5 / 0.7 |" in found
    assert "**Family A, rigid hand: median / worst**" in found
    assert published.with_study(found, STUDY) == found
    with pytest.raises(ValueError, match="no block"):
        published.with_study("nothing", STUDY)
    with pytest.raises(ValueError, match="no run of the shipped laws"):
        published.study_name("`study --law a.b:C --rigs 2`")


def test_a_block_of_the_studies_is_what_its_run_says():
    """Each has the run that found it: command, seeds and time."""
    page = published.STUDIES.read_text("utf-8")
    blocks = dict(re.findall(r"<!-- study: ([\w ]+) -->\n(.*?)<!-- end -->", page, re.DOTALL))
    for name, text in blocks.items():
        assert published.study_name(text) == name
        assert "of each family: " in text and "Family B, soft grip" in text
