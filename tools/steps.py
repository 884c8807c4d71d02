# SPDX-License-Identifier: Apache-2.0
"""Progress of long steps: one line each, output kept in a log and shown only when it fails."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

LINES_SHOWN_ON_FAILURE = 30
SECONDS_BETWEEN_LINES = 10.0  # how often a long step says that it lives, when not on a terminal
STOPPED = threading.Event()


class StepFailed(Exception):
    """A step did not succeed; the text is what the user should read, way out included."""


class Progress:
    """Writes `[2/5] what ... 12.3 s` and keeps the total, on a terminal or in a plain log."""

    def __init__(self, total: int) -> None:
        self._total = total
        self._number = 0
        self._live = sys.stdout.isatty()
        self._started = time.monotonic()
        self._title = ""
        self._last_line = 0.0

    def begin(self, what: str) -> None:
        """Announce the next step."""
        self._number += 1
        self._title = f"[{self._number}/{self._total}] {what}"
        self._started = self._last_line = time.monotonic()
        print(self._title, end=" " if self._live else "\n", flush=True)

    def tick(self, detail: str) -> None:
        """Show that the running step goes on: in place on a terminal, else a line now and then."""
        now = time.monotonic()
        elapsed = f"{now - self._started:.0f} s"
        if self._live:
            print(f"\r\x1b[K{self._title} {elapsed}  {detail[:60]}", end="", flush=True)
        elif now - self._last_line >= SECONDS_BETWEEN_LINES:
            self._last_line = now
            print(f"      {elapsed}  {detail[:80]}", flush=True)

    def done(self, note: str = "") -> None:
        """Close the step with its time."""
        result = note or f"done in {time.monotonic() - self._started:.1f} s"
        print(f"\r\x1b[K{self._title} {result}" if self._live else f"      {result}", flush=True)

    def failed(self) -> None:
        """Leave the step's line on the terminal."""
        if self._live:
            print(flush=True)


class Silence(Progress):
    """The progress of a step that works beside the one which is shown."""

    def __init__(self) -> None:
        super().__init__(0)

    def tick(self, detail: str) -> None:
        """Say nothing."""

    def failed(self) -> None:
        """Say nothing."""


@dataclass
class Step:
    """A piece of work and its stamp, a hash of what went in, which says whether it is done."""

    what: str
    folder: Path  # which the step makes, and where its stamp lies
    stamp: str
    work: Callable[[Progress], None]
    beside: bool = False  # may be done beside the step before
    _started: Future | None = None

    def fits(self) -> bool:
        """Return whether the folder was made from what the stamp stands for."""
        try:
            return (self.folder / ".stamp").read_text() == self.stamp
        except OSError:
            return False

    def start(self, pool: Executor) -> None:
        """Begin the work before its turn."""
        self._started = pool.submit(self.work, Silence())

    def finish(self, progress: Progress) -> None:
        """Do the work, or wait for it where it was started; leave the stamp."""
        if self._started is None:
            self.work(progress)
        else:
            self._wait(self._started, progress)
        (self.folder / ".stamp").write_text(self.stamp)

    def _wait(self, started: Future, progress: Progress) -> None:
        while wait([started], timeout=1.0).not_done:
            progress.tick("")
        if started.exception():
            progress.failed()
        started.result()


@contextmanager
def no_more_commands_after_an_error():
    """Let a step beside end with the command that it is at when this one fails or is stopped."""
    STOPPED.clear()
    try:
        yield
    except BaseException:
        STOPPED.set()
        raise


def run_all(steps: list[Step], progress: Progress) -> None:
    """Do the steps that do not fit, in their order, one that may be beside the one before."""
    with ThreadPoolExecutor(1) as pool, no_more_commands_after_an_error():
        for number, step in enumerate(steps):
            progress.begin(step.what)
            for following in steps[number + 1 : number + 2]:
                if following.beside and not following.fits():
                    following.start(pool)
            if step.fits():
                progress.done("is up to date")
                continue
            step.finish(progress)
            progress.done()


def run_logged(
    name: str, command: list[str], log: Path, progress: Progress, env: dict[str, str]
) -> None:
    """Run a command with its output appended to `log`; raise StepFailed with the output's end."""
    if STOPPED.is_set():
        raise KeyboardInterrupt
    log.parent.mkdir(parents=True, exist_ok=True)
    last: deque[str] = deque(maxlen=LINES_SHOWN_ON_FAILURE)
    with log.open("a", encoding="utf-8") as file:
        file.write("$ " + " ".join(command) + "\n")
        with subprocess.Popen(
            command, env=env, text=True, errors="replace", bufsize=1,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        ) as process:
            assert process.stdout is not None
            for line in process.stdout:
                file.write(line)
                if line.strip():
                    last.append(line.rstrip())
                if not line.startswith(("make", "gmake")):  # entering and leaving folders
                    progress.tick(line.strip())
    if process.returncode in (-signal.SIGINT, 128 + signal.SIGINT):
        raise KeyboardInterrupt  # also beside the main thread: nobody shall try another way now
    if process.returncode != 0:
        progress.failed()
        tail = "\n".join("    " + line for line in last)
        what = f"{name} failed; its last lines (all in {os.path.relpath(log)})"
        raise StepFailed(f"{what}:\n{tail}")
