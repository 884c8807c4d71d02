# SPDX-License-Identifier: Apache-2.0
"""The operator's script on the simulated robot."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from screw_module_ros.nodes.bringup import executable_path

EXAMPLE = Path(__file__).parents[2] / "examples" / "operate.py"
pytestmark = [pytest.mark.graph, pytest.mark.long]


@pytest.fixture
def sessions(tmp_path):
    """Folder of the recordings of a simulated robot that runs meanwhile."""
    words = ["--one-process", "-p", f"session_recorder:folder:={tmp_path}"]
    robot = subprocess.Popen([executable_path("bringup"), *words])
    yield tmp_path
    robot.send_signal(signal.SIGTERM)
    assert robot.wait(60) == 0


def test_it_moves_the_hand_records_it_and_leaves_no_torque(sessions):
    done = subprocess.run(
        [sys.executable, EXAMPLE], capture_output=True, text=True, check=True, timeout=600
    )
    there, back, recorded = done.stdout.splitlines()
    places = [float(line.split("hand")[1].split()[0]) for line in (there, back)]
    assert places[0] > 0.005 > abs(places[1])
    assert "0 ticks lost" in recorded
    assert len(list(sessions.iterdir())) == 1
