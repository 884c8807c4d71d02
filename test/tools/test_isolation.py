# SPDX-License-Identifier: Apache-2.0
"""Two runs at once: a ROS domain for each, and nothing of the other removed."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import isolation
import leftovers


def test_two_runs_at_once_get_two_domains() -> None:
    with isolation.own_domain() as first, isolation.own_domain() as second:
        assert first != second


def test_a_domain_that_somebody_uses_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    with isolation.own_domain() as domain:
        pass
    monkeypatch.setattr(isolation, "DOMAINS", [domain])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as somebody:
        somebody.bind(("", 7400 + 250 * domain + 10))
        with pytest.raises(RuntimeError, match="in use"), isolation.own_domain():
            pass


NO_PORTS = range(0)
PORT_FILES = ("fastrtps_port7661", "fastrtps_port7661_el", "sem.fastrtps_port7661_mutex")
# As Fast DDS does it: the owner keeps the lock file open, which lies beside the segment.
OWN_AND_WAIT = """
import sys
with open(sys.argv[1] + "_el", "w"):
    print("owned", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def shared_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(leftovers, "SHARED_MEMORY", tmp_path)
    return tmp_path


@pytest.fixture
def segment(shared_memory: Path) -> Path:
    file = shared_memory / "fastrtps_0123456789abcdef"
    file.touch()
    return file


@pytest.fixture
def start(segment: Path) -> Iterator[Callable[[str], subprocess.Popen[str]]]:
    """Return a function that starts a process with a mark, which owns the segment till closed."""
    started = []

    def start_one(mark: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-c", OWN_AND_WAIT, str(segment)],
            env={**os.environ, leftovers.MARK: mark},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        assert process.stdout is not None
        assert process.stdout.readline() == "owned\n"
        return process

    yield start_one
    for process in started:
        process.communicate()


@pytest.fixture
def mark() -> str:
    return uuid.uuid4().hex


def test_a_segment_is_ours_when_our_process_owned_it(start, mark, segment, wait_until) -> None:
    with leftovers.Watch(mark, NO_PORTS) as ours, leftovers.Watch("another", NO_PORTS) as theirs:
        process = start(mark)
        wait_until(lambda: ours.owned, what="the watch's look at the process")
        assert ours.files() == []  # while somebody has it
        process.communicate()
    lock = segment.with_name(segment.name + "_el")
    assert ours.files() == [segment, lock]
    assert theirs.files() == []
    segment.rename(segment.with_suffix(".old"))
    segment.touch()
    assert ours.files() == []  # another file by the same name


def test_a_killed_process_leaves_nothing_that_it_owned(start, mark, shared_memory) -> None:
    peers = shared_memory / "fastrtps_fedcba9876543210"
    peers.touch()
    leftovers.kill(start(mark).pid)
    assert list(shared_memory.iterdir()) == [peers]


def test_a_port_file_is_ours_by_its_number(shared_memory: Path) -> None:
    watch, others = (leftovers.Watch("mark", range(n, n + 250)) for n in (7650, 7900))
    ours = [shared_memory / name for name in PORT_FILES]
    for file in ours:
        file.touch()
    assert watch.files() == ours
    assert others.files() == []


def test_a_port_that_an_earlier_run_left_is_not_ours(shared_memory: Path) -> None:
    """It was killed, and this run happened to take the same domain; CI failed of it."""
    for name in PORT_FILES:
        (shared_memory / name).touch()
    watch = leftovers.Watch("mark", range(7650, 7900))
    assert watch.files() == []
    taken = shared_memory / PORT_FILES[0]
    taken.rename(taken.with_suffix(".old"))  # as Fast DDS does, whose process opens it anew
    taken.touch()
    assert watch.files() == [shared_memory / name for name in PORT_FILES]
