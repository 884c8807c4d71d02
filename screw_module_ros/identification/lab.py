# SPDX-License-Identifier: Apache-2.0
"""The environment of an experiment: a bench, a folder with finished trials, a progress callback.

An experiment is `run(lab, settings) -> Result`. It gives the lab its jobs, each a trial and a
function that reduces the samples, and fits the reduced parts. A repeated run reuses the jobs that
were finished before an interruption.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from .results import Result, load_result
from .trials import Bench, Samples, Trial, duration_of


class HasName(Protocol):
    """An entry of a table of cases or curves."""

    name: str


Named = TypeVar("Named", bound=HasName)
Part = dict[str, np.ndarray]
"""The reduced samples of a trial: named arrays (scalars as arrays without dimension)."""


class Job(NamedTuple):
    """One trial and the function that reduces its samples.

    name: unique within the experiment, valid as a file name; reduce: a module-level function, or a
    `functools.partial` of one, so that it can be pickled for a worker process.
    """

    name: str
    trial: Trial
    reduce: Callable[[Trial, Samples], Part]

    @property
    def identity(self) -> str:
        """The inputs of the part, as text."""
        function = getattr(self.reduce, "func", self.reduce)
        arguments = (getattr(self.reduce, "args", ()), getattr(self.reduce, "keywords", {}))
        return repr((self.trial, function.__qualname__, arguments))


class MissingResult(RuntimeError):
    """The result of a prerequisite experiment is missing."""


Progress = Callable[[str, float, float], None]
"""Called with the experiment's name and the finished and total seconds of excitation [s]; may raise
`Cancelled`."""


class Lab:
    """A bench, a folder, and a progress callback.

    folder: of parts and results; parts of another bench, fingerprint or setting are not reused.
    Raises OSError if the folder cannot be made.
    """

    def __init__(
        self,
        bench: Bench,
        folder: Path,
        progress: Progress = lambda doing, done, total: None,
        fingerprint: str = "",
    ):
        self.bench = bench
        self.folder = Path(folder)
        self.progress = progress
        self._fingerprint = fingerprint
        self.folder.mkdir(parents=True, exist_ok=True)

    @property
    def rate(self) -> float:
        """Samples per second of the bench [1/s]."""
        return self.bench.rate

    def run(self, experiment: str, jobs: Sequence[Job]) -> dict[str, Part]:
        """Do the jobs without a stored part; return the parts of all jobs by name.

        Raises Cancelled, NotPossible; finished parts stay stored.
        """
        total = sum(duration_of(job.trial) for job in jobs)
        parts: dict[str, Part] = {}
        done = 0.0
        waiting = []
        for job in jobs:
            part = self._kept(experiment, job)
            if part is None:
                waiting.append(job)
            else:
                parts[job.name] = part
                done += duration_of(job.trial)
        self.progress(experiment, done, total)
        for job, part in self._done(experiment, waiting, done, total):
            self._keep(experiment, job, part)
            parts[job.name] = part
        return {job.name: parts[job.name] for job in jobs}

    def _done(self, experiment: str, jobs: Sequence[Job], done: float, total: float):
        """Yield each job with its part, one after the other."""
        for job in jobs:
            length = duration_of(job.trial)

            def on_progress(share: float, before: float = done, length: float = length) -> None:
                self.progress(experiment, before + share * length, total)

            yield job, job.reduce(job.trial, self.bench.record(job.trial, on_progress))
            done += length
            self.progress(experiment, done, total)

    def result(self, experiment: str) -> Result:
        """Return the stored result of an experiment. Raises MissingResult that names it."""
        try:
            return load_result(self.folder, experiment)
        except FileNotFoundError:
            raise MissingResult(
                f"the result of {experiment} is missing in {self.folder}: run {experiment} first"
            ) from None

    def _kept(self, experiment: str, job: Job) -> Part | None:
        try:
            with np.load(self._file(experiment, job)) as arrays:
                return dict(arrays)
        except (OSError, ValueError, EOFError, zipfile.BadZipFile):
            return None  # missing, or incomplete after an interruption

    def _keep(self, experiment: str, job: Job, part: Part) -> None:
        file = self._file(experiment, job)
        file.parent.mkdir(parents=True, exist_ok=True)
        unfinished = file.with_suffix(".unfinished")
        with unfinished.open("wb") as stream:
            np.savez(stream, **part)
        unfinished.replace(file)

    def _file(self, experiment: str, job: Job) -> Path:
        made_of = repr((self._fingerprint, self.bench.name, self.rate, job.identity))
        digest = hashlib.sha256(made_of.encode()).hexdigest()[:12]
        return self.folder / "parts" / experiment / f"{job.name}-{digest}.npz"


def by_name(what: str, known: Sequence[Named], name: str) -> Named:
    """Return the one with this name. Raises ValueError with `what` and the known names."""
    for one in known:
        if one.name == name:
            return one
    names = ", ".join(one.name for one in known)
    raise ValueError(f"{what}: {name!r} is unknown; known are {names}")
