# SPDX-License-Identifier: Apache-2.0
"""Commands in parallel: `python tools/in_parallel.py COMMAND COMMAND...`, each a line for `sh`.

What a command prints is shown whole when it has ended, so that two do not mix. The first that
fails ends the others, as Ctrl-C does; this run then fails, and its last line names that command.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from typing import IO, NamedTuple

import leftovers

ENDED_S = 20.0
"""Time in which an interrupted graph stops [s]; what runs on is killed."""


class Step(NamedTuple):
    """A command that runs. command: on one line; output: what it prints; begin: its start [s]."""

    process: subprocess.Popen[bytes]
    command: str
    output: IO[bytes]
    begin: float


def main() -> int:
    """Run the commands; return 0 if all passed, else the exit code of the one that failed."""
    for number in (signal.SIGINT, signal.SIGTERM):  # also where a shell has them ignored
        signal.signal(number, signal.default_int_handler)
    mark = uuid.uuid4().hex
    running: dict[int, Step] = {}
    with leftovers.Watch(mark, range(0)) as watch:
        try:
            for command in sys.argv[1:]:
                start(command, {**os.environ, leftovers.MARK: mark}, running)
            while running:
                pid, status = os.wait()
                step, code = running.pop(pid), os.waitstatus_to_exitcode(status)
                if code:
                    end(running, watch)
                show(step, code)
                if code:
                    return code if code > 0 else 128 - code
        except KeyboardInterrupt:
            end(running, watch)
            return 128 + signal.SIGINT
    return 0


def start(command: str, env: dict[str, str], running: dict[int, Step]) -> None:
    """Start a command in a session of its own, so that all of its processes can be interrupted."""
    output = tempfile.TemporaryFile()
    process = subprocess.Popen(
        ["sh", "-c", command], env=env, stdin=subprocess.DEVNULL, stdout=output,
        stderr=subprocess.STDOUT, start_new_session=True,
    )  # fmt: skip
    running[process.pid] = Step(process, " ".join(command.split()), output, time.monotonic())
    print(f"== {running[process.pid].command}: started", flush=True)


def show(step: Step, code: int) -> None:
    """Show what a command that has ended printed, and how it ended."""
    step.output.seek(0)
    text = step.output.read().decode(errors="replace")
    outcome = "passed" if code == 0 else f"FAILED with exit code {code},"
    took = time.monotonic() - step.begin
    print(f"{text}== {step.command}: {outcome} after {took:.0f} s", flush=True)


def end(running: dict[int, Step], watch: leftovers.Watch) -> None:
    """Interrupt what still runs, give it time to stop, and kill what is left."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for pid, step in running.items():
        print(f"== {step.command}: interrupted", flush=True)
        os.killpg(pid, signal.SIGINT)
    patience = time.monotonic() + ENDED_S
    while running and time.monotonic() < patience:
        time.sleep(0.1)
        running = {pid: running[pid] for pid in running if os.waitpid(pid, os.WNOHANG)[0] != pid}
    for pid in watch.processes():
        leftovers.kill(pid)


if __name__ == "__main__":
    sys.exit(main())
