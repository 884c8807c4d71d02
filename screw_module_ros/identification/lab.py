# SPDX-License-Identifier: Apache-2.0
"""The environment of an experiment: a stand, a folder with finished trials, a progress callback.

An experiment is `run(lab, settings) -> Result`. It gives the lab its trials and a function that
reduces the samples of each, and fits the reduced parts. Finished parts are kept: who turns a module
upside down for the second half of an experiment, or stops it, repeats only the trial that was under
way. With a pool, the trials run in worker processes.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
import zipfile
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np

from .results import Experiment, Result, load_result
from .trials import RELEASE, AnyTrial, Samples, Stand, duration_of, require
from .uncertainty import Source

Part = dict[str, np.ndarray]
"""The reduced samples of a trial: named arrays (scalars as arrays without dimension)."""
Reduce = Callable[[AnyTrial, Samples], Part]
"""A module-level function, or a `functools.partial` of one: a worker process gets it pickled."""
Progress = Callable[[str, float, float], None]
"""Called with the experiment's name and the finished and total seconds of excitation [s]; may raise
`Cancelled`."""


class MissingResult(RuntimeError):
    """The result of a prerequisite experiment is missing."""


class Lab:
    """A stand, a folder, and a progress callback.

    folder: of parts and results; parts of another stand, fingerprint or setting are not reused.
    pool: does the trials; the stand must then be one that can be pickled. Raises OSError if the
    folder cannot be made.
    """

    def __init__(
        self,
        stand: Stand,
        folder: Path,
        progress: Progress = lambda doing, done, total: None,
        fingerprint: str = "",
        pool: ProcessPoolExecutor | None = None,
    ):
        self.stand = stand
        self.folder = Path(folder)
        self.progress = progress
        self._fingerprint = fingerprint
        self._pool = pool
        self.folder.mkdir(parents=True, exist_ok=True)

    @property
    def rate(self) -> float:
        """Samples per second of the stand [1/s]."""
        return self.stand.rate

    def real(self, *sources: Source) -> tuple[Source, ...]:
        """Return sources of uncertainty that only a real module has, none for a simulated one.

        An interval that carried them in simulation could not be judged there: it would always hold.
        """
        return () if RELEASE in self.stand.offers else sources

    def record(
        self, experiment: str, trials: Mapping[str, AnyTrial], reduce: Reduce[AnyTrial]
    ) -> dict[str, Part]:
        """Do the trials without a stored part; return the parts of all by the trials' names.

        Names are unique within the experiment and valid as file names. All trials are checked
        before the first one runs. Raises Cancelled, NotPossible; finished parts stay stored.
        """
        for trial in trials.values():
            require(trial, self.stand)
        files, parts = {}, {}
        for name, trial in trials.items():
            files[name] = self._file(experiment, name, trial, reduce)
            if (part := _kept(files[name])) is not None:
                parts[name] = part
        waiting = {name: trial for name, trial in trials.items() if name not in parts}
        total = sum(map(duration_of, trials.values()))
        done = total - sum(map(duration_of, waiting.values()))
        self.progress(experiment, done, total)

        def on_progress(seconds: float) -> None:
            self.progress(experiment, done + seconds, total)

        for name, part in (self._pooled if self._pool else self._in_turn)(
            waiting, reduce, on_progress
        ):
            _keep(files[name], part)
            parts[name] = part
            done += duration_of(trials[name])
            self.progress(experiment, done, total)
        return {name: parts[name] for name in trials}

    def run(self, experiment: Experiment, settings: Any) -> Result:
        """Run an experiment; its result says on which stand. Raises as the experiment's `run`."""
        return experiment.run(self, settings)._replace(bench=self.stand.name)

    def result(self, experiment: str) -> Result:
        """Return the stored result of an experiment. Raises MissingResult that names it.

        One of another stand, such as another module's, is missing too.
        """
        try:
            found = load_result(self.folder, experiment)
        except FileNotFoundError:
            raise MissingResult(
                f"the result of {experiment} is missing in {self.folder}: run {experiment} first"
            ) from None
        if found.bench not in ("", self.stand.name):
            raise MissingResult(
                f"the result of {experiment} in {self.folder} is from another stand "
                f"({found.bench}; this one is {self.stand.name}): run {experiment} again"
            )
        return found

    def _in_turn(
        self, trials: Mapping[str, AnyTrial], reduce: Reduce[AnyTrial],
        on_progress: Callable[[float], None],
    ) -> Iterator[tuple[str, Part]]:
        for name, trial in trials.items():

            def on_share(share: float, length: float = duration_of(trial)) -> None:
                on_progress(share * length)

            yield name, reduce(trial, self.stand.record(trial, on_share))

    def _pooled(
        self, trials: Mapping[str, AnyTrial], reduce: Reduce[AnyTrial], on_progress: Any
    ) -> Iterator[tuple[str, Part]]:
        """Do the longest trials first; an error cancels those that wait."""
        assert self._pool is not None
        ordered = sorted(trials.items(), key=lambda named: -duration_of(named[1]))
        jobs = {name: (self.stand, trial, reduce) for name, trial in ordered}
        return done_by(self._pool, reduced, jobs)

    def _file(self, experiment: str, name: str, trial: AnyTrial, reduce: Reduce[AnyTrial]) -> Path:
        function = getattr(reduce, "func", reduce).__qualname__
        arguments = (getattr(reduce, "args", ()), getattr(reduce, "keywords", {}))
        stand = (self._fingerprint, self.stand.name, self.rate)
        made_of = repr((*stand, trial, function, arguments))
        digest = hashlib.sha256(made_of.encode()).hexdigest()[:12]
        return self.folder / "parts" / experiment / f"{name}-{digest}.npz"


def done_by(
    pool: Executor, work: Callable[..., Any], jobs: Mapping[Any, tuple]
) -> Iterator[tuple[Any, Any]]:
    """Do work with the arguments of each job; return names and results as they come.

    An error cancels the jobs that wait: the end of a pool waits for what is not cancelled.
    """
    futures = {pool.submit(work, *arguments): name for name, arguments in jobs.items()}
    try:
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        for future in futures:
            future.cancel()


def reduced(stand: Stand, trial: AnyTrial, reduce: Reduce[AnyTrial]) -> Part:
    """Do a trial and reduce its samples, in a worker process."""
    return reduce(trial, stand.record(trial, lambda share: None))


def _kept(file: Path) -> Part | None:
    try:
        with np.load(file) as arrays:
            return dict(arrays)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile):
        return None  # missing, or incomplete after an interruption


def _keep(file: Path, part: Part) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    unfinished = file.with_suffix(".unfinished")
    with unfinished.open("wb") as stream:
        np.savez(stream, **dict[str, Any](part))
    unfinished.replace(file)


def worker_pool(workers: int | None = None) -> ProcessPoolExecutor:
    """Return a pool of processes, by default one per available core.

    They ignore Ctrl-C: the parent handles it, waits for running trials and ends the pool.
    """
    count = workers or len(os.sched_getaffinity(0))
    return ProcessPoolExecutor(
        count, mp_context=multiprocessing.get_context("spawn"), initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_IGN),
    )  # fmt: skip
