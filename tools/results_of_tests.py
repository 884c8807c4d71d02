# SPDX-License-Identifier: Apache-2.0
"""Results of tests of this build: kept by tools/run_tests.py, read by tools/evidence.py.

A run leaves two files in build/results: JUnit's XML, and a JSON that says of which build it is. It
counts for the build whose `tried` digest it has; of two runs of one test the later one counts.
"""

from __future__ import annotations

import json
import platform
import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import build_state

FOLDER = build_state.ROOT / "build/results"
PASSED, FAILED, SKIPPED = "passed", "failed", "skipped"


class Result(NamedTuple):
    """What came of a test.

    file: below the checkout; name: of the function, a class before it, with its parameters; came:
    passed, failed or skipped; seconds: it took; at, commit, machine: of its run.
    """

    file: str
    name: str
    came: str
    seconds: float
    at: str
    commit: str
    machine: str


@contextmanager
def kept(name: str, folder: Path = FOLDER) -> Iterator[list[str]]:
    """Yield pytest's options that keep the results of a run, unless the build changes meanwhile."""
    folder.mkdir(parents=True, exist_ok=True)
    told, results = folder / f"{name}.json", folder / f"{name}.xml"
    told.unlink(missing_ok=True)
    before, began = build_state.state(), datetime.now(timezone.utc)
    yield ["--junit-xml", str(results)]
    if build_state.state()["tried"] == before["tried"]:
        machine = f"{platform.platform()}, Python {platform.python_version()}"
        run = {**before, "at": began.isoformat(timespec="seconds"), "machine": machine}
        told.write_text(json.dumps(run), encoding="utf-8")
    else:
        print("Files changed while the tests ran: their results are no evidence.", flush=True)


def of_build(tried: str, folder: Path = FOLDER, root: Path = build_state.ROOT) -> list[Result]:
    """Return the results of the build with this digest, each test once."""
    runs = [(json.loads(file.read_text(encoding="utf-8")), file) for file in folder.glob("*.json")]
    found: dict[tuple[str, str], Result] = {}
    for run, file in sorted(runs, key=lambda each: each[0]["at"]):
        if run["tried"] == tried:
            for case in ElementTree.parse(file.with_suffix(".xml")).iter("testcase"):
                result = _result(case, run, root)
                found[result.file, result.name] = result
    return list(found.values())


def _result(case: ElementTree.Element, run: dict[str, str], root: Path) -> Result:
    file, classes = _placed(case.get("classname", ""), root)
    kinds = {child.tag for child in case}
    came = FAILED if kinds & {"failure", "error"} else SKIPPED if "skipped" in kinds else PASSED
    name = "::".join(filter(None, (classes, _plain(case.get("name", "")))))
    return Result(file, name, came, float(case.get("time", 0.0)), run["at"], run["commit"],
                  run["machine"])  # fmt: skip


def _placed(dotted: str, root: Path) -> tuple[str, str]:
    """Return the file and the classes in it of the dotted name that JUnit's XML has."""
    parts = dotted.split(".")
    for end in range(len(parts), 0, -1):
        file = "/".join(parts[:end]) + ".py"
        if (root / file).is_file():
            return file, "::".join(parts[end:])
    return dotted, ""


def _plain(name: str) -> str:
    """Return a name with the letters that pytest writes as escapes."""
    return re.sub(r"\\u([0-9a-f]{4})|\\x([0-9a-f]{2})",
                  lambda found: chr(int(found[1] or found[2], 16)), name)  # fmt: skip
