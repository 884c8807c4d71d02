# SPDX-License-Identifier: Apache-2.0
"""A signal ends a process in whatever the main thread is doing."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from contextlib import suppress

import pytest

from screw_module_ros.nodes.bringup import executable_path
from screw_module_ros.nodes.support.runtime import StopFlag, stop_on_signals, stopped

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Waited(threading.Event):
    """Notes who sets it: a handler, in the main thread, may have interrupted a wait of that."""

    by: threading.Thread | None = None

    def set(self) -> None:
        self.by = threading.current_thread()
        super().set()


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_is_never_lost_in_a_lock(number):
    before, stopping = {each: signal.getsignal(each) for each in SIGNALS}, Waited()
    try:
        stop_on_signals(stopping)
        signal.raise_signal(number)
        assert stopping.wait(20.0)
        assert stopping.by is not threading.main_thread()
        stopped()
        signal.raise_signal(number)  # once more, while the interpreter ends
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def test_the_flag_hears_signals_and_gives_them_back():
    before = signal.getsignal(signal.SIGTERM)
    flag = StopFlag()
    flag.catch()
    try:
        assert not flag
        signal.raise_signal(signal.SIGTERM)
        assert flag
    finally:
        flag.release()
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.fixture
def process(ros_domain_id):
    """A node that is active."""
    command = [executable_path("endpoint_state")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as node:
        assert any("active" in line for line in node.stderr)
        yield node
        node.kill()


def test_impatience_does_not_spoil_a_good_end(process):
    """SIGINT again and again: the node still ends with 0."""
    while process.poll() is None:
        process.send_signal(signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            process.wait(0.001)
    assert process.returncode == 0


def test_a_node_that_dies_in_a_library_says_where(process):
    process.send_signal(signal.SIGSEGV)
    told = process.stderr.read()
    assert process.wait(20) == -signal.SIGSEGV
    assert "Fatal Python error: Segmentation fault" in told
    assert "run_loop" in told and "_serve" in told, "both threads"


# As Fast DDS does when it locks up: a call that never returns and keeps the interpreter's lock.
LOCKED_UP = """
import ctypes
from screw_module_ros.nodes.support.runtime import LastResort
last_resort = LastResort({code}, 2)
last_resort.arm()
last_resort.disarm()
{then}
ctypes.PyDLL(None).pause()
"""


@pytest.mark.parametrize("code", [0, 1])
def test_a_process_that_locks_up_after_its_work_ends_with_its_code(code):
    ended, told = locked_up(code, "last_resort.arm()")
    assert ended == code
    assert told.startswith("Timeout")  # the stacks, for whoever looks for the cause


def test_one_that_was_disarmed_goes_on():
    assert locked_up(0, "ctypes.CDLL(None).alarm(4)") == (-signal.SIGALRM, "")


def locked_up(code: int, then: str) -> tuple[int, str]:
    """Return the exit code and stderr of a process that locks up."""
    script = LOCKED_UP.format(code=code, then=then)
    done = subprocess.run(
        [sys.executable, "-c", script], stderr=subprocess.PIPE, text=True, timeout=30, check=False
    )
    return done.returncode, done.stderr
