# SPDX-License-Identifier: Apache-2.0
"""docs/troubleshooting.md: each diagnostic sentence has a remedy, and none is stale."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from sentences import PACKAGE, sentences

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
SENTENCES = TEXT.partition("## Sentences of the nodes")[2]

COVERED = (
    "safety/checks.py", "safety/permit.py", "safety/supervision.py", "loop/controller.py",
    "loop/drive.py", "loop/plane.py", "loop/plane_controller.py", "loop/requests.py",
    "devices/*.py", "can_io/bus.py",
    "can_io/load.py", "can_io/port.py", "therapy/hand.py", "recording/recorder.py",
    "nodes/amplifier.py", "nodes/encoder.py", "nodes/force_sensor.py", "nodes/endpoint_state.py",
    "nodes/impedance_controller.py", "nodes/supervisor.py", "nodes/session_recorder.py",
    "nodes/therapy_session.py", "nodes/therapy_recording.py", "nodes/support/drives.py",
    "nodes/support/driver.py", "nodes/support/topics.py",
)  # fmt: skip
"""What judges and drives the robot, and its nodes: every sentence there stands on the page."""

NOT_SAID = (
    # Parts of other sentences, names of things and values, bits of an alarm, words of the hazards.
    r"^; no |^, or |^\{\}; \{\}: \{\}$|^  \{\}  \{\}$|^\{\} in ROS domain \{\}$",
    r"^for (the laws|mode EXCITATION)$|^the torque command was|^see the python-can manual",
    r"Net F/T on CAN$|^(ATI NETCANOEM|CiA \{\}), |^(heartbeat of master|frames 0x|force sensor 0x)",
    r"^(drive|encoder) node \{\}$|^reserved bit|^vendor data|\[[\w% ]+\]$|^\{\}( N)? and \{\} Nm$",
    r"6501, it does not scale|its scaling is on$|a classical CAN frame carries|a switch of its own",
    r"^base id 0x\{\}$|^profile \{\}: force_sensor.settings$",
    r"^(light control|operating time|battery charge|reference point)",
    r"^(counter in|heartbeat that it|identifier of|inhibit time of|life time|window for)",
    r"^(Torque without a request|Emergency stop without|Controller silent, torque held)",
    # What was done, asked for or is in order.
    r"^(tared|back to|homed at|reset;|stopped;|the fault is cleared|record(ed|ing) to|running in)",
    r"^this module's \{\}: ",
    r"^(mode|session|looking for topics:|calibration) \{\}[,:]|all inputs fresh|is closed$",
    r"^the (therapist|node) (paused|ended|was stopped)",
)


def _patterns() -> list[str]:
    """Return the left column's texts, as regular expressions; … stands for anything."""
    cells = re.findall(r"^\| (`.*?`) \| ", SENTENCES, re.MULTILINE)
    groups = [group.strip("`") for cell in cells for group in cell.split("`, `")]
    return [".*".join(map(re.escape, group.split("` … `"))) for group in groups]


PATTERNS = _patterns()
SAID = sorted(
    {text for pattern in COVERED for path in PACKAGE.glob(pattern) for text in sentences(path)}
)


@pytest.fixture(scope="module")
def everywhere() -> list[str]:
    """Return the texts of the whole package."""
    return [text for path in PACKAGE.rglob("*.py") for text in sentences(path)]


@pytest.mark.parametrize("sentence", SAID)
def test_every_diagnostic_sentence_has_a_remedy(sentence):
    known = [*PATTERNS, *NOT_SAID]
    assert any(re.search(pattern, sentence) for pattern in known), sentence


@pytest.mark.parametrize("pattern", PATTERNS)
def test_every_remedy_is_of_a_sentence_that_a_node_can_say(pattern, everywhere):
    assert any(re.search(pattern, sentence) for sentence in everywhere)


@pytest.mark.parametrize("pattern", NOT_SAID)
def test_every_exception_is_needed(pattern):
    assert any(re.search(pattern, sentence) for sentence in SAID)
