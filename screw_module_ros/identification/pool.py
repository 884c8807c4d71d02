# SPDX-License-Identifier: Apache-2.0
"""A lab with several worker processes, each with a simulated bench, which uses all cores."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from pathlib import Path

from .in_process import InProcessBench
from .lab import Job, Lab, Part, Progress
from .trials import duration_of

_bench: dict[str, InProcessBench] = {}  # of a worker process


class PoolLab(Lab):
    """A lab whose jobs run in worker processes, the longest first.

    pool: from `worker_pool`; several labs may share it. The other arguments as in `Lab`.
    """

    def __init__(
        self,
        bench: InProcessBench,
        folder: Path,
        pool: ProcessPoolExecutor,
        progress: Progress = lambda doing, done, total: None,
        fingerprint: str = "",
    ):
        super().__init__(bench, folder, progress, fingerprint)
        self._pool = pool

    def _done(
        self, experiment: str, jobs: Sequence[Job], done: float, total: float
    ) -> Iterator[tuple[Job, Part]]:
        """Yield each finished job with its part; an error cancels the remaining jobs."""
        setup = (self.bench.world, self.bench.loop, self.bench.seed)
        ordered = sorted(jobs, key=lambda job: -duration_of(job.trial))
        futures: dict[Future, Job] = {
            self._pool.submit(_do, self.bench.name, setup, job): job for job in ordered
        }
        try:
            for future in as_completed(futures):
                job = futures[future]
                yield job, future.result()
                done += duration_of(job.trial)
                self.progress(experiment, done, total)
        finally:
            for future in futures:
                future.cancel()


def worker_pool(workers: int | None = None) -> ProcessPoolExecutor:
    """Return a pool of processes, by default one per available core."""
    count = workers or len(os.sched_getaffinity(0))
    return ProcessPoolExecutor(
        count, mp_context=multiprocessing.get_context("spawn"), initializer=_prepare
    )


def _prepare() -> None:
    """Ignore Ctrl-C; the parent handles it, waits for running jobs and ends the pool."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _do(name: str, setup: tuple, job: Job) -> Part:
    if name not in _bench:
        _bench.clear()
        _bench[name] = InProcessBench(*setup)
    return job.reduce(job.trial, _bench[name].record(job.trial, lambda share: None))
