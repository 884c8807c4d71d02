# SPDX-License-Identifier: Apache-2.0
"""The study: what it draws, what its figures are, and the table that it writes."""

from __future__ import annotations

import csv
import inspect
import json
import math

import laws_of_others
import numpy as np
import pytest
from click.testing import CliRunner
from laws_of_others import FLOOR

from screw_module_ros.control import modes
from screw_module_ros.identification import study
from screw_module_ros.identification.study import CASES, CENTRE, FIGURES, WANTED, drawn, measured
from screw_module_ros.plant.patient import hand_point


def test_rigs_are_drawn_within_their_ranges_and_are_the_same_for_a_seed():
    rigs = [drawn("B", seed) for seed in range(30)]
    assert rigs[7] == drawn("B", 7)
    supports = [rig.world.vertical.support_stiffness for rig in rigs]
    assert 5e6 <= min(supports) < 8e6 and 2.5e7 < max(supports) <= 4e7
    assert {rig.world.start.counts_per_turn for rig in rigs} == {2000, 4000, 8192, 20000}
    delays = [rig.loop.command_delay for rig in rigs]
    assert 0.4e-3 <= min(delays) < 0.5e-3 and 2.4e-3 < max(delays) <= 3e-3
    assert all(2e3 <= rig.grip.stiffness <= 2e4 for rig in rigs)
    assert drawn("A", 1).grip.stiffness == 0.0
    planes = [study.drawn_plane("B", seed) for seed in range(15)]
    assert planes[3] == study.drawn_plane("B", 3)
    assert {rig.loop.rate for rig in planes} == {250.0, 500.0}
    inertias = [rig.world.planar.inertia for rig in planes]
    assert 4 <= inertias.count("inmotion2") <= 11 and set(inertias) == {"appendix_d", "inmotion2"}
    assert all(1e-3 <= rig.loop.force_age <= 3e-3 for rig in planes)


def test_every_case_has_figures_that_are_known():
    assert set(WANTED) == set(FIGURES)
    subjects = study.VERTICAL, study.PLANE, study.carried()
    shown = [names for subject in subjects for names in subject.figures.values()]
    assert {figure for names in shown for figure in names} == set(FIGURES)


@pytest.mark.parametrize(
    ("mode", "case", "figure", "low", "high"),
    [
        # A plain spring shows its friction, and an observer takes it away.
        (modes.IMPEDANCE, "small", "rms", 4.0, 20.0),
        (modes.IMPEDANCE, "small", "share", 1.0, 1.0),
        (modes.OBSERVER, "small", "rms", 0.0, 1.0),
        # In mode 1 hand (30 N) and spring (2 N) press, less the friction, of 16 N at most; the
        # transducer feels the hand alone.
        (modes.IMPEDANCE, "obstacle, not felt", "pressed", 12.0, 28.0),
        (modes.OBSERVER, "mode changed at rest", "sudden", 0.0, 5.0),
    ],
)
def test_figures_of_a_case(mode, case, figure, low, high):
    assert low <= measured("A", 1, mode, case)[figure] <= high


def test_reaches_are_as_fast_as_their_names():
    way, seconds = study._REACHES["reach 1 m/s, 10 m/s2"]
    path = CASES["reach 1 m/s, 10 m/s2"].trial(5, None).path
    times = np.linspace(0.2, 0.2 + seconds, 2001)
    heights = np.array([hand_point(path, t)[0] for t in times])
    speed = np.gradient(heights, times)
    assert heights[-1] - heights[0] == pytest.approx(way)
    assert heights[0] + 0.5 * way == pytest.approx(CENTRE)
    assert speed.max() == pytest.approx(1.0, abs=0.01)
    assert np.gradient(speed, times).max() == pytest.approx(10.0, abs=0.1)


def studied(folder, *words):
    """Run the command; return its table and its numbers of family A."""
    call = ["--folder", str(folder), "--workers", "1", "--rigs", "1", *words]
    run = CliRunner().invoke(study.study, call)
    assert run.exit_code == 0, run.output
    found = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    return (folder / "study.md").read_text(encoding="utf-8"), found["A"]


@pytest.mark.usefixtures("in_a_thread")
def test_the_command_writes_one_table_of_median_and_worst(tmp_path):
    text, found = studied(tmp_path, "--rigs", "2", "--mode", "1", "--case", "held")
    values = found["held"]["rms"]["1"]
    assert values == [measured("A", seed, 1, "held")["rms"] for seed in (1, 2)]
    assert f"{np.median(values):.3g} / {max(values):.3g}" in text
    assert "Family B, soft grip" in text and "study --rigs 2 --first-seed 1" in text


def rows_in(folder):
    """Return the table of the rigs."""
    with (folder / "study.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.long
@pytest.mark.usefixtures("in_a_thread")
def test_a_law_of_another_package_stands_beside_the_shipped_ones(tmp_path):
    """On the same rigs, in the same trials; one row for each rig and mode."""
    words = ["--law", "laws_of_others:THE_FLOOR", "--mode", "1", "--mode", str(FLOOR),
             "--case", "small", "--case", "mode changed at rest"]  # fmt: skip
    text, found = studied(tmp_path, *words)
    assert "| mode 1 | FLOOR | wanted |" in text and "study --law laws_of_others:THE_FLOOR" in text
    rows = rows_in(tmp_path)
    assert [(row["family"], row["seed"], row["kind"]) for row in rows] == [
        ("A", "1", "mode 1"), ("A", "1", "FLOOR"), ("B", "1", "mode 1"), ("B", "1", "FLOOR"),
    ]  # fmt: skip
    (plain,), (floor,) = (found["small"]["rms"][str(mode)] for mode in (1, FLOOR))
    assert (float(rows[0]["small: rms [N]"]), float(rows[1]["small: rms [N]"])) == (plain, floor)
    assert 0.0 < floor < plain, "its force feedback takes a part of the friction away"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--law", "laws_of_others:NONE"], "has no attribute 'NONE'"),
        (["--mode", str(FLOOR)], f"--mode {FLOOR} is none of 1, 2, 3, 4, 5"),
        (["--law", "laws_of_others:THE_FLOOR", "--plane"], "--law and --support are"),
        (["--support", "--plane"], "without --plane"),
        (["--support", "--case", "slow"], "one of hangs, 20 N, not carried"),
        (["--scheduler", "tcp://127.0.0.1:1"], "--scheduler"),
    ],
)
def test_what_cannot_be_studied_is_told_in_a_sentence(tmp_path, words, said):
    run = CliRunner().invoke(study.study, ["--folder", str(tmp_path), *words])
    assert run.exit_code == 2 and said in run.output


@pytest.mark.usefixtures("in_a_thread")
def test_a_law_that_cannot_be_compiled_is_told_with_its_line(tmp_path):
    words = ["--law", "laws_of_others:THE_LOOKED_UP", "--mode", "160", "--case", "small"]
    run = CliRunner().invoke(study.study, ["--folder", str(tmp_path), "--rigs", "1", *words])
    line = next(
        number for number, text in enumerate(inspect.getsource(laws_of_others).splitlines(), 1)
        if "TABLE[0]" in text
    )  # fmt: skip
    told = " ".join(run.output.split())
    assert run.exit_code == 1
    assert "law looked_up cannot be compiled for a simulation: " in told
    assert f"laws_of_others.py, line {line}: Untyped global name 'TABLE'" in told
    assert "functions at the top of a module" in told and "Traceback" not in told


@pytest.mark.long
def test_a_cluster_gives_the_same_rows(tmp_path):
    """Needs the extra `cluster`: skipped without it."""
    distributed = pytest.importorskip("distributed")
    cluster = {"processes": False, "dashboard_address": None, "threads_per_worker": 1}
    words = ["--folder", "{}", "--rigs", "1", "--case", "held", "--mode", "1", "--mode", "5"]
    with distributed.LocalCluster(n_workers=1, **cluster) as made:
        for name, more in (("here", ["--workers", "1"]), ("there", ["--scheduler"])):
            at = [made.scheduler_address] if name == "there" else []
            call = [word.format(tmp_path / name) for word in words]
            run = CliRunner().invoke(study.study, [*call, *more, *at])
            assert run.exit_code == 0, run.output
    assert rows_in(tmp_path / "here") == rows_in(tmp_path / "there")


@pytest.mark.usefixtures("in_a_thread")
def test_the_plane_has_a_table_of_its_own(tmp_path):
    """Rig 2, with 3.5e5 N/m and the lighter arm, bears the gain; rig 1, with 1.4e5 N/m, not."""
    text, found = studied(tmp_path, "--plane", "--case", "fast_x", "--first-seed", "2")
    assert "no feedback" in text and "study --plane" in text
    assert found["fast_x"]["rms"]["1"][0] < 0.3 * found["fast_x"]["rms"]["0"][0]
    assert study.measured_plane("A", 1, 1, "fast_x")["share"] == 0.0
    words = ["--plane", "--folder", str(tmp_path), "--case", "obstacle, not felt"]
    assert CliRunner().invoke(study.study, words).exit_code == 2


def test_the_least_share_is_the_worst():
    rows = study.table_rows({"slow": {"share": {5: [0.2, 1.0, 0.9]}}}, {5: "mode 5"})
    assert rows[1] == ("slow", "least share", "0.9 / 0.2", "1")
    assert math.isinf(WANTED["peak"])
