# SPDX-License-Identifier: Apache-2.0
"""Where a package is missing, each entrance says so in one sentence: every program, and the launch
file.

A package is taken away from a process of its own, in which all of them are tried. Those processes
are forks of one that has imported the large packages, which import none of those taken away then.
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
_LARGE = ("numpy", "yaml", "scipy.optimize", "scipy.signal", "matplotlib.figure", "numba")
_TRY_ALL = """
import importlib, os, pathlib, runpy, sys, traceback
launch_file, folder, large, *packages = sys.argv[1:]

def tried(absent):
    sys.modules[absent] = None
    from screw_module_ros import programs
    for name in [*programs.PROGRAMS, launch_file]:
        try:
            runpy.run_path(name) if name == launch_file else getattr(programs, name)
        except SystemExit as ended:
            print(name.rpartition("/")[2], ended.code)

def try_without(absent):
    assert absent not in sys.modules
    pid = os.fork()
    if not pid:
        for number, stream in enumerate(("out", "err"), 1):
            os.dup2(os.open(f"{folder}/{absent}.{stream}", os.O_CREAT | os.O_WRONLY), number)
        code = 1
        try:
            tried(absent)
            code = 0
        except BaseException:
            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    pathlib.Path(folder, f"{absent}.code").write_text(str(code))

large = large.split()
first = [package for package in packages if package in {name.split(".")[0] for name in large}]
for package in first:
    try_without(package)
for name in large:
    importlib.import_module(name)
for package in packages:
    if package not in first:
        try_without(package)
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


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """Return the folder of what was said without each package, and of the exit codes."""
    folder = tmp_path_factory.mktemp("answers")
    words = [sys.executable, "-c", _TRY_ALL, LAUNCH_FILE, folder, " ".join(_LARGE), *packages()]
    subprocess.run(words, check=True)
    return folder


@pytest.mark.parametrize("absent", packages())
def test_each_entrance_names_a_missing_package_in_one_sentence(absent, answers):
    said, errors, code = (
        (answers / f"{absent}.{kind}").read_text("utf-8") for kind in ("out", "err", "code")
    )
    assert code == "0", errors
    ended = dict(line.split() for line in said.splitlines())
    assert ended.keys() <= {*PROGRAMS, LAUNCH_FILE.name}
    assert set(ended.values()) == {"2"}, "nothing needs the package, or it ends otherwise"
    told = errors.splitlines()
    assert [line.partition(":")[0] for line in told] == list(ended)
    launches = {"launch", "launch_ros"}  # no wheels of them: missing here in any case
    for line in told:
        named = line.partition(": ")[2].partition(" is not installed: ")[0]
        assert named == absent or (line.startswith(LAUNCH_FILE.name) and named in launches)
