# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import platform
import shutil
from pathlib import Path

import pytest

import prerequisites


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "share/rclpy").mkdir(parents=True)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    monkeypatch.setattr(prerequisites, "_works", lambda *_: True)
    return tmp_path


def test_a_sourced_jazzy_is_used(prefix: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    assert prerequisites.ros_prefix() == prefix


def test_an_environment_with_wheels_is_no_ros(prefix: Path) -> None:
    (prefix / "pyvenv.cfg").touch()
    assert prerequisites.ros_prefix() is None


def test_another_distribution_is_refused(prefix: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "humble")
    with pytest.raises(prerequisites.Missing, match="humble"):
        prerequisites.ros_prefix()


def test_a_ros_of_another_python_is_refused(prefix: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    monkeypatch.setattr(prerequisites, "_works", lambda *_: False)
    with pytest.raises(prerequisites.Missing, match="PYTHON="):
        prerequisites.ros_prefix()


def test_a_missing_compiler_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setattr(shutil, "which", lambda name: "/usr/bin/make" if name == "make" else None)
    with pytest.raises(prerequisites.Missing, match=r"^c\+\+ .* apt install g\+\+$"):
        prerequisites.check_compiler()


def test_a_machine_without_wheels_is_sent_to_a_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    with pytest.raises(prerequisites.Missing, match=r"aarch64.*source a ROS 2 Jazzy"):
        prerequisites.check_wheels_fit()


def test_a_full_disk_is_said_before_it_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)._replace(free=100_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    with pytest.raises(prerequisites.Missing, match=r"0\.1 GB free"):
        prerequisites.check_disk(tmp_path)


@pytest.mark.parametrize("path", ["/home/a b/x", "/home/Zoë/ü", "/a/c++_d-e.f@1"])
def test_a_path_with_spaces_or_letters_of_any_language_is_fine(path: str) -> None:
    assert prerequisites.check_path(Path(path), ros=None) is None


@pytest.mark.parametrize("letter", [*":;,$(%='\"#\n", "\udcff", "\u00a0"])
def test_a_path_that_the_tools_do_not_take_is_refused_at_once(letter: str) -> None:
    with pytest.raises(prerequisites.Missing, match="move the checkout to a path without") as told:
        prerequisites.check_path(Path(f"/a{letter}b/c"), ros=None)
    assert str(told.value).isascii()
    assert "\n" not in str(told.value)


def test_a_sourced_ros_takes_only_ascii(prefix: Path) -> None:
    prerequisites.check_path(Path("/a b"), ros=prefix)
    with pytest.raises(prerequisites.Missing, match=r"\\xfc"):
        prerequisites.check_path(Path("/ü"), ros=prefix)
