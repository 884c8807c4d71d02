# SPDX-License-Identifier: Apache-2.0
"""Every row of the fault catalogue, carried out: `make faults`."""

from __future__ import annotations

import pytest
from catalogue import carried_out
from judge import judge

pytestmark = [pytest.mark.graph, pytest.mark.fault]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    rows = carried_out(metafunc.config.getoption("--arrangement"))
    metafunc.parametrize("row", rows, ids=[row.name for row in rows])


def test_row(robots, row, record_property):
    with robots.for_row(row) as robot:
        judge(robot, row, record_property)
