# SPDX-License-Identifier: Apache-2.0
"""The report: verdicts from numbers, misses by name, one page from a small study."""

import math
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from screw_module_ros.identification.catalogue import EXPERIMENTS
from screw_module_ros.identification.in_process import LoopSettings
from screw_module_ros.identification.lab import Lab, MissingResult
from screw_module_ros.identification.report import study
from screw_module_ros.identification.report.command import command
from screw_module_ros.identification.report.misses import misses_of
from screw_module_ros.identification.report.published import PUBLISHED, Published
from screw_module_ros.identification.report.rows import WANTED, Checked, Compared, Criterion
from screw_module_ros.identification.report.study import Module, Outcome
from screw_module_ros.identification.report.tables import (
    checked_rows,
    compared_rows,
    markdown_table,
)
from screw_module_ros.identification.report.truth import true_mass, true_weight
from screw_module_ros.identification.report.words import value_text
from screw_module_ros.identification.results import Quantity, Result

pytestmark = pytest.mark.long


def quantity(value, uncertainty=math.nan, unit="N"):
    return Quantity("gravity", value, uncertainty, unit, "weight (thesis 10.04 N)")


@pytest.mark.parametrize(
    ("value", "verdict"),
    [(10.0, "agrees"), (10.5, "agrees"), (10.6, "differs"), (-10.0, "differs")],
)
def test_published_figure_agrees_within_its_tolerance(value, verdict):
    row = Compared(Published("gravity", "gravity", 10.0, "5.2.4", 0.5), quantity(value))
    (cells,) = compared_rows([row])
    assert cells[-1] == verdict
    assert cells[1] == "*gravity*: weight", "the thesis's figure stands in its own column"


@pytest.mark.parametrize(
    ("wanted", "value", "truth", "met"),
    [
        (Criterion("gravity", "gravity", lambda m: 10.0, 0.3), 10.29, 10.0, True),
        (Criterion("gravity", "gravity", lambda m: 10.0, 0.3), 9.6, 10.0, False),
        (Criterion("inertia", "mass", lambda m: 5.0, 0.1, True), 5.49, 5.0, True),
        (Criterion("inertia", "mass", lambda m: 5.0, 0.1, True), 5.51, 5.0, False),
        (Criterion("static_torque", "correlation", None, 0.9999), 0.99991, math.nan, True),
        (Criterion("static_torque", "correlation", None, 0.9999), 0.99989, math.nan, False),
        (Criterion("gravity", "gravity", lambda m: 10.0, 0.3), math.nan, 10.0, False),
    ],
)
def test_what_is_wanted_is_checked(wanted, value, truth, met):
    row = Checked(wanted, quantity(value), truth)
    assert row.met is met
    (cells,) = checked_rows([row])
    assert cells[-1] == ("recovered" if met else "MISSED")


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


def module_with(outcomes):
    return Module(None, None, LoopSettings(), Path("."), outcomes)


def test_every_kind_of_miss_is_named():
    worse = Result("compensation", (Quantity("ratio", 1.1, 0.1, "", "ratio"),), {})
    module = module_with(
        {
            "inertia": Outcome(None, "the result of friction_model is needed", 0.1),
            "compensation": Outcome(worse, "", 0.1),
        }
    )
    explained = Published("gravity", "gravity", 5.0, "5.2.4", 0.1, "another planet")
    unexplained = Published("gravity", "gravity", 6.0, "5.2.4", 0.1)
    rows = [Compared(explained, quantity(10.0)), Compared(unexplained, quantity(10.0))]
    checks = [(module, Checked(Criterion("gravity", "gravity", len, 0.3), quantity(10.0), 9.0))]
    misses = list(misses_of([module], rows, checks))
    text = "\n".join(miss.text for miss in misses)
    for part in ("friction_model is needed", "no better", "another planet", "no explanation", "9"):
        assert part in text
    assert [miss.serious for miss in misses] == [True, True, True, True, False]


def test_rows_name_experiments_that_exist_and_differences_that_can_be():
    for row in (*PUBLISHED, *WANTED):
        assert row.experiment in EXPERIMENTS
    assert all(row.near > 0.0 for row in PUBLISHED)
    assert len({(row.experiment, row.quantity) for row in PUBLISHED}) == len(PUBLISHED)


def test_cells_cannot_break_a_table():
    table = list(markdown_table("", ("a", "b"), [("x|y", "z")]))
    assert table[2] == "| x\\|y | z |"


def test_truth_is_the_thesis_s(module):
    assert true_weight(module) == pytest.approx(10.04, abs=0.01)
    assert true_mass(module) == pytest.approx(5.49, abs=0.01)

def test_changed_source_is_noticed(monkeypatch, tmp_path):
    before = study.fingerprint_of_sources()
    assert before == study.fingerprint_of_sources()
    monkeypatch.setattr(study, "_MADE_OF", study._MADE_OF[:-1])
    assert study.fingerprint_of_sources() != before


def test_small_reproduction_from_the_command_line(tmp_path):
    folder = tmp_path / "out"
    only = ["static_torque", "current_response", "compliant_mounting", "back_drive"]
    words = ["--folder", str(folder), "--seeds", "1", "--strict", "--workers", "1"]
    for name in only:
        words += ["--only", name]
    done = CliRunner().invoke(command, words)
    assert done.exit_code == 0, done.output
    text = (folder / "report.md").read_text()
    page = (folder / "report.html").read_text()
    for name in only:
        assert f"## {name}" in text
    assert "probably a misprint of 2000" in text, "a known difference is named"
    assert "seed 1" in text
    figures = re.findall(r'<img src="([^"]+)"', page)
    assert len(figures) >= 9
    for figure in figures:
        assert (folder / figure).stat().st_size > 5000
    assert '<tr class="good">' in page
    parts = sorted((folder / "thesis" / "parts").rglob("*.npz"))
    times = [part.stat().st_mtime_ns for part in parts]
    again = CliRunner().invoke(command, words)
    assert again.exit_code == 0, again.output
    assert [part.stat().st_mtime_ns for part in parts] == times, "finished parts are kept"


def test_failure_of_an_experiment_is_reported_not_hidden(tmp_path):
    words = ["--folder", str(tmp_path), "--seeds", "0", "--strict", "--workers", "1"]
    done = CliRunner().invoke(command, [*words, "--only", "compensation"])
    assert done.exit_code == 3
    assert "is missing" in (tmp_path / "report.md").read_text()


def test_a_failed_experiment_leaves_no_earlier_result_to_the_others(tmp_path):
    """Mass and calibration of a module were computed with the friction of an earlier run's."""
    lab = Lab(None, tmp_path)
    Result("friction_model", (), {}).save(tmp_path)
    assert study._outcome(lab, "friction_model", "thesis").failure
    with pytest.raises(MissingResult):
        lab.result("friction_model")


def test_bad_plant_file_is_told(tmp_path):
    plant = tmp_path / "plant.yaml"
    plant.write_text("vertical: 3\n")
    done = CliRunner().invoke(command, ["--folder", str(tmp_path / "o"), "--plant", str(plant)])
    assert done.exit_code == 1
    assert "plant.yaml" in done.output
