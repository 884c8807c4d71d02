# SPDX-License-Identifier: Apache-2.0
"""The steps of `make build`: what is done again, and what a failure says."""

from __future__ import annotations

import sys
import threading
from pathlib import Path

import pytest

import build
import packages
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


def step(folder: Path, name: str, work, beside: bool = False) -> steps.Step:
    (folder / name).mkdir(exist_ok=True)
    return steps.Step(name, folder / name, "today", lambda _: work(), beside)


def test_what_fits_is_not_done_again(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    done: list[str] = []
    plan = [step(tmp_path, name, lambda name=name: done.append(name)) for name in "ab"]
    (plan[0].folder / ".stamp").write_text("today")
    steps.run_all(plan, steps.Progress(2))
    assert done == ["b"]
    assert "is up to date" in capsys.readouterr().out


def test_a_step_may_be_done_beside_the_one_before(tmp_path: Path) -> None:
    beside = threading.Event()
    plan = [
        step(tmp_path, "one", lambda: beside.wait(10.0) or pytest.fail("the other did not start")),
        step(tmp_path, "two", beside.set, beside=True),
        step(tmp_path, "three", lambda: None),
    ]
    steps.run_all(plan, steps.Progress(3))
    assert all(step.fits() for step in plan)


def test_a_step_beside_another_that_fails_leaves_no_stamp(tmp_path: Path) -> None:
    def fail() -> None:
        raise steps.StepFailed("no network")

    plan = [
        step(tmp_path, "one", lambda: None),
        step(tmp_path, "two", fail, beside=True),
        step(tmp_path, "three", lambda: pytest.fail("the step before failed")),
    ]
    with pytest.raises(steps.StepFailed, match="no network"):
        steps.run_all(plan, steps.Progress(3))
    assert [step.fits() for step in plan] == [True, False, False]
    steps.run_all([step(tmp_path, "four", lambda: None)], steps.Progress(1))  # commands start again


def test_a_failed_command_shows_the_end_of_its_output(tmp_path: Path) -> None:
    log = tmp_path / "log/step.log"
    command = ["sh", "-c", "for i in $(seq 50); do echo line $i; done; echo why >&2; exit 3"]
    with pytest.raises(steps.StepFailed, match=r"(?s)^it failed.*line 50\n +why$") as failure:
        steps.run_logged("it", command, log, steps.Progress(1), {"PATH": "/usr/bin:/bin"})
    assert "line 1\n" not in str(failure.value)
    assert "line 1\n" in log.read_text()


LISTING = """\
:env:.find-links='/one /two'
global.extra-index-url='\\nhttps://user:word@a.invalid/simple\\nhttps://b.invalid/simple'
global.index-url='https://c.invalid/simple'
global.timeout='15'
install.timeout='60'
freeze.timeout='1'
global.verbose='2'
"""


@pytest.fixture
def calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the names of the installers that are run; uv fails."""
    seen: list[str] = []

    def run(name: str, *_: object) -> None:
        seen.append(name)
        if name == "uv":
            raise steps.StepFailed("uv failed")

    monkeypatch.setattr(packages, "run_logged", run)
    return seen


def test_uv_looks_where_pip_does() -> None:
    assert packages.uv_variables(LISTING) == {
        "UV_INDEX_STRATEGY": "unsafe-best-match",
        "UV_DEFAULT_INDEX": "https://c.invalid/simple",
        "UV_INDEX": "https://user:word@a.invalid/simple https://b.invalid/simple",
        "UV_FIND_LINKS": "/one,/two",
        "UV_HTTP_TIMEOUT": "60",
    }


def test_where_uv_fails_pip_installs(calls: list[str], tmp_path: Path) -> None:
    packages.install(Path(sys.executable), [], tmp_path / "log", steps.Silence())
    assert calls == ["uv", "pip"]
