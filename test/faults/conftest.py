# SPDX-License-Identifier: Apache-2.0
"""The robot of each worker, kept running from row to row."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from fault_robot import FaultRobot
from row import Row

from screw_module_ros.graph import MODULE, WHOLE, Entry

_ORDER = (None, MODULE, WHOLE)
LAWS = Path(__file__).parents[1] / "loop"
"""Folder of `laws_of_others`, which the robot's controller imports."""


class Robots:
    """The robot of this worker; replaced where a row asks for another kind, or it is stuck."""

    def __init__(self, folder: Path):
        self._folder = folder
        self._robot: FaultRobot | None = None

    @contextmanager
    def for_row(self, row: Row) -> Iterator[FaultRobot]:
        """Yield the running robot, in operation; where the row fails, recover or end it."""
        if self._robot is not None and self._robot.shared != row.shared:
            self.end()
        self._robot = robot = self._robot or FaultRobot(row.shared, self._folder)
        try:
            robot.begin(row)
            yield robot
        except Exception:
            if not robot.recovers(row):
                self.end()
            raise

    def end(self) -> None:
        """Stop the robot, if one runs."""
        robot, self._robot = self._robot, None
        if robot is not None:
            robot.end()


@pytest.fixture(scope="session")
def robots(ros_domain_id, tmp_path_factory) -> Iterator[Robots]:
    made = Robots(tmp_path_factory.mktemp("faults"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(LAWS), prepend=os.pathsep)
        yield made
        made.end()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let rows in the same arrangement follow each other, those in one process last.

    Each worker begins with a block of them, and takes what another has left from its end.
    """
    items.sort(key=lambda item: _ORDER.index(_shared_in(getattr(item, "callspec", None))))


def _shared_in(callspec) -> Entry | None:
    row = callspec.params.get("row") if callspec else None
    return row.shared if isinstance(row, Row) else None
