# SPDX-License-Identifier: Apache-2.0
"""Run a command on a machine made busy, with its processes stopped at random.

    python tools/harass.py --runs 10 tools/run demo --strict

Beside the command run busy loops at normal priority; once a second one process of those that the
command has started, at any depth, is stopped (SIGSTOP) for 50 to 300 ms. Exits with 1 when a run
failed. Standard library only.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def main() -> int:
    """Run the command as often as asked; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--loops", type=int, default=2, help="busy loops beside the command")
    parser.add_argument("--every", type=float, default=1.0, help="seconds between stops, 0 = none")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("command", nargs=argparse.REMAINDER)
    options = parser.parse_args()
    if not options.command:
        parser.error("a command is wanted")
    draw = random.Random(options.seed)
    codes = []
    for number in range(options.runs):
        begun = time.monotonic()
        code, stops = harassed(options.command, options.loops, options.every, draw)
        codes.append(code)
        print(
            f"run {number + 1} of {options.runs}: exit code {code}, {stops} stops, "
            f"{time.monotonic() - begun:.0f} s",
            flush=True,
        )
    print(f"{codes.count(0)} of {len(codes)} runs succeeded")
    return int(any(codes))


def harassed(
    command: list[str], loops: int, every: float, draw: random.Random
) -> tuple[int, int]:
    """Run the command once; return its exit code and how often a process was stopped."""
    with subprocess.Popen(command) as process, harassing(process.pid, loops, every, draw) as stops:
        try:
            code = process.wait()
        except KeyboardInterrupt:
            process.send_signal(signal.SIGINT)
            code = process.wait()
    return code, len(stops)


@contextmanager
def harassing(root: int, loops: int, every: float, draw: random.Random) -> Iterator[list[int]]:
    """Keep `loops` cores busy and stop processes that `root` started; yield whom so far."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(loops)]
    spared = {process.pid for process in busy}
    over, stops = threading.Event(), []
    thread = threading.Thread(target=_stop_some, args=(root, every, draw, over, stops, spared))
    if every > 0.0:
        thread.start()
    try:
        yield stops
    finally:
        over.set()
        if every > 0.0:
            thread.join()
        for loop in busy:
            loop.kill()
            loop.wait()


def _stop_some(
    root: int,
    every: float,
    draw: random.Random,
    over: threading.Event,
    stops: list[int],
    spared: set[int],
) -> None:
    while not over.wait(every):
        found = sorted(set(descendants(root)) - spared)
        if not found:
            continue
        pid = draw.choice(found)
        try:
            os.kill(pid, signal.SIGSTOP)
            over.wait(draw.uniform(0.05, 0.3))
            os.kill(pid, signal.SIGCONT)
            stops.append(pid)
        except ProcessLookupError:
            continue


def descendants(root: int) -> list[int]:
    """Return the processes that `root` has started, at any depth, without itself."""
    parents: dict[int, int] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        parents[int(folder.name)] = int(fields[1])
    found = {root}
    while more := {pid for pid, parent in parents.items() if parent in found} - found:
        found |= more
    return sorted(found - {root})


if __name__ == "__main__":
    sys.exit(main())
