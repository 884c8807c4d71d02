# SPDX-License-Identifier: Apache-2.0
"""The software that runs is named by version and source."""

from __future__ import annotations

import shutil
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
    software.software.cache_clear()
    yield root
    software.software.cache_clear()


def test_a_changed_byte_gives_another_digest(copy):
    before = software.software()
    path = copy / "units.py"
    path.write_text(path.read_text() + "\n")
    software.software.cache_clear()
    assert software.software() != before
    assert software.software().split()[0] == before.split()[0] == software.version()


def test_what_cannot_be_read_is_unknown(copy):
    path = copy / "units.py"
    path.unlink()
    path.symlink_to(copy / "nothing")
    assert software.software().split()[1:] == [software.UNKNOWN]
