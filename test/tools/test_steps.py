# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import steps


def step(folder: Path, name: str, work, beside: bool = False) -> steps.Step:
    (folder / name).mkdir(exist_ok=True)
    return steps.Step(name, folder / name, "today", lambda _: work(), beside)


def test_a_step_is_done_only_with_its_stamp(tmp_path: Path) -> None:
    one = step(tmp_path, "one", lambda: None)
    assert not one.fits()
    (one.folder / ".stamp").write_text("yesterday")
    assert not one.fits()
    one.finish(steps.Progress(1))
    assert one.fits()


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


def test_a_step_beside_another_that_fails_starts_no_further_command(tmp_path: Path) -> None:
    ended = threading.Event()

    def fail() -> None:
        raise steps.StepFailed("no compiler")

    def two_commands() -> None:
        for number in "12":
            command = ["/bin/sh", "-c", f"sleep 0.5; touch {tmp_path}/{number}"]
            steps.run_logged("it", command, tmp_path / "log", steps.Silence(), {"PATH": "/bin"})
        ended.set()

    plan = [step(tmp_path, "one", fail), step(tmp_path, "two", two_commands, beside=True)]
    with pytest.raises(steps.StepFailed, match="no compiler"):
        steps.run_all(plan, steps.Progress(2))
    assert not ended.is_set()
    assert not (tmp_path / "2").exists()
    steps.run_all([step(tmp_path, "three", lambda: None)], steps.Progress(1))


@pytest.fixture
def hears_interrupts() -> Iterator[None]:
    """A shell in the background ignores SIGINT, and what it starts would inherit that."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("hears_interrupts")
def test_an_interrupted_command_is_no_failed_one(tmp_path: Path) -> None:
    command = ["/bin/sh", "-c", "kill -INT $$"]
    with pytest.raises(KeyboardInterrupt):
        steps.run_logged("it", command, tmp_path / "log", steps.Silence(), {})


def test_a_failed_command_shows_the_end_of_its_output(tmp_path: Path) -> None:
    log = tmp_path / "log/step.log"
    command = ["sh", "-c", "for i in $(seq 50); do echo line $i; done; echo why >&2; exit 3"]
    with pytest.raises(steps.StepFailed, match=r"(?s)^it failed.*line 50\n +why$") as failure:
        steps.run_logged("it", command, log, steps.Progress(1), {"PATH": "/usr/bin:/bin"})
    assert "line 1\n" not in str(failure.value)
    assert "line 1\n" in log.read_text()
