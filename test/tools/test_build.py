# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import io
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


def test_a_step_is_done_only_with_its_stamp(root: Path) -> None:
    assert not build.fits(root, "x")
    (root / ".stamp").write_text("x")
    assert build.fits(root, "x")
    assert not build.fits(root, "y")


def test_the_pins_are_exact_and_each_package_is_listed_once() -> None:
    lines = [
        line.split(";")[0].strip()
        for file in build.requirement_files(ros=None)
        for line in file.read_text().splitlines()
        if line and not line.startswith("#")
    ]
    assert all(line.count("==") == 1 for line in lines)
    names = [line.split("==")[0] for line in lines]
    assert sorted(set(names)) == sorted(names)


def test_a_failed_command_shows_the_end_of_its_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdout", io.StringIO())
    log = tmp_path / "log/step.log"
    command = ["sh", "-c", "for i in $(seq 50); do echo line $i; done; echo why >&2; exit 3"]
    with pytest.raises(steps.StepFailed, match=r"(?s)^it failed.*line 50\n +why$") as failure:
        steps.run_logged("it", command, log, steps.Progress(1), {"PATH": "/usr/bin:/bin"})
    assert "line 1\n" not in str(failure.value)
    assert "line 1\n" in log.read_text()
