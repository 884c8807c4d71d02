# SPDX-License-Identifier: Apache-2.0
"""A signal ends a process in whatever the main thread is doing."""

from __future__ import annotations

import signal
import subprocess
import sys
from contextlib import suppress

import pytest

from screw_module_ros.nodes.bringup import executable_path
from screw_module_ros.nodes.support.runtime import StopFlag

# It is always about to wait: a handler that set the event itself would lock up every second time.
WAITS = """
import threading
from screw_module_ros.nodes.support.runtime import stop_on_signals
stopping = threading.Event()
stop_on_signals(stopping)
print("waits", flush=True)
while not stopping.is_set():
    stopping.wait(0)
"""
TIMES = 15


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_is_never_lost_in_a_lock(number):
    for _ in range(TIMES):
        with subprocess.Popen(
            [sys.executable, "-c", WAITS], stdout=subprocess.PIPE, text=True
        ) as process:
            try:
                assert process.stdout.readline() == "waits\n"
                process.send_signal(number)
                assert process.wait(20) == 0
            finally:
                process.kill()


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


def test_impatience_does_not_spoil_a_good_end(ros_domain_id):
    """SIGINT again and again: the node still ends with 0."""
    process = subprocess.Popen(
        [executable_path("endpoint_state")], stderr=subprocess.PIPE, text=True
    )
    try:
        assert any("active" in line for line in process.stderr)
        while process.poll() is None:
            process.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                process.wait(0.001)
        assert process.returncode == 0
    finally:
        process.kill()
        process.communicate()


def test_a_node_that_dies_in_a_library_says_where(ros_domain_id):
    with subprocess.Popen(
        [executable_path("endpoint_state")], stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert any("active" in line for line in process.stderr)
            process.send_signal(signal.SIGSEGV)
            told = process.stderr.read()
            assert process.wait(20) == -signal.SIGSEGV
        finally:
            process.kill()
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
