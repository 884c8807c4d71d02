# SPDX-License-Identifier: Apache-2.0
"""Damaged bags and killed recorders: `fuzz_bags` with its own cases, and a recorder killed.

The killed recorder is a process that writes a bag as `session_recorder` does and gets SIGKILL when
its files have grown to a random size.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
from collections import Counter
from pathlib import Path

from bag_counts import by_library, by_scan
from fuzz_bags import Fuzzer, endless_bag, said

from screw_module_ros.recording.recovery import is_torn

_LARGEST = 60_000  # bytes
_SHARES = ("killed", "plain", "rough")


class BagFiles(Fuzzer):
    """One case: a recorder killed, one plain damage, or rougher ones."""

    def case(self, rng: random.Random) -> None:
        """Damage a bag, look at it, recover it."""
        bag = self.folder / "case"
        shutil.rmtree(bag, ignore_errors=True)
        share = rng.choice(_SHARES)
        if share == "killed":
            self._killed(rng, bag)
        else:
            self.damaged(rng, bag, share == "plain")

    def close(self) -> None:
        """Nothing is held."""

    def _killed(self, rng: random.Random, bag: Path) -> None:
        _record_until_killed(bag, rng.randrange(_LARGEST), rng.choice(("zstd", "none")))
        self.counts["killed"] += 1
        files = sorted(bag.glob("*.mcap"))
        before = {path: path.read_bytes() for path in files}
        wanted = sum(max(len(by_scan(data)), by_library(data)) for data in before.values())
        torn = is_torn(bag)
        self.counts["killed, torn" if torn else "killed, complete on the disk"] += 1
        assert said("recover", bag) == 0
        found = Counter(m for path in files for m in by_scan(path.read_bytes()))
        assert found.total() >= wanted, f"{found.total()} of {wanted} messages kept"
        assert sum(by_library(path.read_bytes()) for path in files) == found.total()
        self.counts["messages kept"] += found.total()
        self.counts["messages others find"] += wanted


def _record_until_killed(bag: Path, size: int, compression: str) -> None:
    """Let a child record into `bag`; kill it when its files have `size` bytes or more."""
    child = os.fork()
    if not child:
        try:
            endless_bag(bag, compression)
        finally:
            os._exit(1)  # nothing of the parent's must run twice
    try:
        while sum(path.stat().st_size for path in bag.glob("*.mcap")) < size:
            ended, code = os.waitpid(child, os.WNOHANG)
            assert not ended, f"the recorder ended by itself: {code}"
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
