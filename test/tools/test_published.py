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
