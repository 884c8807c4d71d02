# SPDX-License-Identifier: Apache-2.0
"""Timing of a run, from the counters that the drive's node publishes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Timing(NamedTuple):
    """Commands to the vertical drive over one stretch of time.

    duration [s]; rate: commands written per second [1/s].
    commands: written; late: of these, written more than one period after their SYNC; lost: ticks
    without a command.
    p50, p99: latency SYNC -> drive write [s]: median over time of the percentiles of each second;
    worst_p99: largest p99 of a second [s].
    """

    duration: float
    rate: float
    commands: int
    late: int
    lost: int
    p50: float
    p99: float
    worst_p99: float

    @property
    def in_time(self) -> float:
        """Share of the ticks whose command was written within its deadline [0..1]."""
        ticks = self.commands + self.lost
        return (self.commands - self.late) / ticks if ticks else float("nan")


def timing(
    time_ns: np.ndarray,
    commands: np.ndarray,
    late: np.ndarray,
    lost: np.ndarray,
    p50: np.ndarray,
    p99: np.ndarray,
) -> Timing:
    """Evaluate states of the drive's node, in order of `time_ns` [ns].

    `commands`, `late`, `lost` count from the start of the node; `p50`, `p99` [s] are those of the
    second before each state. Raises ValueError for fewer than two states, or if a counter decreases
    because the node was restarted.
    """
    if len(time_ns) < 2:
        raise ValueError(f"{len(time_ns)} states of the drive's node: at least two are needed")
    counts = {"commands": commands, "late": late, "lost": lost}
    grown = {}
    for name, values in counts.items():
        if (np.diff(np.asarray(values, np.int64)) < 0).any():
            raise ValueError(f"the count of {name} decreases: the drive's node was restarted")
        grown[name] = int(values[-1]) - int(values[0])
    duration = (int(time_ns[-1]) - int(time_ns[0])) * 1e-9
    return Timing(
        duration=duration,
        rate=grown["commands"] / duration if duration > 0 else float("nan"),
        p50=float(np.median(p50)),
        p99=float(np.median(p99)),
        worst_p99=float(np.max(p99)),
        **grown,
    )
