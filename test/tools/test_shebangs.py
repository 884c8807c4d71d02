# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import shebangs

CODE = "import sys\nprint(sys.executable, sys.argv[1:])\n"


@pytest.fixture(params=["a b", "x ü", "n" * 140])
def python(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Return a Python whose path is no fit first line."""
    folder = tmp_path / request.param
    folder.mkdir()
    (folder / "python").symlink_to(sys.executable)
    return folder / "python"


@pytest.mark.parametrize("first", ["#!{}", '#!"{}"', '#!"{}" -x'])
def test_an_executable_starts_in_any_folder(python: Path, first: str) -> None:
    node = python.parent / "node"
    node.write_text(f"{first.format(python)}\n{CODE}")
    node.chmod(0o755)
    assert shebangs.repair(python.parent, python) == 1
    run = subprocess.run([node, "a b", "*"], capture_output=True, text=True, check=True)
    assert run.stdout == f"{python} ['a b', '*']\n"


def test_a_second_time_and_a_plain_path_change_nothing(python: Path, tmp_path: Path) -> None:
    (tmp_path / "bin").mkdir()
    node = tmp_path / "bin/node"
    node.write_text(f"#!{python}\n{CODE}")
    assert shebangs.repair(tmp_path / "bin", python) == 1
    assert shebangs.repair(tmp_path / "bin", python) == 0
    node.write_text(f"#!/usr/bin/python3\n{CODE}")
    assert shebangs.repair(tmp_path / "bin", Path("/usr/bin/python3")) == 0
