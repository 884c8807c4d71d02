# SPDX-License-Identifier: Apache-2.0
"""The software that runs is named by version and source."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

import screw_module_ros
from screw_module_ros import software


@pytest.fixture
def copy(tmp_path, monkeypatch):
    """A copy of the package's own files, which `software` reads."""
    root = tmp_path / "screw_module_ros"
    root.mkdir()
    for path in Path(screw_module_ros.__file__).parent.glob("*.py"):
        shutil.copy(path, root)
    monkeypatch.setattr(software, "__file__", str(root / "software.py"))
    forget()
    yield root
    forget()


def forget():
    software.software.cache_clear()
    software.commit.cache_clear()


def test_a_changed_byte_gives_another_digest(copy):
    before = software.software()
    path = copy / "units.py"
    path.write_text(path.read_text() + "\n")
    forget()
    assert software.software() != before
    assert software.software().split()[0] == before.split()[0] == software.version()


def test_what_cannot_be_read_is_unknown(copy):
    path = copy / "units.py"
    path.unlink()
    path.symlink_to(copy / "nothing")
    assert software.software() == f"{software.version()} unknown, commit unknown"


def test_the_commit_is_named_and_what_differs_from_it(copy):
    """A changed page differs too, but moves no robot; a file that git does not know may."""
    root = copy.parent

    def git(*words):
        who = ("-c", "user.name=a", "-c", "user.email=a@b.invalid")
        subprocess.run(["git", "-C", root, *who, *words], check=True, capture_output=True)

    def told():
        forget()
        return software.software().partition(", commit ")[2]

    (root / "docs").mkdir()
    (root / "docs/page.md").write_text("one\n")
    git("init", "-q")
    git("add", "."), git("commit", "-qm", "a")
    clean = told()
    assert re.fullmatch("[0-9a-f]{12}", clean)
    (root / "docs/page.md").write_text("two\n")
    assert told() == clean
    (copy / "law.py").write_text("")
    assert told() == f"{clean}, dirty"
    git("add", "."), git("commit", "-qm", "b")
    assert re.fullmatch("[0-9a-f]{12}", told()) and told() != clean
    (copy / "law.py").write_text("a = 1\n")
    assert told().endswith(", dirty")


def test_a_copy_below_another_repository_has_no_commit(copy):
    subprocess.run(["git", "init", "-q", copy.parent.parent], check=True)
    assert software.software().endswith(", commit unknown")
