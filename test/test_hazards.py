# SPDX-License-Identifier: Apache-2.0
"""docs/hazards.md names files and tests that exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs" / "hazards.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`(test/[^`]+)`", TEXT)))
FILES = sorted(set(re.findall(r"`([a-z_/0-9]+\.py)`", TEXT)) - set(NAMED))


@pytest.mark.parametrize("named", NAMED)
def test_every_test_named_is_there(named):
    if named == "test/...":
        return
    file, _, name = named.partition("::")
    text = (ROOT / file).read_text(encoding="utf-8")
    assert not name or re.search(rf"^(def {name}\(|{name} = )", text, re.MULTILINE)


@pytest.mark.parametrize("file", FILES)
def test_every_file_named_is_there(file):
    assert (ROOT / "screw_module_ros" / file).is_file()


def test_every_hazard_has_a_mitigation_and_a_proof():
    rows = [line.split("|")[1:-1] for line in TEXT.splitlines() if line.startswith("| ")]
    rows = [row for row in rows if row[0].strip() != "hazard"]
    assert len(rows) > 20
    assert all(len(row) == 4 and all(cell.strip() for cell in row) for row in rows)
