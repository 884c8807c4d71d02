# SPDX-License-Identifier: Apache-2.0
"""Figures of `bench` from the amplifier's counters: latencies, shares, medians over runs.

All counters only increase; a figure of a window is the difference of two readings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median
from typing import NamedTuple

from screw_module_ros.safety.timing import quantile

SEPARATE, COMPOSED = "separate", "composed"
TIMING = ("p50", "p99", "p99.9", "late", "lost")
PARTS = ("answer p50", "answer p99", "own p50", "own p99")
PAGE = "page"
UNITS = {"late": "%", "lost": "%", PAGE: "1/s"}  # microseconds otherwise
WANTED: dict[tuple[str, int], dict[str, float]] = {
    (SEPARATE, 2000): {"p50": 200.0, "p99": 325.0, "late": 0.5, "lost": 0.1},
    (COMPOSED, 2000): {"p99": 60.0},
}
"""Of (processes, rate [Hz]) on two cores; latencies [us], shares [%]."""


class Counts(NamedTuple):
    """Readings of the counters at one time.

    latency: SYNC to drive write; answer: SYNC to reception of the encoder's answer; own: from
    reception of the input (separate: the command, composed: the samples) to the drive write; all
    histograms of safety/timing. late, lost: commands. processor: time used by each process [s].
    seconds: clock.
    """

    latency: list[int]
    answer: list[int]
    own: list[int]
    late: int
    lost: int
    processor: dict[str, float]
    seconds: float


class Case(NamedTuple):
    """What is measured: how the processes are cut, ticks per second, with or without a page."""

    processes: str
    rate: int
    page: bool = False

    @property
    def title(self) -> str:
        """Return the case without its rate, in words."""
        return f"{self.processes}, page" if self.page else self.processes


class Run(NamedTuple):
    """One run: figures by name, processor time by executable [% of a core], conditions.

    load: the machine's load average (1 min) before the start; enabled: torque passed throughout.
    """

    figures: dict[str, float]
    processor: dict[str, float]
    load: float
    enabled: bool


class Spread(NamedTuple):
    """A figure over several runs."""

    median: float
    low: float
    high: float


def figures(begin: Counts, end: Counts) -> dict[str, float]:
    """Return the figures of the window between two counts: latencies [us], shares [%].

    Raises ValueError if the window has no drive write.
    """
    latency = _difference(begin.latency, end.latency)
    written = sum(latency)
    if not written:
        raise ValueError("no command reached the drive")
    answer, own = _difference(begin.answer, end.answer), _difference(begin.own, end.own)
    late, lost = end.late - begin.late, end.lost - begin.lost
    ticks = written + lost
    return {
        "p50": quantile(latency, 0.5) * 1e6,
        "p99": quantile(latency, 0.99) * 1e6,
        "p99.9": quantile(latency, 0.999) * 1e6,
        "late": 100.0 * late / ticks,
        "lost": 100.0 * lost / ticks,
        "answer p50": quantile(answer, 0.5) * 1e6,
        "answer p99": quantile(answer, 0.99) * 1e6,
        "own p50": quantile(own, 0.5) * 1e6,
        "own p99": quantile(own, 0.99) * 1e6,
        "rate": written / (end.seconds - begin.seconds),
    }


def processor_shares(begin: Counts, end: Counts) -> dict[str, float]:
    """Return the processor time of each process [% of one core]."""
    elapsed = end.seconds - begin.seconds
    return {
        name: 100.0 * (end.processor[name] - used) / elapsed
        for name, used in begin.processor.items()
    }


def spreads(runs: Sequence[Mapping[str, float]]) -> dict[str, Spread]:
    """Return median, lowest and highest of each figure over runs."""
    found = {}
    for name in runs[0]:
        values = sorted(run[name] for run in runs)
        found[name] = Spread(median(values), values[0], values[-1])
    return found


def verdict(case: Case, figure: str, value: float) -> str:
    """Return `yes` or `MISSED` for a figure with a limit in this case, else an empty text."""
    wanted = WANTED.get((case.processes, case.rate), {}).get(figure)
    if wanted is None:
        return ""
    return "yes" if value <= wanted else "MISSED"


def _difference(begin: Sequence[int], end: Sequence[int]) -> list[int]:
    return [after - before for before, after in zip(begin, end, strict=True)]
