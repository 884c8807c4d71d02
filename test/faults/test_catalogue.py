# SPDX-License-Identifier: Apache-2.0
"""The fault catalogue: complete, documented; its measures. `make faults` carries it out."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import pytest
from catalogue import ROWS, page
from record import STEP_S, Moment, largest_step, torque_samples, vertical
from row import CLEAR, ENABLE, GOES_ON, HOME, OFF, PERIOD, PLANE_HOME, VERTICAL_OFF
from rows_bus import DEVICES, KINDS

from screw_module_ros.control.laws import variants
from screw_module_ros.graph import GRAPH, MODULE

NAMES = [row.name for row in ROWS]
BY_NAME = dict(zip(NAMES, ROWS, strict=True))
PAGE = Path(__file__).parents[2] / "docs/faults.md"


def test_names_are_unique_and_speak_for_themselves():
    assert len(BY_NAME) == len(NAMES)
    assert all(name == name.strip() and " " not in name for name in NAMES)


def test_every_node_is_killed_and_frozen():
    for entry, act in itertools.product([*GRAPH, MODULE], ("killed", "frozen")):
        if entry.simulation and act == "frozen":
            continue  # time stands still, and nothing happens in it
        assert f"{entry.executable}-{act}" in BY_NAME


def test_every_law_has_rows():
    assert {row.mode for row in ROWS} == set(variants())


@pytest.mark.parametrize("kind", KINDS)
def test_every_bus_fault_is_done_to_some_device(kind):
    assert any(kind in device.kinds for device in DEVICES)


@pytest.mark.parametrize("device", [device.name for device in DEVICES])
def test_every_cable_comes_out(device):
    assert f"{device}-cable_out" in BY_NAME


def test_what_is_done_to_a_part_of_the_module_is_done_to_a_process_of_its_own():
    parts = {f"{part}-{act}" for part in MODULE.parts for act in ("killed", "frozen", "stopped")}
    assert all(row.shared is None for row in ROWS if row.name in parts)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_a_row_is_complete(row):
    """A stop has time limits, a way back and a report, unless the operator asked for it."""
    assert row.fault and row.noticed_by
    stops = row.outcome != GOES_ON
    assert (row.within > 0) == stops
    assert (row.plane_within > 0) == (stops and row.outcome != VERTICAL_OFF)
    assert not stops or ENABLE[0] in row.services
    if row.outcome == OFF and row.name not in ("disable", "bring-up-in-reverse", "home-elsewhere"):
        assert row.report is not None and (row.report.node or row.report.reason)


def test_random_payloads_have_alarms_of_their_own():
    """Those of a wrong value, not any sentence about the device."""
    reports = {name: row.report for name, row in BY_NAME.items() if name.endswith("-garbage")}
    assert len(reports) == 4
    for name, report in reports.items():
        assert report != BY_NAME[name.replace("-garbage", "-cable_out")].report
        assert not re.search(report.said, f"the {name.removesuffix('-garbage')} is silent")


def test_a_homing_of_one_axis_permits_none_of_the_other():
    services = BY_NAME["shoulder-reset"].services
    assert PLANE_HOME in services and HOME not in services and CLEAR not in services


def test_the_page_is_that_of_the_rows(request):
    if request.config.getoption("--write"):
        PAGE.write_text(page(), encoding="utf-8")
    assert PAGE.read_text(encoding="utf-8") == page()
    assert max(map(len, page().splitlines())) < 300


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
