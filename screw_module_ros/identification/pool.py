# SPDX-License-Identifier: Apache-2.0
"""Worker processes for the trials of a lab, which use all cores."""

from __future__ import annotations

import multiprocessing
import os
import signal
from concurrent.futures import ProcessPoolExecutor


def worker_pool(workers: int | None = None) -> ProcessPoolExecutor:
    """Return a pool of processes, by default one per available core."""
    count = workers or len(os.sched_getaffinity(0))
    return ProcessPoolExecutor(
        count, mp_context=multiprocessing.get_context("spawn"), initializer=_prepare
    )


def _prepare() -> None:
    """Ignore Ctrl-C; the parent handles it, waits for running trials and ends the pool."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
