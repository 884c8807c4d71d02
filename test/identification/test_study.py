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
from screw_module_ros.control.vertical_settings import KNOWN_SHARE, VerticalSettings
from screw_module_ros.identification import impedance, study
from screw_module_ros.identification.rigs import DELAY, MODULE, Kind, drawn, drawn_plane
from screw_module_ros.identification.study import CASES, CENTRE, FIGURES, WANTED, measured
from screw_module_ros.plant.patient import hand_point

FIVE = Kind("mode 5", modes.OBSERVER)


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
    masses = [rig.hand.mass for rig in rigs]
    assert 1.0 <= min(masses) < 1.4 and 3.8 < max(masses) <= 5.0
    assert all(5.0 <= rig.weight <= 20.0 and 20.0 <= rig.tone <= 100.0 for rig in rigs)
    planes = [drawn_plane("B", seed) for seed in range(15)]
    assert planes[3] == drawn_plane("B", 3)
    assert max(rig.loop.delay for rig in planes) > 1.8e-3
    assert all(rig.loop.delay < 1.0 / rig.loop.rate for rig in planes), "`plane_loop` runs it"
    assert {rig.loop.rate for rig in planes} == {250.0, 500.0}
    inertias = [rig.world.planar.inertia for rig in planes]
    assert 4 <= inertias.count("inmotion2") <= 11 and set(inertias) == {"appendix_d", "inmotion2"}
    assert all(1e-3 <= rig.loop.force_age <= 3e-3 for rig in planes)


def test_every_case_has_figures_that_are_known():
    assert set(WANTED) == set(FIGURES)
    subjects = study.vertical(), study.PLANE, study.carried(), study.delivered()
    shown = [names for subject in subjects for names in subject.figures.values()]
    assert {figure for names in shown for figure in names} == set(FIGURES)


@pytest.mark.parametrize(
    ("mode", "case", "figure", "low", "high"),
    [
        # A plain spring shows its friction, and an observer takes it away.
        (modes.IMPEDANCE, "small", "rms", 4.0, 20.0),
        (modes.IMPEDANCE, "small", "share", 1.0, 1.0),
        (modes.OBSERVER, "small", "rms", 0.0, 1.0),
        # In mode 1 hand (41 N on this rig) and spring (2 N) press, less the friction, of 16 N at
        # most; the transducer feels the hand alone.
        (modes.IMPEDANCE, "obstacle, not felt", "pressed", 23.0, 39.0),
        (modes.OBSERVER, "mode begun at rest, no play", "sudden", 0.0, 5.0),
        # What hangs on the handle is carried: in mode 1 it presses with 9.7 N on this rig.
        (modes.OBSERVER, "carried arm, held", "rms", 0.0, 0.5),
        (modes.OBSERVER, "end of travel, 0.9 m/s", "blow", 5.0, 60.0),
    ],
)
def test_figures_of_a_case(mode, case, figure, low, high):
    assert low <= measured("A", 1, Kind("", mode), case)[figure] <= high


def test_a_law_knows_of_its_rig_what_the_column_says():
    """The delay that it is told is where the current has gone 63 % of the way."""
    rig, asked = drawn("A", 3), VerticalSettings()
    amplifier = rig.world.amplifier
    lag = 1.0 / (2.0 * math.pi * amplifier.bandwidth)
    assert rig.delay == pytest.approx(rig.loop.command_delay + amplifier.delay + lag)
    plain, timed, whole = (
        rig.law(Kind("", modes.OBSERVER, knows), asked) for knows in ("", DELAY, MODULE)
    )
    assert plain.observer_delay == asked.observer_delay != rig.delay
    assert timed.observer_delay == whole.observer_delay == rig.delay
    assert (timed.mass, timed.observer_inertia) == (asked.mass, 0.0)
    module = rig.world.vertical
    assert whole.mass == pytest.approx(module.turning_mass + module.moving_mass)
    assert whole.gravity == pytest.approx(module.moving_mass * module.gravity)
    assert whole.observer_inertia == KNOWN_SHARE


def test_chatter_is_told_in_newtons_where_millimetres_hide_it():
    """An arm of 30 kg that holds still on rig 1: 3.6 N, whose way is a hundredth of a millimetre.
    """
    found = measured("A", 1, FIVE, "arm of 30 kg, held")
    assert found["chatter"] > 1.0


def test_tone_pulls_a_hand_that_moves_away(monkeypatch):
    rig = drawn_plane("A", 4)
    toned = study.measured_plane("A", 4, Kind("", 0), "spastic")["rms"]
    monkeypatch.setattr(study, "drawn_plane", lambda family, seed: rig._replace(tone=0.0))
    assert abs(study.measured_plane("A", 4, Kind("", 0), "spastic")["rms"] - toned) > 0.05


def test_reaches_are_as_fast_as_their_names():
    way, seconds = study._REACHES["reach 1 m/s, 10 m/s2"]
    path = CASES["reach 1 m/s, 10 m/s2"].path
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
    values = found["held"]["rms"]["mode 1"]
    one = Kind("mode 1", modes.IMPEDANCE)
    assert values == [measured("A", seed, one, "held")["rms"] for seed in (1, 2)]
    assert f"| {np.median(values):.2g} / {max(values):.2g} |" in text
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
             "--case", "small", "--case", "mode begun at rest"]  # fmt: skip
    text, found = studied(tmp_path, *words)
    assert "| mode 1 | FLOOR | wanted |" in text and "study --law laws_of_others:THE_FLOOR" in text
    rows = rows_in(tmp_path)
    assert [(row["family"], row["seed"], row["kind"]) for row in rows] == [
        ("A", "1", "mode 1"), ("A", "1", "FLOOR"), ("B", "1", "mode 1"), ("B", "1", "FLOOR"),
    ]  # fmt: skip
    (plain,), (floor,) = (found["small"]["rms"][name] for name in ("mode 1", "FLOOR"))
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
    """Rig 2, with 3.5e5 N/m and the lighter arm, bears the gain."""
    text, found = studied(tmp_path, "--plane", "--case", "fast_x", "--first-seed", "2")
    assert "no feedback" in text and "study --plane" in text
    (felt,), (plain,) = found["fast_x"]["rms"]["feedback"], found["fast_x"]["rms"]["no feedback"]
    assert felt < 0.3 * plain
    words = ["--plane", "--folder", str(tmp_path), "--case", "obstacle, not felt"]
    assert CliRunner().invoke(study.study, words).exit_code == 2


def test_the_least_share_is_the_worst():
    rows = study.table_rows({"slow": {"share": {"mode 5": [0.2, 1.0, 0.9]}}})
    assert rows[1] == ("slow", "least share", "0.9 / 0.2", "1")
    assert math.isinf(WANTED["peak"])


@pytest.mark.usefixtures("in_a_thread")
def test_an_earlier_run_of_the_same_rigs_stands_beside_this_one(tmp_path):
    words = ["--mode", "1", "--case", "held"]
    studied(tmp_path / "old", *words)
    before = tmp_path / "old" / "study.json"
    text, found = studied(tmp_path / "new", *words, "--beside", str(before))
    assert "| mode 1 | mode 1, before | wanted |" in text
    assert list(found["held"]["rms"]) == ["mode 1"], "the numbers are those of this run"
    call = ["--folder", str(tmp_path), "--workers", "1", "--rigs", "2", *words]
    run = CliRunner().invoke(study.study, [*call, "--beside", str(before)])
    assert run.exit_code == 2 and "is not there for 2 rigs" in run.output


def test_the_delivered_impedance_is_what_is_asked_and_the_module_s_mass():
    """At 2 Hz a plain spring shows 5.5 kg and its friction, an observer a sixth of it."""
    plain = impedance.measured("T", 1, Kind("", modes.IMPEDANCE), "2 Hz")
    light = impedance.measured("T", 1, FIVE, "2 Hz")
    assert plain["mass"] == pytest.approx(5.5, abs=0.5)
    assert light["mass"] < 1.3 and light["apart"] < 0.3 * plain["apart"]
    bare = impedance.measured_plane("A", 2, Kind("", 0), "2 Hz")
    assert 4.0 < bare["mass"] < 9.0


def test_the_stable_range_ends_where_a_load_swings():
    """Rig 1 has a grip of 16 kN/m and 13 Ns/m: with the observer no spring is held calmly on it,
    unless a damper helps; a plain spring is, on every load."""
    bare, damped = (
        impedance.measured("B", 1, FIVE, f"hand, damper {b} Ns/m") for b in (0, 100)
    )
    assert bare == {"stiffest": 0.0, "kept": 0.0}
    assert 0.0 < damped["kept"] <= damped["stiffest"]
    for load in impedance.LOADS:
        plain = impedance.measured("B", 1, Kind("", modes.IMPEDANCE), f"{load}, damper 0 Ns/m")
        assert plain == {"stiffest": impedance.SPRINGS[-1], "kept": impedance.SPRINGS[-1]}


@pytest.mark.long
@pytest.mark.usefixtures("in_a_thread")
def test_a_figure_of_each_mode_is_drawn(tmp_path):
    text, _ = studied(tmp_path, "--impedance", "--mode", "1")
    assert "apparent mass [kg]" in text and "study --impedance --rigs 1" in text
    assert [file.name for file in tmp_path.glob("*.png")] == ["mode_1.png"]
