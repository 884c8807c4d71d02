# SPDX-License-Identifier: Apache-2.0
"""The example of a law of one's own: the patient feels its floor, and only there."""

import os
import re
import subprocess
import sys
from pathlib import Path
from statistics import fmean

import pytest

from screw_module_ros.trials.runner import GraphRun

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_law"


@pytest.fixture
def example(importing):
    """The example's modules, as its README runs them."""
    return importing("own_law", "mylab"), importing("own_law", "try_it")


def test_the_hand_feels_the_floor(example):
    mylab, try_it = example
    rows = try_it.felt(6.0)
    assert not any(row.reason for row in rows)
    settled = rows[2000:]
    height, stiffness, _ = mylab.FloorSettings()
    below = [(height - row.position, -row.patient) for row in settled]
    below = [(depth, force) for depth, force in below if depth > 0.01]
    above = [abs(row.patient) for row in settled if 0.19 < row.position < 0.27]
    assert len(below) > 500 and len(above) > 500
    assert fmean(force for _, force in below) == pytest.approx(
        fmean(stiffness * depth for depth, _ in below), abs=2.0
    )
    assert max(above) < 7.0, "what is left of the screw's friction"


@pytest.mark.graph
@pytest.mark.long
def test_in_the_graph_the_nut_follows_the_floor_and_the_recording_names_the_law(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("PYTHONPATH", str(EXAMPLE), prepend=os.pathsep)
    words = ["-p", """impedance_controller:laws:=["mylab:FLOOR"]""",
             "-p", "impedance_controller:damping:=5.0",
             "-p", f"session_recorder:folder:={tmp_path}"]  # fmt: skip
    chain = ["sim_rig", "supervisor", "encoder", "force_sensor", "impedance_controller",
             "amplifier", "manus", "session_recorder"]  # fmt: skip
    with GraphRun(only=chain, extra=words):
        done = subprocess.run(
            [sys.executable, EXAMPLE / "in_the_graph.py"],
            check=False, capture_output=True, text=True, timeout=600,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    low, high, recorded = done.stdout.splitlines()
    places = [float(re.findall(r"nut at (\S+) m", line)[0]) for line in (low, high)]
    assert "floor {'depth': 0." in high
    assert places[0] < 0.15 and places[0] + 0.01 < places[1] < 0.20
    assert f"recorded in {tmp_path}" in recorded and ": floor " in recorded
