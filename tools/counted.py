# SPDX-License-Identifier: Apache-2.0
"""`whole`, with the Python calls of its loops counted by file: tools/bench.py starts it.

    python tools/counted.py FILE [ARGUMENT of whole]...

The first SIGUSR1 begins the count, the second ends it and writes FILE as JSON: `ticks` of 1 ms of
simulated time that have passed, and `files` with their calls. Only the thread of the loops counts.
"""

from __future__ import annotations

import json
import signal
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import greenlet

from screw_module_ros.lockstep.clock import simulated_clock
from screw_module_ros.nodes import whole

TICK_NS = 1_000_000


class Calls:
    """Counts calls of this thread in all its greenlets, from `begin` to `write`."""

    def __init__(self) -> None:
        self._files: Counter[str] = Counter()
        self._begun_ns: int | None = None

    def flip(self, file: Path) -> None:
        """Begin, or end and write `file`."""
        if self._begun_ns is None:
            self._begun_ns = _now_ns()
            greenlet.settrace(self._arm)  # each greenlet has a profile function of its own
            self._arm()
            return
        greenlet.settrace(None)
        sys.setprofile(None)
        ticks = (_now_ns() - self._begun_ns) / TICK_NS
        beside = file.with_suffix(".part")  # who waits for the file finds a whole one
        beside.write_text(json.dumps({"ticks": ticks, "files": self._files}), encoding="utf-8")
        beside.replace(file)

    def _arm(self, *_: object) -> None:
        sys.setprofile(self._note)

    def _note(self, frame: Any, event: str, _argument: Any) -> None:
        if event == "call":
            self._files[frame.f_code.co_filename] += 1


def _now_ns() -> int:
    clock = simulated_clock("counted", "")  # that of this process, which its nodes have opened
    try:
        return clock.now_ns()
    finally:
        clock.close()


def main() -> int:
    """Run `whole`."""
    calls, file = Calls(), Path(sys.argv.pop(1))
    signal.signal(signal.SIGUSR1, lambda *_: calls.flip(file))
    return whole.main()


if __name__ == "__main__":
    sys.exit(main())
