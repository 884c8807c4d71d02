# SPDX-License-Identifier: Apache-2.0
"""The support on the thesis's module and on rigs drawn by seed, judged by what was promised."""

from __future__ import annotations

import math

import pytest
from click.testing import CliRunner
from laws_of_others import FLOOR

from screw_module_ros.control import modes
from screw_module_ros.identification import study
from screw_module_ros.identification.carrying import CASES
from screw_module_ros.identification.rigs import Kind
from screw_module_ros.identification.study import WANTED, carried, measured_carrying

THREE, FIVE = Kind("mode 3", modes.FORCE_FEEDBACK), Kind("mode 5", modes.OBSERVER)
RIGS = [("A", 40917), ("A", 40920), ("B", 40918), ("B", 40925)]
MISSED = {
    ("moved, 0.1 m/s, +20 N", "error"): 2.5,
    ("held still by a hand, +20 N", "rest"): 2.0,
    ("hangs, 12 N, carried", "off"): 14.0,
    ("hangs, 20 N, carried", "off"): 12.0,
}
"""What modes 3 and 4 keep to without a calibration where they miss what is wanted."""


def kept(kind, name, found):
    """Every figure of a case is as good as wanted, or as what is known to be missed."""
    for figure, value in found.items():
        most = WANTED[figure]
        if kind != FIVE:
            most = max(most, MISSED.get((name, figure), most))
        assert value <= most, f"{name}, {figure}, {kind.name}"


@pytest.mark.parametrize("mode", carried().kinds, ids=lambda kind: kind.name)
@pytest.mark.parametrize("name", [name for name in CASES if "0.6 s" not in name])
def test_on_the_thesis_module(mode, name):
    kept(mode, name, measured_carrying("T", 1, mode, name))


def test_an_arm_sinks_that_is_not_carried_and_falls_without_torque():
    """What the support and the braking drive are for: the other cases would tell nothing else."""
    assert measured_carrying("T", 1, THREE, "hangs, 20 N, not carried")["sunk"] > 100.0
    coasts, brakes = (
        measured_carrying("T", 1, THREE, f"torque off, 20 N, drive {word}")["fallen"]
        for word in ("coasts", "brakes")
    )
    assert 100.0 < coasts and 3.0 < brakes < 12.0


@pytest.mark.long
@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("mode", [THREE, FIVE], ids=lambda kind: kind.name)
def test_on_rigs_that_it_was_not_made_on(rig, mode):
    """Without the reaches of 0.6 s, and in mode 3 the two soft grips that swing in motion."""
    for name in CASES:
        swings = rig[0] == "B" and mode == THREE and "moved" in name
        if "0.6 s" not in name and not swings:
            kept(mode, name, measured_carrying(*rig, mode, name))


@pytest.mark.long
def test_a_law_of_others_that_feeds_the_force_back_is_studied_too():
    subject = carried(("laws_of_others:THE_FLOOR",))
    assert [kind.mode for kind in subject.kinds] == [3, 4, 5, FLOOR]
    found = subject.measured("T", 1, subject.kinds[-1], "hangs, 20 N, not carried")
    assert math.isfinite(found["sunk"])


@pytest.mark.usefixtures("in_a_thread")
def test_the_command_writes_the_thesis_module_first(tmp_path):
    words = ["--support", "--mode", "3", "--case", "let go, +20 N, no spring", "--rigs", "1"]
    run = CliRunner().invoke(study.study, ["--folder", str(tmp_path), "--workers", "1", *words])
    assert run.exit_code == 0, run.output
    text = (tmp_path / "study.md").read_text(encoding="utf-8")
    assert text.index("Family T, the thesis's module") < text.index("Family A, rigid hand")
    assert "`study --support --rigs 1 --first-seed 1`" in text
    assert "| let go, +20 N, no spring | flies [mm] |" in text
