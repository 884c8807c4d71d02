# SPDX-License-Identifier: Apache-2.0
"""From a trial's bag to evenly spaced samples; no ROS here.

Encoder, force sensor and force commands are three streams with the same tick numbers. They are
joined by tick. Lost ticks are interpolated up to a limit; above it the trial is invalid.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from screw_module_ros import graph
from screw_module_ros.identification.trials import Samples
from screw_module_ros.recording.decoded import columns, topics
from screw_module_ros.samples import FORCE_FAULT_MASK

LONGEST_GAP = 0.05  # [s] interpolated between two samples of a stream
LARGEST_LOSS = 0.05  # share of the ticks that may be missing
_FZ, _TZ = 2, 5  # columns of the wrench
_ROUND = 2**32  # tick numbers start again here
_FIELDS = {
    graph.ENCODER: ("encoder", "position", "velocity"),
    graph.FORCE: ("force sensor", "fx", "fy", "fz", "tx", "ty", "tz"),
    graph.FORCE_COMMAND: ("force command", "force"),
}
"""Names for messages, and the fields that are read."""


class SamplesLost(RuntimeError):
    """Too many samples are missing; the message names the stream and their share."""


class Window(NamedTuple):
    """A stretch of time, by the clock of the samples' acquisition [ns]."""

    begin_ns: float
    end_ns: float


class Stream(NamedTuple):
    """Samples of one topic: ticks since the origin, each once and rising; their times [ns]."""

    name: str
    ticks: np.ndarray
    at_ns: np.ndarray
    values: np.ndarray


class Recorded(NamedTuple):
    """The three streams of a bag, with ticks since the first encoder sample; rate: [1/s].

    encoder: position [m], velocity [m/s]; force: fx, fy, fz [N], tx, ty, tz [Nm], without the
    samples that have a fault of the sensor; command: [N].
    """

    rate: float
    encoder: Stream
    force: Stream
    command: Stream

    def tick_at(self, time_ns: float) -> int:
        """Return the first tick not before a time [ns]."""
        first, at_ns = self.encoder.ticks[0], self.encoder.at_ns[0]
        return int(first + np.ceil((time_ns - at_ns) * 1e-9 * self.rate - 1e-6))

    def zero(self, window: Window) -> tuple[float, np.ndarray]:
        """Return mean time [ns] and mean reading of the transducer. Raises SamplesLost."""
        at_ns = self.force.at_ns
        there = (at_ns >= window.begin_ns) & (at_ns < window.end_ns)
        if not there.any():
            raise SamplesLost("force sensor: not one good sample of the unloaded handle came")
        return float(at_ns[there].mean()), self.force.values[there].mean(axis=0)

    def samples(
        self, first: int, count: int, before: Window, after: Window,
        commands: Callable[[np.ndarray], np.ndarray] = np.zeros_like,
    ) -> Samples:  # fmt: skip
        """Return `count` ticks from `first` on, minus the straight line between the two zeros.

        before, after: when nothing acted on the transducer; commands: returns torque commands of
        the drive [Nm] for force commands [N]. Ticks have jitter: values are interpolated linearly
        to even times, so that a moving handle shows no false tremor; a command holds from its tick
        to the next. The current is not measured. Raises SamplesLost if a gap is longer than
        LONGEST_GAP or more than LARGEST_LOSS of the ticks are missing.
        """
        for stream in (self.encoder, self.force):
            _check_losses(stream, first, first + count, self.rate)
        grid, start_ns = np.arange(first, first + count), self.encoder.at_ns[0]
        when, force_when = (
            (stream.at_ns - start_ns) * 1e-9 * self.rate for stream in (self.encoder, self.force)
        )
        late = float(np.median(when - self.encoder.ticks))
        at_ns = start_ns + (grid + late) * 1e9 / self.rate
        (from_ns, low), (to_ns, high) = self.zero(before), self.zero(after)
        share = (at_ns - from_ns) / (to_ns - from_ns)
        position, velocity = (
            np.interp(grid + late, when, column) for column in self.encoder.values.T
        )
        force, torque = (
            np.interp(grid + late, force_when, self.force.values[:, column])
            - (low[column] + share * (high[column] - low[column]))
            for column in (_FZ, _TZ)
        )
        newest = np.searchsorted(self.command.ticks, grid, side="right")  # 0: none yet
        return Samples(
            np.arange(count) / self.rate, position, velocity, force, torque,
            commands(np.concatenate(([0.0], self.command.values[:, 0]))[newest]),
            np.full(count, np.nan),
        )  # fmt: skip


def recorded(
    bag: Path, rate: float, named: Callable[[str], str] = lambda topic: f"/{topic}"
) -> Recorded:
    """Read a trial's bag; named: returns a topic's name in it. Raises BagError, SamplesLost."""
    held = topics(bag)
    found = {
        topic: columns(bag, named(topic)) if named(topic) in held else {} for topic in _FIELDS
    }
    return joined(found, rate)


def joined(found: Mapping[str, Mapping[str, np.ndarray]], rate: float) -> Recorded:
    """Return the streams of the topics' fields, as arrays by name. Raises SamplesLost."""
    for topic in (graph.ENCODER, graph.FORCE):
        if not len(found[topic].get("sequence", ())):
            raise SamplesLost(f"{_FIELDS[topic][0]}: not one sample came")
    force, origin = found[graph.FORCE], int(found[graph.ENCODER]["sequence"][0])
    good = force["status"].astype(int) & FORCE_FAULT_MASK == 0
    good_force = {name: column[good] for name, column in force.items()}
    streams = (
        _stream(*names, found=good_force if topic == graph.FORCE else found[topic], origin=origin)
        for topic, names in _FIELDS.items()
    )
    return Recorded(rate, *streams)


def _stream(name: str, *fields: str, found: Mapping[str, np.ndarray], origin: int) -> Stream:
    if not len(found.get("sequence", ())):
        return Stream(name, np.empty(0, int), np.empty(0), np.empty((0, len(fields))))
    ticks = (found["sequence"].astype(np.int64) - origin + _ROUND // 2) % _ROUND - _ROUND // 2
    ticks, rows = np.unique(ticks, return_index=True)
    values = np.column_stack([found[field][rows] for field in fields])
    return Stream(name, ticks, found["monotonic_ns"][rows], values)


def _check_losses(stream: Stream, first: int, end: int, rate: float) -> None:
    there = stream.ticks[(stream.ticks >= first) & (stream.ticks < end)]
    gap = np.diff(there, prepend=first - 1, append=end).max() / rate
    share = 1.0 - len(there) / (end - first)
    if gap > LONGEST_GAP + 1.0 / rate or share > LARGEST_LOSS:
        raise SamplesLost(
            f"{stream.name}: {100 * share:.1f} % of the samples were lost, with a gap of "
            f"{1e3 * gap:.0f} ms; {100 * LARGEST_LOSS:g} % and {1e3 * LONGEST_GAP:g} ms are "
            "allowed: free the machine from other work, or run the graph at a lower rate"
        )
