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
