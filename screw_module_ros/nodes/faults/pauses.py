# SPDX-License-Identifier: Apache-2.0
"""How long the machine's cores stood still, which no program on them can help.

A process per core, above every node's priority, sleeps and sees how late it wakes. The rig's own
clock tells of its core alone.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import time
from multiprocessing.process import BaseProcess
from typing import Any

_PRIORITY = 60  # the rig, the most urgent of all, has 50
_NAP_S = 0.01
_PAUSE_S = 0.015  # the least that counts; a sample of the catalogue is 20 ms


class Pauses:
    """Watches each core that this process may use, from entering to leaving.

    totals: for `paused`, also in another process.
    """

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.totals: list[Any] = []
        self._watchers: list[BaseProcess] = []
        for core in sorted(os.sched_getaffinity(0)):
            total = context.Value("d", 0.0)
            self.totals.append(total)
            self._watchers.append(context.Process(target=_watch, args=(core, total), daemon=True))

    def __enter__(self) -> Pauses:
        for watcher in self._watchers:
            watcher.start()
        return self

    def __exit__(self, *_: object) -> None:
        for watcher in self._watchers:
            watcher.terminate()
            watcher.join()


def paused(totals: list[Any]) -> float:
    """Return for how long cores have stood still up to now, all added up [ms]."""
    return 1e3 * sum(total.value for total in totals)


def _watch(core: int, total: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent's affair
    with contextlib.suppress(OSError):
        os.sched_setaffinity(0, {core})
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    parent = os.getppid()
    while os.getppid() == parent:
        before = time.monotonic()
        time.sleep(_NAP_S)
        late = time.monotonic() - before - _NAP_S
        if late > _PAUSE_S:
            total.value += late
