# SPDX-License-Identifier: Apache-2.0
"""A pytest plugin for `mutants.py`: which functions of a folder each test calls, and for how long.

Environment: CALLED_IN names the folder, CALLED_OUT the JSON file. A fixture of several tests
counts for the first one. What compiled code calls is not seen.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import CodeType
from typing import Any

import pytest

_FOLDER = os.environ["CALLED_IN"]
_found: dict[str, dict[str, Any]] = {}


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Note the functions that are called while one test runs, with its fixtures."""
    called: set[CodeType] = set()

    def note(frame: Any, _event: str, _argument: Any) -> None:
        called.add(frame.f_code)  # and no tracing within the function

    threading.settrace(note)
    sys.settrace(note)
    try:
        return (yield)
    finally:
        sys.settrace(None)
        threading.settrace(None)
        places = {(code.co_filename, code.co_firstlineno) for code in called}
        _of(item.nodeid)["called"] = sorted(each for each in places if each[0].startswith(_FOLDER))


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Add up the time of a test."""
    _of(report.nodeid)["seconds"] += report.duration


def _of(test: str) -> dict[str, Any]:
    return _found.setdefault(test, {"called": [], "seconds": 0.0})


def pytest_sessionfinish() -> None:
    """Write what was found."""
    Path(os.environ["CALLED_OUT"]).write_text(json.dumps(_found), encoding="utf-8")
