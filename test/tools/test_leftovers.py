# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import mmap
import os
import subprocess
import sys
import uuid
from collections.abc import Callable
from pathlib import Path

import pytest

import leftovers

NO_PORTS = range(0)
MAP_AND_WAIT = """
import mmap, sys
with open(sys.argv[1], "r+b") as file:
    view = mmap.mmap(file.fileno(), 0)
    print("mapped", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def shared_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(leftovers, "SHARED_MEMORY", tmp_path)
    return tmp_path


def start(mark: str, *arguments: str) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", MAP_AND_WAIT, *arguments],
        env={**os.environ, leftovers.MARK: mark},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "mapped\n"
    return process


@pytest.fixture
def segment() -> Path:
    file = leftovers.SHARED_MEMORY / f"fastrtps_test_{uuid.uuid4().hex}"
    file.write_bytes(bytes(mmap.PAGESIZE))
    yield file
    file.unlink(missing_ok=True)


def test_a_process_is_known_by_its_mark(segment: Path) -> None:
    mark = uuid.uuid4().hex
    with start(mark, str(segment)) as process:
        assert list(leftovers.Watch(mark, NO_PORTS).processes()) == [process.pid]
        assert leftovers.Watch("another", NO_PORTS).processes() == {}


def test_a_file_is_ours_when_our_process_had_itmapped(
    segment: Path, wait_until: Callable[..., None]
) -> None:
    mark = uuid.uuid4().hex
    with leftovers.Watch(mark, NO_PORTS) as ours, leftovers.Watch("another", NO_PORTS) as theirs:
        with start(mark, str(segment)):
            wait_until(lambda: ours.mapped, what="the watch's look at the process")
        assert ours.files() == [segment]
        assert theirs.files() == []


def test_the_lock_file_of_a_segment_is_ours_too(
    segment: Path, wait_until: Callable[..., None]
) -> None:
    mark = uuid.uuid4().hex
    lock = segment.with_name(segment.name + "_el")
    lock.touch()
    with leftovers.Watch(mark, NO_PORTS) as watch, start(mark, str(segment)):
        wait_until(lambda: watch.mapped, what="the watch's look at the process")
    assert watch.files() == [segment, lock]
    lock.unlink()


def test_a_later_file_of_the_same_name_is_not_ours(
    segment: Path, wait_until: Callable[..., None]
) -> None:
    mark = uuid.uuid4().hex
    with leftovers.Watch(mark, NO_PORTS) as watch, start(mark, str(segment)):
        wait_until(lambda: watch.mapped, what="the watch's look at the process")
    later = segment.with_suffix(".later")
    later.touch()
    later.rename(segment)
    assert watch.files() == []


def test_a_killed_process_leaves_no_segment(segment: Path) -> None:
    process = start(uuid.uuid4().hex, str(segment))
    leftovers.kill(process.pid)
    process.communicate()
    assert not segment.exists()


def test_what_another_process_uses_stays(segment: Path) -> None:
    first, second = (start(uuid.uuid4().hex, str(segment)) for _ in range(2))
    leftovers.kill(first.pid)
    first.communicate()
    assert segment.exists()
    leftovers.kill(second.pid)
    second.communicate()
    assert not segment.exists()


def test_what_others_use_is_not_ours(segment: Path, wait_until: Callable[..., None]) -> None:
    mark = uuid.uuid4().hex
    with start(uuid.uuid4().hex, str(segment)):
        with leftovers.Watch(mark, NO_PORTS) as watch, start(mark, str(segment)):
            wait_until(lambda: watch.mapped, what="the watch's look at the process")
        assert watch.files() == []
    assert watch.files() == [segment]


def test_a_port_file_is_ours_by_its_number(shared_memory: Path) -> None:
    names = ("fastrtps_port7661", "fastrtps_port7661_el", "sem.fastrtps_port7661_mutex")
    for name in names:
        (shared_memory / name).touch()
    ours = [shared_memory / name for name in names]
    assert leftovers.Watch("mark", range(7650, 7900)).files() == ours
    assert leftovers.Watch("mark", range(7900, 8150)).files() == []
