# SPDX-License-Identifier: Apache-2.0
"""Every row of the fault catalogue, carried out: `make faults`."""

from __future__ import annotations

import pytest
from catalogue import ROWS
from judge import judge

pytestmark = [pytest.mark.graph, pytest.mark.fault]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_row(robots, row, record_property):
    with robots.for_row(row) as robot:
        judge(robot, row, record_property)
