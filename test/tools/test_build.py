# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from pathlib import Path

import pytest

import build
import steps


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(build, "ROOT", tmp_path)
    return tmp_path


def test_a_changed_added_or_renamed_file_asks_for_the_step_again(root: Path) -> None:
    file = root / "a.msg"
    file.write_text("float64 x")
    before = build.digest(["3.12"], [file])
    assert build.digest(["3.12"], [file]) == before
    assert build.digest(["3.13"], [file]) != before
    assert build.digest(["3.12"], [file, file]) != before
    renamed = file.rename(root / "b.msg")
    assert build.digest(["3.12"], [renamed]) != before
    file.write_text("float32 x")
    assert build.digest(["3.12"], [file]) != before


def test_the_pins_are_exact_and_each_package_is_listed_once() -> None:
    lines = [
        line.split(";")[0].strip()
        for file in build.REQUIREMENTS.glob("*.txt")
        for line in file.read_text().splitlines()
        if line and not line.startswith("#")
    ]
    assert all(line.count("==") == 1 for line in lines)
    names = [line.split("==")[0] for line in lines]
    assert sorted(set(names)) == sorted(names)


def test_with_a_sourced_ros_its_wheels_are_not_installed() -> None:
    with_wheels = build.tool_lists(ros=None)
    assert build.tool_lists(ros=Path("/opt/ros/jazzy")) == with_wheels[:-1]
    assert with_wheels[-1] == build.REQUIREMENTS / "ros.txt"


def test_what_drives_a_browser_is_installed_where_there_is_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert build.REQUIREMENTS / "browser.txt" not in build.import_lists()
    (tmp_path / "chromium").touch(mode=0o755)
    assert build.REQUIREMENTS / "browser.txt" in build.import_lists()


@pytest.mark.parametrize("ros", [None, Path("/opt/ros/jazzy")])
def test_only_the_packages_to_import_are_installed_beside_another_step(ros: Path | None) -> None:
    plan = build.plan(ros)
    assert len(plan) == build.STEPS
    assert [step.what for step in plan if step.beside] == ["packages to import"]


def test_packages_that_were_interrupted_are_marked_those_that_failed_are_not(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "VENV", root)
    with pytest.raises(KeyboardInterrupt), build.unfinished("tools"):
        raise KeyboardInterrupt
    assert (root / f"{build.UNFINISHED}tools").exists()
    with pytest.raises(steps.StepFailed), build.unfinished("tools"):
        raise steps.StepFailed("no network")
    assert not list(root.iterdir())
