# SPDX-License-Identifier: Apache-2.0
"""The report: verdicts from numbers, misses by name, one page from a small study."""

import math
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from click.testing import CliRunner

from screw_module_ros.identification import force_error, page, reproduce
from screw_module_ros.identification.experiments import EXPERIMENTS
from screw_module_ros.identification.lab import Lab, MissingResult
from screw_module_ros.identification.page import html_page
from screw_module_ros.identification.report import (
    CALCULATION,
    CHOSEN,
    ELSEWHERE,
    INPUT,
    PREDICTION,
    WANTED,
    Checked,
    Compared,
    Criterion,
    Module,
    Outcome,
    Report,
    checked_rows,
    compared_rows,
    value_text,
)
from screw_module_ros.identification.results import (
    DERIVED,
    Published,
    Quantity,
    Result,
    load_result,
)
from screw_module_ros.identification.stand import LoopSettings

TEN = Published("gravity_about", 0.5)


def quantity(value, uncertainty=math.nan, **more):
    return Quantity("gravity", value, uncertainty, "N", "weight", **more)


def module_with(**outcomes):
    return Module(None, None, LoopSettings(), Path("."), outcomes)


@pytest.mark.parametrize(
    ("value", "thesis", "verdict"),
    [
        (10.0, TEN, "agrees"),
        (10.5, TEN, "agrees"),
        (10.6, TEN, "differs"),
        (-10.0, TEN, "differs"),
        (math.nan, TEN, "differs"),
        (12.0, TEN._replace(tolerance=4.0), "compatible"),
    ],
)
def test_published_figure_agrees_within_its_tolerance(value, thesis, verdict):
    row = Compared("gravity", quantity(value), thesis)
    assert row.verdict == verdict
    (cells,) = compared_rows([row], PREDICTION)
    assert (cells[1], cells[-1]) == ("*gravity*: weight", verdict)


def test_only_predictions_are_in_the_headline():
    """What the plant was given, and what is arithmetic, counts apart."""
    rows = (
        quantity(10.1, thesis=TEN),
        quantity(9.0, thesis=TEN),
        quantity(10.0, thesis=TEN._replace(given_to_plant=True)),
        quantity(10.0, thesis=TEN._replace(chosen_by="the contact")),
        quantity(10.0, kind=DERIVED, thesis=TEN),
        quantity(10.0),
    )
    result = Result("repeatability", rows, {})
    report = Report([module_with(repeatability=Outcome(result, "", 1.0))])
    groups = [row.group for row in report.compared]
    assert groups == [PREDICTION, PREDICTION, INPUT, CHOSEN, CALCULATION]
    assert report.headline.startswith("Predictions: 1 of 2 agree with the thesis, 0 more")


WEIGHT = Criterion("gravity", "gravity", lambda m: 10.0, 0.3)
MASS = Criterion("inertia", "mass", lambda m: 5.0, 0.1, True)
LINE = Criterion("static_torque", "correlation", None, 0.9999)
LEFT = Criterion("static_torque", "largest_at_handle", None, 1.5, most=True)


@pytest.mark.parametrize(
    ("wanted", "value", "stated", "truth", "verdict"),
    [
        (WEIGHT, 10.29, 0.1, 10.0, "recovered"),
        (WEIGHT, 9.6, 0.2, 10.0, "MISSED"),
        (WEIGHT, math.nan, 0.1, 10.0, "MISSED"),
        (MASS, 5.49, 0.2, 5.0, "recovered"),
        (MASS, 5.51, 0.2, 5.0, "MISSED"),
        (LINE, 0.99991, math.nan, math.nan, "recovered"),
        (LINE, 0.99989, math.nan, math.nan, "MISSED"),
        (LEFT, 1.5, math.nan, math.nan, "recovered"),
        (LEFT, 1.6, math.nan, math.nan, "MISSED"),
        # Near enough, but not what the statement says.
        (WEIGHT, 10.29, 0.097, 10.0, "recovered"),
        (WEIGHT, 10.29, 0.096, 10.0, "BEYOND 3 SIGMA"),
        (WEIGHT, 9.71, 0.003, 10.0, "BEYOND 3 SIGMA"),
        (WEIGHT, 10.0, math.nan, 10.0, "BEYOND 3 SIGMA"),
    ],
)
def test_what_is_wanted_is_checked(wanted, value, stated, truth, verdict):
    row = Checked(module_with(), wanted, quantity(value, stated), truth)
    (cells,) = checked_rows([row])
    assert cells[-1] == verdict
    assert (row.met, row.honest) == (verdict != "MISSED", verdict != "BEYOND 3 SIGMA")


@pytest.mark.parametrize(
    ("value", "spread", "text"),
    [
        (10.0323, 0.0046, "10.0323 ± 0.0046 N"),
        (8.61, 0.62, "8.61 ± 0.62 N"),
        (1.9e6, 3e5, "1.9e+06 ± 3e+05 N"),
        (0.99998934, math.nan, "0.999989 N"),
        (12.0, 0.0, "12 N"),
    ],
)
def test_values_are_written_as_people_do(value, spread, text):
    assert value_text(quantity(value, spread)) == text


def test_every_kind_of_miss_is_named(module):
    worse = Result("compensation", (Quantity("ratio", 1.1, 0.1, "", "ratio"),), {})
    weighed = (
        quantity(5.0, thesis=TEN._replace(why="another planet")),
        quantity(6.0, thesis=TEN)._replace(name="gravity_thesis"),
        Quantity("play", 0.0, math.nan, "m", "play"),
        Quantity("guide", 0.31, 0.003, "N", "guide"),
    )
    outcomes = {
        "inertia": Outcome(None, "the result of friction_model is needed", 0.1),
        "compensation": Outcome(worse, "", 0.1),
        "gravity": Outcome(Result("gravity", weighed, {}), "", 0.1),
    }
    misses = Report([Module(None, module, LoopSettings(), Path("."), outcomes)]).misses
    text = "\n".join(miss.text for miss in misses)
    for part in ("friction_model is needed", "no better", "another planet", "no explanation",
                 "truth 10.04", "3.3 sigma apart"):
        assert part in text
    assert [miss.serious for miss in misses] == [*[True] * 6, False]


def test_criteria_name_experiments_that_exist(module):
    assert {row.experiment for row in WANTED} <= set(EXPERIMENTS)
    truth = {row.quantity: row.truth for row in WANTED}
    nominal = Module(None, module, LoopSettings(), Path("."), {})
    assert truth["gravity"](nominal) == pytest.approx(10.04, abs=0.01)
    assert truth["mass"](nominal) == pytest.approx(5.49, abs=0.01)


def test_cells_cannot_break_a_table(tmp_path):
    cell = quantity(1.0)._replace(text="x|y")
    result = Result("repeatability", (cell,), {})
    report = Report([module_with(repeatability=Outcome(result, "", 1.0))])
    text = page.markdown(report, {"repeatability": {}}, 1.0)
    assert "<td>x|y</td>" in html_page(text, tmp_path)


def reproduced(folder, *words):
    """Run the command; return its exit code and output."""
    given = ["--folder", str(folder), "--workers", "1", *words]
    done = CliRunner().invoke(reproduce.reproduce, given)
    return done.exit_code, done.output


@pytest.mark.long
@pytest.mark.usefixtures("in_a_thread")
def test_small_reproduction_from_the_command_line(tmp_path):
    only = ["static_torque", "amplifier_response"]
    words = ["--seeds", "1", "--strict", *(word for name in only for word in ("--only", name))]
    code, output = reproduced(tmp_path, *words)
    assert code == 0, output
    text, html = ((tmp_path / f"report.{end}").read_text() for end in ("md", "html"))
    for name in only:
        assert f"## {name}" in text
        assert f'<a href="#{name}">' in html and f'<h2 id="{name}">' in html
    assert text.index("## In short") < text.index("## Contents") < text.index("## Predictions")
    assert ELSEWHERE in text and ELSEWHERE in " ".join(output.split())
    assert "seed 1" in text and '<tr class="good">' in html
    figures = re.findall(r'<img src="([^"]+)"', html)
    assert len(figures) >= 5
    assert all(figure.startswith("data:image/png;base64,") for figure in figures), "one file"
    parts = sorted((tmp_path / "thesis" / "parts").rglob("*.npz"))
    times = [part.stat().st_mtime_ns for part in parts]
    assert reproduced(tmp_path, "--seeds", "0", "--only", "static_torque")[0] == 0
    assert [part.stat().st_mtime_ns for part in parts] == times, "finished trials are kept"


@pytest.mark.usefixtures("in_a_thread")
def test_what_fails_is_reported_not_hidden(tmp_path):
    code, _ = reproduced(tmp_path, "--seeds", "0", "--strict", "--only", "compensation")
    assert code == 3 and "is missing" in (tmp_path / "report.md").read_text()
    assert (tmp_path / "thesis").is_dir() and not list(tmp_path.glob("seed_*"))
    plant = tmp_path / "plant.yaml"
    plant.write_text("vertical: 3\n")
    code, output = reproduced(tmp_path / "o", "--plant", str(plant))
    assert code == 1 and "plant.yaml" in output


def test_a_failed_experiment_leaves_no_earlier_result_to_the_others(tmp_path, stand):
    """Mass and calibration of a module were computed with the friction of an earlier run's."""
    lab = Lab(stand, tmp_path)
    Result("friction_model", (), {}).save(tmp_path)
    assert reproduce._outcome(lab, "friction_model", "thesis").failure
    with pytest.raises(MissingResult):
        lab.result("friction_model")


@pytest.mark.long
def test_modes_of_a_law_of_another_package_are_measured_beside_the_shipped_ones(tmp_path):
    """`reproduce --law`: on the same module, in the same trials, in the same figure."""
    told, few = (lambda *_: None), {"force_error": {"modes": (1,), "cases": ("small",)}}
    with ThreadPoolExecutor(1) as pool:
        found = reproduce.examine(
            None, tmp_path, pool, told, ("force_error",), None, few, ("laws_of_others:THE_FLOOR",)
        )
    result = found.result("force_error")
    assert 0.0 < result.value("rms_floor_small") < result.value("rms_impedance_small")
    (figure,) = force_error.draw(load_result(found.folder, "force_error")).values()
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == ["impedance", "floor"]


def test_what_is_no_law_of_another_package_is_told_before_anything_runs(tmp_path):
    code, output = reproduced(tmp_path / "out", "--law", "laws_of_others:NONE")
    assert code == 2 and "has no attribute 'NONE'" in output and not (tmp_path / "out").exists()
    code, output = reproduced(
        tmp_path / "out", "--law", "laws_of_others:THE_FLOOR", "--coverage", "3"
    )
    assert code == 2 and "--coverage judges no law of others" in output
