# SPDX-License-Identifier: Apache-2.0
"""A pytest plugin for `mutants.py`: which functions of a folder each test calls, and for how long.

Environment: CALLED_IN names the folder, CALLED_OUT the JSON file. A fixture of several tests
counts for the first one.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

_FOLDER = os.environ["CALLED_IN"]
_found: dict[str, dict[str, Any]] = {}


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Note the functions that are called while one test runs, with its fixtures."""
    called: set[tuple[str, int]] = set()

    def note(frame: Any, event: str, _argument: Any) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(_FOLDER):
            called.add((code.co_filename, code.co_firstlineno))

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        return (yield)
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
        _found[item.nodeid] = {"called": sorted(called), "seconds": 0.0}


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Add up the time of a test."""
    _found.setdefault(report.nodeid, {"called": [], "seconds": 0.0})
    _times[report.nodeid] = _times.get(report.nodeid, 0.0) + report.duration


_times: dict[str, float] = {}


def pytest_sessionfinish() -> None:
    """Write what was found."""
    for test, seconds in _times.items():
        _found[test]["seconds"] = seconds
    Path(os.environ["CALLED_OUT"]).write_text(json.dumps(_found), encoding="utf-8")
