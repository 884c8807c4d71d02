# SPDX-License-Identifier: Apache-2.0
"""The fault catalogue: complete, documented, and in part carried out."""

from __future__ import annotations

import itertools
import json
import subprocess
from pathlib import Path

import pytest

from screw_module_ros.control.modes import COMBINED, FORCE_FEEDBACK, IMPEDANCE, MODE_NAMES
from screw_module_ros.graph import COMPOSED, GRAPH
from screw_module_ros.nodes.bringup import executable_path
from screw_module_ros.trials.faults.catalogue import PAGE, all_rows, chosen, page
from screw_module_ros.trials.faults.limits import PERIOD
from screw_module_ros.trials.faults.listener import Moment
from screw_module_ros.trials.faults.measures import STEP_S, largest_step, torque_samples, vertical
from screw_module_ros.trials.faults.row import EITHER, GOES_ON, OFF, VERTICAL_OFF
from screw_module_ros.trials.faults.rows_bus import DEVICES, KINDS

pytestmark = [pytest.mark.graph, pytest.mark.long]

ROWS = all_rows()
NAMES = [row.name for row in ROWS]
REPOSITORY = Path(__file__).parents[2]
# Enough to see that processes are started, harmed, judged and brought back; `.ci/run` runs all.
CARRIED_OUT = ("drive-cable_out", "estop-pressed-often")


def test_names_are_unique_and_speak_for_themselves():
    assert len(set(NAMES)) == len(NAMES)
    assert all(name == name.strip() and " " not in name for name in NAMES)


def test_every_node_is_killed_and_frozen():
    for entry, act in itertools.product([*GRAPH, COMPOSED], ("killed", "frozen")):
        if entry.simulation and act == "frozen":
            continue  # time stands still, and nothing happens in it
        assert f"{entry.executable}-{act}" in NAMES


def test_the_modes_with_laws_of_their_own_have_rows():
    assert {row.mode for row in ROWS} >= {IMPEDANCE, FORCE_FEEDBACK, COMBINED}


@pytest.mark.parametrize("kind", KINDS)
def test_every_bus_fault_is_done_to_some_device(kind):
    assert any(kind in device.kinds for device in DEVICES)


@pytest.mark.parametrize("device", [device.name for device in DEVICES])
def test_every_cable_comes_out(device):
    assert f"{device}-cable_out" in NAMES


def test_what_is_done_to_a_part_of_the_module_is_done_to_a_process_of_its_own():
    parts = {f"{part}-{act}" for part in COMPOSED.parts for act in ("killed", "frozen", "stopped")}
    assert all(row.apart for row in ROWS if row.name in parts)


@pytest.mark.parametrize("row", ROWS, ids=NAMES)
def test_a_row_is_complete(row):
    """Each row names detection, outcome and recovery; a stop has a time limit and an alarm."""
    assert row.fault and row.noticed_by and row.recovery
    assert row.mode in MODE_NAMES
    assert row.safe in (OFF, VERTICAL_OFF, EITHER, GOES_ON)
    assert (row.within == 0) == (row.safe == GOES_ON)
    if row.safe == OFF and row.name not in ("disable", "bring-up-in-reverse", "home-elsewhere"):
        assert row.alarm is not None and (row.alarm.node or row.alarm.reason)


def test_the_page_is_up_to_date():
    """Made by `faults --table`."""
    assert (REPOSITORY / PAGE).read_text() == page()


def test_a_selection_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="no group 'nowhere'; there are nodes"):
        chosen(groups=["nowhere"])
    with pytest.raises(ValueError, match="no row with 'nothing-like-it'"):
        chosen(names=["nothing-like-it"])
    with pytest.raises(ValueError, match="no row of these groups"):
        chosen(groups=["parameters"], names=["estop"])


def moments(torques, forces=()):
    """Return moments half a sample apart."""
    forces = forces or [0.0] * len(torques)
    still = {"joints": (0.0, 0.0), "height": 0.0, "speed": 0.0, "plane": (0.0, 0.0)}
    return [
        Moment((k + 1) * PERIOD / 2, torque, force=(0.0, 0.0, force), joint_speed=0.0, **still)
        for k, (torque, force) in enumerate(zip(torques, forces, strict=True))
    ]


def test_torque_that_comes_back_counts_until_its_end():
    assert torque_samples(moments([0.1, 0.0, 0.0, 0.1, 0.0]), 0.0, vertical) == pytest.approx(2.0)
    assert torque_samples(moments([0.0, 0.0]), 0.0, vertical) == 0.0


def test_a_step_is_seen_and_a_slope_is_not():
    """The change within STEP_S counts, not how far the force goes in the end."""
    slope = [0.05 * k for k in range(200)]
    apart = int(STEP_S * 1.01 / (PERIOD / 2))
    assert 1 <= apart < 100
    assert largest_step(moments([0.0] * 200, slope)) == pytest.approx(0.05 * apart)
    step = [0.0] * 20 + [7.0] * 20
    assert largest_step(moments([0.0] * 40, step)) == pytest.approx(7.0)
    knock = [0.0] * 20 + [9.0] + [0.0] * 20
    assert largest_step(moments([0.0] * 41, knock)) == 0.0


@pytest.mark.timeout(600)
def test_some_rows_carried_out(tmp_path):
    """The command itself: rows pass, and their figures are written."""
    verdicts = tmp_path / "verdicts.json"
    words = [word for name in CARRIED_OUT for word in ("--row", name)]
    done = subprocess.run(
        [executable_path("faults"), "--json", str(verdicts), *words],
        capture_output=True, text=True, timeout=580, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    found = {one["name"]: one for one in json.loads(verdicts.read_text())}
    assert set(found) == set(CARRIED_OUT)
    assert all(one["passed"] and one["reason"] for one in found.values())
