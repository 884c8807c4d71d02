# SPDX-License-Identifier: Apache-2.0
"""Weighs a patient's arm: empty cradle, arm strapped in, "let it hang" at three places.

::

    empty -> strap -> near -> far -> high -> back
                        `-- a guard refuses --^

The handle's transducer bears what hangs on the handle, and friction lies behind it, so that any law
that holds the handle will do. What it shows of the empty cradle is the zero of the weighing: what
the tare has drifted since costs nothing, and a tare with an arm on the handle is noticed. An arm
weighs more far out than near the body, hence three places. Slots lead the hand there, hold it, and
bring it back to where it was strapped in. They do not carry it down, nor while one follows another:
from the first place on it is supported with what was found so far.

It uses no clock: its course depends on the hand's samples and on who presses the button.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Generator, Sequence
from typing import Annotated, NamedTuple

from ..control.limits import clamp
from ..control.slot import Slot
from ..settings import Setting
from .hand import SPACE, HandSample, Point, distance, plausible
from .line import NO_SLOT, Line, slots

PLACES = ("near", "far", "high")
_AWAY, _UP = 0.6, 0.85  # shares of the workspace's half depth and height
_WAY = 3.0  # time of each way [s]; one value, so that the vertical slot of two places is the same
# All that follows is ours. The walls are the stiffest of a slot, so that an arm of 25 N hangs 5 cm
# below its place at most, with the friction of a mode that leaves it. They do not grow: then the
# hand would rise, by 4 mm/s, while it is weighed.
_GUIDE = Slot(
    back_stiffness=800.0, side_stiffness=800.0, damping=20.0, half_width=0.0, end_half_width=0.0,
    growth=0.0, duration=_WAY,
)  # fmt: skip
_EMPTY, _SETTLE, _HANG = 1.0, 1.5, 3.0  # of the empty cradle, of the arm at its place [s]
_ZERO, _OLDEST = 1.0, 1800.0  # that the empty cradle may show [N], for so long [s]
_REACH, _SPEED, _BLOCK = 0.06, 0.005, 0.5  # from the place [m]; of the hand [m/s], over [s]
_VARIES, _PULL = 0.7, 8.0  # standard deviation of the weight, force to a side [N]
_LIGHTEST, _HEAVIEST, _DIFFERS = 2.0, 25.0, 5.0  # arm; difference of its places [N]
_LEAST = 50.0  # samples a second from which a weight is judged
_NS = 1e-9


class WeighingSettings(NamedTuple):
    """What hangs on the handle beside the arm."""

    cradle: Annotated[
        float, Setting("weight of what is put on the handle with the arm, after the tare: not the "
                       "arm's", "N", 0.0, 15.0)
    ] = 0.0  # ours


def places(ranges: Sequence[tuple[float, float]]) -> list[Point]:
    """Return where the arm is weighed [m]: near, far, high, within the ranges of x, y, z [m]."""
    _, (_, depth), (low, high) = ranges
    middle, top = 0.5 * (low + high), low + _UP * (high - low)
    return [(0.0, -_AWAY * depth, middle), (0.0, _AWAY * depth, middle), (0.0, 0.0, top)]


class Weighing:
    """One dialogue, from the empty cradle to a weight, or to the sentence that refuses it.

    is_on: it goes on; waits: for the arm to be strapped in; wish: requested slots; support:
    requested, upward, and left to the arm when it is over [N]; told: what it waits for or has
    found, a sentence; result: mean of the places, and spread, largest less smallest [N]; None
    before the end, and when it was refused.
    """

    def __init__(self, where: Sequence[Point], cradle: float = 0.0):
        """Begin with the empty cradle.

        where: the arm is weighed, in the order of `PLACES` [m]; cradle: see `WeighingSettings` [N].
        """
        self.is_on, self.wish, self.support = True, NO_SLOT, 0.0
        self.told = "keep off the handle: the empty cradle is measured"
        self.result: tuple[float, float] | None = None
        self._where, self._cradle, self.waits = where, cradle, False
        self._left = ""  # why the hanging arm is brought back before the end
        self._course = self._dialogue()
        next(self._course)

    def press(self) -> None:
        """Go on once the arm is strapped in; while something is measured, end it."""
        if self.waits:
            self.waits = False
        else:
            self.leave("the therapist ended it")

    def leave(self, reason: str, at_once: bool = False) -> None:
        """End it, and bring back an arm that hangs, but where it must end at once."""
        told = f"not weighed: {reason}"
        if at_once or self.wish is NO_SLOT:
            self._end(told)
        self._left = self._left or told

    def _end(self, told: str) -> None:
        self.is_on, self.wish, self.told = False, NO_SLOT, told

    def take(self, sample: HandSample) -> None:
        """Process one sample; one with `stop` ends it as soon as the robot holds the arm."""
        if not self.is_on:
            return
        if not plausible(SPACE, sample) or not all(map(math.isfinite, sample.force)):
            self.leave("where the hand is, its speed or its force is not known", at_once=True)
        elif sample.stop and self.wish is not NO_SLOT:
            self.leave(sample.stop, at_once=True)
        else:
            try:
                self._course.send(sample)
            except StopIteration as over:
                self._end(over.value)

    def _dialogue(self) -> Generator[None, HandSample, str]:
        """Return what has come out, a sentence."""
        samples = yield from self._during(_EMPTY)
        zero, varies = _force_of(samples)
        shown = math.hypot(*zero)
        if shown > _ZERO or varies > _VARIES:
            return (
                f"not weighed: the empty cradle shows {shown:.1f} N ({_ZERO:g} N at most), varying "
                f"by {varies:.1f} N ({_VARIES:g} N at most): take everything off the handle; if "
                "that stays, tare the force sensor with the torque off; then weigh again"
            )
        self.told = "strap the arm in and lay it down, then press again and let it hang"
        strapped = yield from self._strapped()
        age = (strapped.time_ns - samples[-1].time_ns) * _NS
        if age > _OLDEST:
            return (
                f"not weighed: the empty cradle was measured {age / 60.0:.0f} min ago "
                f"({_OLDEST / 60.0:g} min at most): take the arm out, then weigh again"
            )
        last, result, end = yield from self._hung(strapped, zero)
        self.told = f"{end}; the arm is brought back"
        self._guide(last, strapped.position)
        while (passed := ((yield).time_ns - last.time_ns) * _NS) < _WAY + _SETTLE + _HANG:
            if passed >= _WAY + _SETTLE and result is None:
                self.support = 0.0  # not trusted, and it lies again where it lay without
        self.result = result
        return end

    def _strapped(self) -> Generator[None, HandSample, HandSample]:
        """Wait for the therapist, and until the robot can hold the arm; return that sample."""
        while True:
            self.waits = True
            while self.waits:
                sample = yield
            if not sample.stop:
                return sample
            self.told = f"the robot cannot hold the arm: {sample.stop}; mend that, then press again"

    def _hung(
        self, last: HandSample, zero: Point
    ) -> Generator[None, HandSample, tuple[HandSample, tuple[float, float] | None, str]]:
        """Weigh at all places; return the last sample, the result, and a sentence on it.

        zero: force of the empty cradle [N].
        """
        found: list[float] = []
        for name, place in zip(PLACES, self._where, strict=True):
            self.told = f"let it hang: {name}, {len(found) + 1} of {len(PLACES)}"
            self._guide(last, place)
            yield from self._during(_WAY + _SETTLE)
            samples = yield from self._during(_HANG)
            last = samples[-1]
            if self._left:
                return last, None, self._left
            if flaw := _flaw(samples, zero, name, place):
                return last, None, f"not weighed: {flaw}, then weigh again"
            found.append(zero[2] - _force_of(samples)[0][2] - self._cradle)
            self.support = clamp(statistics.fmean(found), 0.0, _HEAVIEST)
        return last, *_weighed(found)

    def _guide(self, sample: HandSample, to: Point) -> None:
        x, y, z = sample.position
        held = self.wish.vertical
        if held is not None and held.target_x == to[2]:
            z = held.start_x  # the same slot goes on, and does not fade
        self.wish = slots(Line((x, y, z), to, SPACE), _GUIDE, sample.time_ns)

    def _during(self, time: float) -> Generator[None, HandSample, list[HandSample]]:
        """Return the samples of a time [s], or until the arm is to be brought back."""
        samples = [(yield)]
        while (samples[-1].time_ns - samples[0].time_ns) * _NS < time and not self._left:
            samples.append((yield))
        return samples


def _flaw(samples: Sequence[HandSample], zero: Point, name: str, place: Point) -> str:
    """Return why what hung there is not the arm's weight, and what to do; else nothing."""
    force, varies = _force_of(samples)
    away, speed = distance(SPACE, samples[-1].position, place), _speed(samples)
    pull = max(abs(force[axis] - zero[axis]) for axis in (0, 1))
    guards = (
        (len(samples) < _LEAST * _HANG,
         f"{len(samples)} samples in {_HANG:g} s ({_LEAST * _HANG:g} at least): wait a moment"),
        (away > _REACH,
         f"the hand is {away * 1e3:.0f} mm from the place {name} ({_REACH * 1e3:g} mm at "
         "most): free its way, and choose a mode other than 0"),
        (varies >= _VARIES,
         f"the weight varies by {varies:.1f} N ({_VARIES:g} N at most), he helps or trembles: "
         "let him loosen the arm"),
        (speed >= _SPEED,
         f"the hand moves by {speed * 1e3:.0f} mm/s ({_SPEED * 1e3:g} mm/s at most): let it "
         "hang still"),
        (pull >= _PULL,
         f"the arm pulls by {pull:.1f} N to a side ({_PULL:g} N at most): stretch it slowly"),
    )  # fmt: skip
    return next((sentence for is_bad, sentence in guards if is_bad), "")


def _weighed(found: Sequence[float]) -> tuple[tuple[float, float] | None, str]:
    """Return the result of all places [N], None for one that cannot be, and a sentence on it."""
    weight, spread = statistics.fmean(found), max(found) - min(found)
    if not _LIGHTEST <= weight <= _HEAVIEST:
        return None, (
            f"not weighed: {weight:.1f} N hang on the handle (from {_LIGHTEST:g} to "
            f"{_HEAVIEST:g} N wanted): is the arm strapped in and loose, and nothing else on "
            "the handle? Then weigh again"
        )
    differs = f"; heavier far out: support the mean, expect ±{0.5 * spread:.1f} N"
    return (weight, spread), f"the arm weighs {weight:.1f} N{differs if spread >= _DIFFERS else ''}"


def _force_of(samples: Sequence[HandSample]) -> tuple[Point, float]:
    """Return the mean force and the standard deviation of the vertical one [N]."""
    x, y, z = (statistics.fmean(s.force[axis] for s in samples) for axis in (0, 1, 2))
    return (x, y, z), statistics.pstdev(s.fz for s in samples)


def _speed(samples: Sequence[HandSample]) -> float:
    """Return the largest mean speed over half a second [m/s].

    A sample's own speed shows single counts of the encoders, and a tremor, which has its guard.
    """
    first, speed = samples[0], 0.0
    for sample in samples:
        passed = (sample.time_ns - first.time_ns) * _NS
        if passed >= _BLOCK:
            speed = max(speed, distance(SPACE, sample.position, first.position) / passed)
            first = sample
    return speed
