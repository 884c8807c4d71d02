# SPDX-License-Identifier: Apache-2.0
"""docs/hazards.md names files, tests, rows and groups of the fault catalogue that exist."""

from __future__ import annotations

import re
from fnmatch import fnmatchcase
from pathlib import Path

import pytest
from catalogue import ROWS as CATALOGUE
from row import EITHER, GOES_ON, OFF, VERTICAL_OFF

import hazards
from screw_module_ros.control.limits import CommandLimits, TorqueLimits
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.force_sensor_settings import ForceSensorSettings
from screw_module_ros.loop.plane_controller import JointSettings, PlaneLimits
from screw_module_ros.nodes.amplifier import AmplifierSettings
from screw_module_ros.safety.checks import AgreementSettings, FreezeSettings, WatchSettings
from screw_module_ros.safety.permit import CONDITIONS, PermitSettings
from screw_module_ros.safety.supervision import SupervisionSettings

ROOT = Path(__file__).parents[1]
TEXT = hazards.PAGE.read_text(encoding="utf-8")
HAZARDS = hazards.hazards(TEXT)
FLAT = " ".join(TEXT.split())  # a name may stand on two lines
NAMED = sorted(set(re.findall(r"`(test/[^`]+)`", FLAT)))
FILES = sorted(set(re.findall(r"`([a-z_/0-9]+\.py)`", FLAT)) - set(NAMED))
STOPS = [
    [cell.strip() for cell in line.split("|")[1:-1]]
    for line in TEXT.partition("## What stops the torque")[2].partition("## Force")[0].splitlines()
    if line.startswith("| ") and not line.startswith("| condition")
]
LIMITS = {
    "": (
        CommandLimits, DriveSettings, PlanarSettings, PlaneLimits, SupervisionSettings,
        VerticalSettings, AmplifierSettings, ForceSensorSettings,
    ),
    "agreement.": (AgreementSettings,), "freeze.": (FreezeSettings,), "gate.": (PermitSettings,),
    "joints.": (JointSettings,), "torque.": (TorqueLimits,), "watch.": (WatchSettings,),
}  # fmt: skip
PARAMETERS = {
    prefix + name for prefix, kinds in LIMITS.items() for kind in kinds for name in kind._fields
}
COMMANDS = sorted({command for hazard in HAZARDS for command in hazard.commands})
ROWS = sorted({row for hazard in HAZARDS for row in hazard.rows})
GROUPS = sorted({group for hazard in HAZARDS for group in hazard.groups})
OUTCOMES = {
    "": OFF, "continues": GOES_ON, "continues or stops": EITHER, "plane continues": VERTICAL_OFF
}  # fmt: skip
CITED = sorted({
    (row, outcome)
    for hazard in HAZARDS
    for row, outcome in re.findall(r"`([^`]+)`(?: \(([a-z ]+)\))?", hazard.shown_by)
    if row in ROWS
})


@pytest.mark.parametrize("named", NAMED)
def test_every_test_named_is_there(named):
    if named == "test/...":
        return
    file, _, name = named.partition("::")
    text = (ROOT / file).read_text(encoding="utf-8")
    title = rf"[\w|]+( \w+=\S+)*: {name}$"  # of a conversation
    assert not name or re.search(rf"^(def {name}\(|{name} = |{title})", text, re.MULTILINE)


@pytest.mark.parametrize("file", FILES)
def test_every_file_named_is_there(file):
    above = ROOT if file.startswith("tools/") else ROOT / "screw_module_ros"
    assert (above / file).is_file()


@pytest.mark.parametrize(("pattern", "outcome"), CITED)
def test_every_row_cited_is_there_and_has_the_outcome_that_the_hazard_claims(pattern, outcome):
    found = {row.outcome for row in CATALOGUE if fnmatchcase(row.name, pattern)}
    assert found == {OUTCOMES[outcome]}


@pytest.mark.parametrize("group", GROUPS)
def test_every_group_named_is_there(group):
    assert group in {row.group for row in CATALOGUE}


@pytest.mark.parametrize("row", CATALOGUE, ids=lambda row: row.name)
def test_every_row_belongs_to_a_hazard(row):
    assert row.group in GROUPS or any(fnmatchcase(row.name, pattern) for pattern in ROWS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_named_is_there(command):
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.search(rf"^{command.removeprefix('make ')}:", makefile, re.MULTILINE)


@pytest.mark.parametrize("stop", STOPS, ids=lambda stop: stop[0])
def test_every_limit_of_what_stops_the_torque_is_a_parameter(stop):
    assert set(re.findall(r"`([^`]+)`", stop[2])) <= PARAMETERS


@pytest.mark.parametrize("condition", CONDITIONS, ids=lambda condition: condition.wrong.__name__)
def test_every_condition_of_the_permit_stands_there_with_what_clears_it(condition):
    latches = "yes" if condition.latches else "no"
    found = [
        stop for stop in STOPS
        if "safety/permit.py" in stop[1] and stop[3] == latches and condition.limit in stop[2]
    ]  # fmt: skip
    assert any(stop[4].strip("`") in condition.clears for stop in found)


def test_rows_and_groups_are_found_in_the_text():
    assert len(ROWS) > 30
    assert {"bus", "commands", "parameters"} <= set(GROUPS)


def test_every_hazard_has_a_mitigation_and_a_proof():
    assert len(HAZARDS) > 20
    for hazard in HAZARDS:
        assert all(hazard), hazard.name
        assert hazard.tests or hazard.rows or hazard.groups, hazard.name


def test_every_heading_below_a_section_of_hazards_is_one():
    assert len(HAZARDS) == len(re.findall("^### ", TEXT, re.M)) == TEXT.count("- *Shown by*: ")


def test_no_line_is_longer_than_a_reader_bears():
    assert [line for line in TEXT.splitlines() if len(line) >= 300] == []
