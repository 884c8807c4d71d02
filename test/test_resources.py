# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from screw_module_ros import resources


def test_a_file_of_the_source_tree_is_found() -> None:
    assert resources.resource_path("package.xml").read_text().startswith("<?xml")


def test_a_file_inside_the_package_is_found() -> None:
    assert resources.resource_path("resources.py") == Path(resources.__file__).resolve()


def test_an_installed_file_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "share/screw_module_ros/params/mine.yaml"
    file.parent.mkdir(parents=True)
    file.touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    assert resources.resource_path("params/mine.yaml") == file


def test_a_missing_file_is_named_with_the_places() -> None:
    with pytest.raises(resources.ResourceError, match=r"params/none\.yaml not found in .*ros"):
        resources.resource_path("params/none.yaml")


def test_the_plain_package_brings_no_ros() -> None:
    code = "import sys, screw_module_ros; sys.exit('rclpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
