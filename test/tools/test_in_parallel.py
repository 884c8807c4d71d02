# SPDX-License-Identifier: Apache-2.0
"""Commands beside each other: whole outputs, one failure ends all, nothing goes on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MEET = "touch {0}; until [ -e {1} ]; do sleep 0.01; done; echo {0} has met {1}"
PROGRAM = """
import os, pathlib, signal, sys
pathlib.Path(sys.argv[1]).write_text(str(os.getpid()))
signal.pause()
"""
WAITS = f"{sys.executable} program.py"


@pytest.fixture
def started(tmp_path):
    """Return `started(*commands)`: a run of them."""
    (tmp_path / "program.py").write_text(PROGRAM)

    def start(*commands: str) -> subprocess.Popen:
        return subprocess.Popen(
            [sys.executable, ROOT / "tools/in_parallel.py", *commands],
            cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip

    return start


def ended(file: Path) -> bool:
    """Whether the process that wrote a file has ended; nobody may have taken note of it yet."""
    try:
        stat = Path(f"/proc/{file.read_text()}/stat").read_text()
    except FileNotFoundError:
        return True
    return stat.rpartition(")")[2].split()[0] == "Z"


def test_they_run_beside_each_other_and_each_output_is_whole(started):
    run = started(MEET.format("a", "b") + "; echo more", MEET.format("b", "a"))
    lines = run.communicate(timeout=60)[0].splitlines()
    assert run.returncode == 0
    assert lines[lines.index("a has met b") + 1] == "more"
    assert "b has met a" in lines
    assert sum("passed after" in line for line in lines) == 2


def test_one_that_fails_ends_the_others_and_is_named_last(started, tmp_path):
    fails = "until [ -s one ]; do sleep 0.01; done; echo reason; exit 3"
    run = started(f"{WAITS} one", fails)
    lines = run.communicate(timeout=60)[0].splitlines()
    assert run.returncode == 3
    assert lines[-2] == "reason"
    assert lines[-1].startswith(f"== {fails}: FAILED with exit code 3")
    assert not any("passed" in line for line in lines)
    assert ended(tmp_path / "one")


def test_one_that_a_signal_ends_has_failed(started):
    run = started("kill -9 $$")
    assert "FAILED with exit code -9" in run.communicate(timeout=60)[0]
    assert run.returncode == 128 + 9


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_all_also_what_they_have_started(started, tmp_path, wait_until, how):
    run = started(f"setsid {WAITS} orphan & {WAITS} one", f"{WAITS} other")
    files = [tmp_path / name for name in ("orphan", "one", "other")]
    wait_until(lambda: all(file.exists() and file.read_text() for file in files))
    os.kill(run.pid, how)
    run.communicate(timeout=60)
    assert run.returncode == 128 + signal.SIGINT
    assert all(map(ended, files))
