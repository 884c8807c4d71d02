# SPDX-License-Identifier: Apache-2.0
"""The page of shared memory where there is no room for it."""

from __future__ import annotations

import shutil
import subprocess
import sys

import pytest

OPENS = """
from screw_module_ros.lockstep.page import Page
page = Page("full")
page.set_name(0, "x" * 96)
"""


def in_small_memory(size: int, script: str) -> subprocess.CompletedProcess:
    """Run Python with a /dev/shm of `size` bytes of its own; skip where that is not permitted."""
    if shutil.which("unshare") is None:
        pytest.skip("needs the command unshare")
    mounted = f"mount -t tmpfs -o size={size} tmpfs /dev/shm || exit 77; exec \"$@\""
    found = subprocess.run(
        ["unshare", "-rm", "sh", "-c", mounted, "sh", sys.executable, "-c", script],
        check=False, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    if found.returncode == 77 or "unshare" in found.stderr:
        pytest.skip(f"no mount namespaces here: {found.stderr.strip()}")
    return found


def test_a_full_shared_memory_is_told_in_a_sentence_and_leaves_nothing():
    """A file that was only made longer ended the process without a word (SIGBUS)."""
    left = "\nexcept OSError as error:\n    print(error, os.listdir('/dev/shm'))"
    tried = OPENS.strip().replace("\n", "\n    ")
    ended = in_small_memory(8192, f"import os\ntry:\n    {tried}{left}")
    assert ended.returncode == 0, ended.stderr
    assert "no shared memory for simulated time" in ended.stdout
    assert "No space left on device" in ended.stdout and "--wall-clock" in ended.stdout
    assert ended.stdout.endswith(" []\n")


def test_a_shared_memory_with_room_is_used():
    ended = in_small_memory(1 << 20, OPENS)
    assert ended.returncode == 0, ended.stderr
