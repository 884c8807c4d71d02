# SPDX-License-Identifier: Apache-2.0
"""Where a package is missing, each entrance says so in one sentence: every program, and the launch
file.

A package is taken away from a Python of its own, in which all of them are tried.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from screw_module_ros.programs import PROGRAMS

pytestmark = pytest.mark.long
ROOT = Path(__file__).parents[1]
LAUNCH_FILE = ROOT / "launch/therapy_robot.launch.py"
_TRY_ALL = """
import runpy, sys
absent, launch_file = sys.argv[1:]
sys.modules[absent] = None
from screw_module_ros import programs
for name in [*programs.PROGRAMS, launch_file]:
    try:
        runpy.run_path(name) if name == launch_file else getattr(programs, name)
    except SystemExit as ended:
        print(name.rpartition("/")[2], ended.code)
"""


def packages() -> list[str]:
    """Return the packages that the code imports: neither Python's own nor this one."""
    found = set()
    for file in [*(ROOT / "screw_module_ros").rglob("*.py"), LAUNCH_FILE]:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {name.name.partition(".")[0] for name in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                found.add(node.module.partition(".")[0])
    return sorted(found - sys.stdlib_module_names - {"screw_module_ros"})


@pytest.mark.parametrize("absent", packages())
def test_each_entrance_names_a_missing_package_in_one_sentence(absent):
    words = [sys.executable, "-c", _TRY_ALL, absent, str(LAUNCH_FILE)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    ended = dict(line.split() for line in done.stdout.splitlines())
    assert ended.keys() <= {*PROGRAMS, LAUNCH_FILE.name}
    assert set(ended.values()) == {"2"}, "nothing needs the package, or it ends otherwise"
    told = done.stderr.splitlines()
    assert [line.partition(":")[0] for line in told] == list(ended)
    launches = {"launch", "launch_ros"}  # no wheels of them: missing here in any case
    for line in told:
        named = line.partition(": ")[2].partition(" is not installed: ")[0]
        assert named == absent or (line.startswith(LAUNCH_FILE.name) and named in launches)
