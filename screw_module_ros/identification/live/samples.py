# SPDX-License-Identifier: Apache-2.0
"""Recordings of the live bench, and their conversion to evenly spaced samples; no ROS here.

Encoder, force sensor and force commands are three streams with the same tick numbers. They are
recorded on arrival and joined by tick afterwards. Lost ticks are interpolated up to a limit; above
it the trial is invalid.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from screw_module_ros.identification.trials import Samples
from screw_module_ros.samples import FORCE_FAULT_MASK

LONGEST_GAP = 0.05  # [s] interpolated between two samples of a stream
LARGEST_LOSS = 0.05  # share of the ticks that may be missing
_FZ, _TZ = 2, 5  # columns
_ROUND = 2**32  # tick numbers start again here


class SamplesLost(RuntimeError):
    """Too many samples are missing; the message names the stream and their share."""


class Stream:
    """Room for the samples of one stream: tick number, acquisition [ns], values."""

    def __init__(self, name: str, room: int, width: int):
        self.name = name
        self.count = 0
        self._sequence = np.zeros(room, np.int64)
        self._stamp = np.zeros(room, np.int64)
        self._values = np.zeros((room, width))

    def add(self, sequence: int, monotonic_ns: int, *values: float) -> None:
        """Note a sample; one that finds no room is dropped."""
        row = self.count
        if row < len(self._sequence):
            self._sequence[row] = sequence
            self._stamp[row] = monotonic_ns
            self._values[row] = values
            self.count = row + 1  # last: another thread reads the rows below it

    @property
    def values(self) -> np.ndarray:
        """What was noted, one row a sample."""
        return self._values[: self.count]

    @property
    def middle_ns(self) -> float:
        """Mean time of acquisition [ns]."""
        return float(self._stamp[: self.count].mean())

    def by_tick(self, origin: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return ticks since `origin` in rising order, each once, with their stamps and values."""
        ticks = (self._sequence[: self.count] - origin + _ROUND // 2) % _ROUND - _ROUND // 2
        ticks, rows = np.unique(ticks, return_index=True)
        return ticks, self._stamp[rows], self._values[rows]

    def origin(self) -> int:
        """Return the number of the first tick. Raises SamplesLost without any."""
        if not self.count:
            raise SamplesLost(f"{self.name}: not one sample came")
        return int(self._sequence[0])


class Recording:
    """Room for `ticks` encoder samples and what belongs to them.

    encoder: position [m], velocity [m/s]; force: fx, fy, fz [N], tx, ty, tz [Nm]; command: force
    command [N] for the encoder sample of the same number; mark: first tick of the excitation, None
    before.
    """

    def __init__(self, ticks: int):
        self.wanted = ticks
        self.mark: int | None = None
        self.encoder = Stream("encoder", ticks, 2)
        # Each lost encoder sample adds a tick to the trial.
        room = round(ticks * (1.0 + 2.0 * LARGEST_LOSS)) + 10
        self.force = Stream("force sensor", room, 6)
        self.command = Stream("force command", room, 1)

    @property
    def full(self) -> bool:
        """Whether there is room for no more."""
        return self.encoder.count >= self.wanted

    def begins(self, tick: int) -> None:
        """Note the tick the excitation begins with."""
        self.mark = tick

    def note_encoder(self, sample: Any) -> None:
        """Take an EncoderSample."""
        self.encoder.add(sample.sequence, sample.monotonic_ns, sample.position, sample.velocity)

    def note_force(self, sample: Any) -> None:
        """Take a ForceSample; one with a fault of the sensor counts as lost."""
        s = sample
        if not s.status & FORCE_FAULT_MASK:
            self.force.add(s.sequence, s.monotonic_ns, s.fx, s.fy, s.fz, s.tx, s.ty, s.tz)

    def note_command(self, command: Any) -> None:
        """Take a ForceCommand."""
        self.command.add(command.sequence, command.monotonic_ns, command.force)


class Track(NamedTuple):
    """A recording at every tick: number and acquisition [ns] of the first, arrays of each."""

    begin: int
    begin_ns: float
    position: np.ndarray
    velocity: np.ndarray
    force: np.ndarray
    torque: np.ndarray
    command: np.ndarray

    def cut(self, begin: int, end: int, rate: float) -> Track:
        """Return the rows from `begin` up to `end`; rate [1/s]."""
        arrays = (array[begin:end] for array in self[2:])
        first = (self.begin + begin) % _ROUND
        return Track(first, self.begin_ns + begin * 1e9 / rate, *arrays)

    def row_of(self, tick: int) -> int:
        """Return the row of a tick number."""
        return (tick - self.begin + _ROUND // 2) % _ROUND - _ROUND // 2

    def row_at(self, time_ns: float, rate: float) -> int:
        """Return the first row not before a time of the clock [ns]."""
        return min(max(0, int(np.ceil((time_ns - self.begin_ns) * 1e-9 * rate))), len(self.force))


class Zero(NamedTuple):
    """Transducer with nothing acting on it: when [ns], forces [N] and torques [Nm], x to z."""

    at_ns: float
    wrench: tuple[float, ...]


def evenly(recording: Recording, rate: float) -> Track:
    """Return the recording at every tick of `rate` [1/s] that both sensors cover.

    Ticks have jitter: values are interpolated linearly to even times, so that a moving handle shows
    no false tremor; a force command holds from its tick to the next. Raises SamplesLost if a gap is
    longer than LONGEST_GAP or more than LARGEST_LOSS of the ticks are missing.
    """
    origin = recording.encoder.origin()
    recording.force.origin()
    ticks, stamps, encoder = recording.encoder.by_tick(origin)
    force_ticks, force_stamps, force = recording.force.by_tick(origin)
    first, last = max(ticks[0], force_ticks[0]), min(ticks[-1], force_ticks[-1])
    if last <= first:
        raise SamplesLost("encoder and force sensor have no common interval")
    quiet = max(first - ticks[0], ticks[-1] - last) / rate
    if quiet > LONGEST_GAP:  # else the trial would be a shorter one than was asked for
        raise SamplesLost(
            f"force sensor: no good sample in {1e3 * quiet:.0f} ms at an end of the recording; "
            f"{1e3 * LONGEST_GAP:g} ms are allowed: see its diagnostics"
        )
    for name, there in (("encoder", ticks), ("force sensor", force_ticks)):
        _check_losses(name, there[(there >= first) & (there <= last)], rate)
    grid, start_ns = np.arange(first, last + 1), stamps[0]
    when, force_when = ((s - start_ns) * 1e-9 * rate for s in (stamps, force_stamps))  # in ticks
    late = float(np.median(when - ticks))
    return Track(
        int(origin + first) % _ROUND,
        float(start_ns + (first + late) * 1e9 / rate),
        *(np.interp(grid + late, when, column) for column in encoder.T),
        np.interp(grid + late, force_when, force[:, _FZ]),
        np.interp(grid + late, force_when, force[:, _TZ]),
        _held(recording.command, origin, grid),
    )


def _check_losses(name: str, ticks: np.ndarray, rate: float) -> None:
    expected = ticks[-1] - ticks[0] + 1
    gap, share = np.diff(ticks).max(initial=1) / rate, 1.0 - len(ticks) / expected
    if gap > LONGEST_GAP + 1.0 / rate or share > LARGEST_LOSS:
        raise SamplesLost(
            f"{name}: {100 * share:.1f} % of the samples were lost, with a gap of {1e3 * gap:.0f} "
            f"ms; {100 * LARGEST_LOSS:g} % and {1e3 * LONGEST_GAP:g} ms are allowed: free the "
            "machine from other work, or run the graph at a lower rate"
        )


def _held(command: Stream, origin: int, grid: np.ndarray) -> np.ndarray:
    """Return the newest command at each tick, 0 before the first."""
    if not command.count:
        return np.zeros(len(grid))
    ticks, _, values = command.by_tick(origin)
    newest = np.searchsorted(ticks, grid, side="right") - 1
    return np.where(newest >= 0, values[np.maximum(newest, 0), 0], 0.0)


def zero_of(recording: Recording) -> Zero:
    """Return the mean reading of the transducer. Raises SamplesLost without samples."""
    recording.force.origin()
    mean = recording.force.values.mean(axis=0)
    return Zero(recording.force.middle_ns, tuple(mean.tolist()))


def samples_of(track: Track, rate: float, before: Zero, after: Zero) -> Samples:
    """Return the samples of a trial minus the straight line between the two zeros.

    `command` is unchanged; the current is not measured.
    """
    time = np.arange(len(track.position)) / rate
    share = (track.begin_ns - before.at_ns + time * 1e9) / (after.at_ns - before.at_ns)
    return Samples(
        time,
        track.position,
        track.velocity,
        track.force - _between(before, after, share, _FZ),
        track.torque - _between(before, after, share, _TZ),
        track.command,
        np.full(len(time), np.nan),
    )


def _between(before: Zero, after: Zero, share: np.ndarray, column: int) -> np.ndarray:
    return before.wrench[column] + share * (after.wrench[column] - before.wrench[column])
