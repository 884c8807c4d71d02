# SPDX-License-Identifier: Apache-2.0
"""Plausibility of the vertical axis's samples and commands: in doubt the force is zero.

Until the first sample the watch waits. A stream that stops, or a sample that cannot be real, is a
fault: it stays latched until `reset`, whatever comes after. Samples may be the drivers' readings or
the messages made of them; both have the same field names.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple, Protocol

from ..samples import FORCE_FAULT_MASK, FORCE_STATUS_BITS
from ..settings import Setting
from .stream import Stream

_COUNT = 1e-6  # [m], a little more than the resolution of the encoder


class WatchSettings(NamedTuple):
    """Bounds of plausible samples.

    The motor's peak force of 528 N accelerates 5.5 kg with 96 m/s^2, and a hard end stop brakes
    with about 200 m/s^2 (0.5 m/s against 1e6 N/m): a jump is a change above that.
    """

    stale_periods: Annotated[
        float, Setting("age of the newest sample that latches a fault", "periods", 2.0, 1000.0)
    ] = 5.0
    lowest: Annotated[float, Setting("lowest position", "m", -1.0, 1.0)] = -0.01
    highest: Annotated[float, Setting("highest position", "m", -1.0, 1.0)] = 0.37
    speed: Annotated[float, Setting("fastest speed", "m/s", 0.05, 3.0)] = 1.0
    acceleration: Annotated[
        float, Setting("acceleration that no motor can make", "m/s^2", 10.0, 1e5)
    ] = 300.0
    force: Annotated[float, Setting("largest force on the handle", "N", 1.0, 1000.0)] = 150.0
    force_required: Annotated[bool, Setting("a force sensor must be there")] = True


class EncoderLike(Protocol):
    """An EncoderReading or an EncoderSample message."""

    sequence: int
    monotonic_ns: int
    position: float
    velocity: float
    homed: bool


class ForceLike(Protocol):
    """A ForceReading or a ForceSample message."""

    sequence: int
    monotonic_ns: int
    fx: float
    fy: float
    fz: float
    tx: float
    ty: float
    tz: float
    status: int


class VerticalWatch:
    """Checks encoder and force samples of one controller; all times are passed in."""

    def __init__(self, settings: WatchSettings, period_ns: int):
        """Start without samples; period_ns is the period of both streams [ns]."""
        self._settings = settings
        self._period_ns = period_ns
        self._stale_ns = int(settings.stale_periods * period_ns)
        self._encoder = Stream("encoder", period_ns)
        self._force = Stream("force sensor", period_ns)
        self._motion: tuple[int, float] | None = None  # stamp [ns] and position [m] of the last one
        self._raw_speed: float | None = None
        self._homed = False
        self._fault = ""

    @property
    def fault(self) -> str:
        """Return the latched reason, empty when nothing is latched."""
        return self._fault

    @property
    def feels(self) -> bool:
        """Whether there was a force sample; its age is watched from then on."""
        return self._force.seen

    def encoder(self, sample: EncoderLike, now_ns: int) -> bool:
        """Check an encoder sample at now_ns [ns]; return whether the controller may use it.

        Repeated and out-of-order samples are not used.
        """
        if not self._encoder.accept(sample.sequence, sample.monotonic_ns, now_ns):
            self._latch(self._encoder.fault)
            return False
        if not (math.isfinite(sample.position) and math.isfinite(sample.velocity)):
            self._latch("encoder: position or velocity is not a finite number")
            return False
        if self._homed and not sample.homed:
            self._latch("encoder: lost its home position")
        if sample.homed and not self._homed:
            self._motion = self._raw_speed = None  # homing moves the origin
        self._homed = sample.homed
        self._check_place(sample)
        self._check_jump(sample)
        return True

    def force(self, sample: ForceLike, now_ns: int) -> bool:
        """Check a force sample at now_ns [ns]; return whether the controller may use it."""
        if not self._force.accept(sample.sequence, sample.monotonic_ns, now_ns):
            self._latch(self._force.fault)
            return False
        fx, fy, fz = sample.fx, sample.fy, sample.fz
        if not math.isfinite(fx + fy + fz + sample.tx + sample.ty + sample.tz):
            self._latch("force sensor: a force or torque is not a finite number")
            return False
        faults = sample.status & FORCE_FAULT_MASK
        if faults:
            bit = (faults & -faults).bit_length() - 1
            self._latch(f"force sensor: {FORCE_STATUS_BITS[bit]} (status bit {bit})")
        limit = self._settings.force
        if fx * fx + fy * fy + fz * fz > limit * limit:
            size = math.sqrt(fx * fx + fy * fy + fz * fz)
            self._latch(f"force sensor: {size:.4g} N on the handle, more than {limit:g} N")
        return True

    def check(self, now_ns: int) -> str | None:
        """Return why the force must be zero at now_ns [ns], or None; call before every command."""
        if self._fault:
            return self._fault
        if not self._encoder.seen:
            return "encoder: no sample yet"
        if self._settings.force_required and not self._force.seen:
            return "force sensor: no sample yet"
        self._encoder.check_age(now_ns, self._stale_ns)
        if self._settings.force_required or self._force.seen:
            self._force.check_age(now_ns, self._stale_ns)
        self._latch(self._encoder.fault or self._force.fault)
        return self._fault or (None if self._homed else "encoder: not homed")

    def reset(self, now_ns: int) -> str | None:
        """Clear the latched fault; return why the force still stays at zero, or None.

        A cause that persists latches again at once.
        """
        self._fault = ""
        self._motion = self._raw_speed = None
        self._encoder.reset()
        self._force.reset()
        return self.check(now_ns)

    def _latch(self, reason: str) -> None:
        """Keep the first reason; later ones usually follow from it."""
        self._fault = self._fault or reason

    def _check_place(self, sample: EncoderLike) -> None:
        """Latch a fault on a speed or a position beyond the bounds."""
        bounds = self._settings
        if abs(sample.velocity) > bounds.speed:
            self._latch(f"encoder: {sample.velocity:.3g} m/s, faster than {bounds.speed:g} m/s")
        if sample.homed and not bounds.lowest <= sample.position <= bounds.highest:
            self._latch(f"encoder: {sample.position:.4g} m lies outside the travel")

    def _check_jump(self, sample: EncoderLike) -> None:
        """Latch a fault on a gap and on a change of speed that no motor can make."""
        last, self._motion = self._motion, (sample.monotonic_ns, sample.position)
        if last is None:
            return
        elapsed_ns = sample.monotonic_ns - last[0]
        if elapsed_ns > self._stale_ns:
            self._latch(f"encoder: a gap of {elapsed_ns / 1e6:.1f} ms between samples")
        elapsed = elapsed_ns * 1e-9
        speed = (sample.position - last[1]) / elapsed
        before, self._raw_speed = self._raw_speed, speed
        if before is None:
            return
        change = self._settings.acceleration * max(elapsed, self._period_ns * 1e-9)
        if abs(speed - before) > change + 2.0 * _COUNT / elapsed:
            jump = (speed - before) * elapsed * 1e3
            self._latch(f"encoder: jumped by {jump:.4g} mm, more than any motor can move it")


class CommandWatch:
    """Checks order, stamp and size of the force commands; all times are passed in.

    The amplifier does not trust the controller: it accepts a command only when it is new, finite
    and within the range of this robot's controllers. `gate` checks the age of the command.
    """

    def __init__(self, period_ns: int, largest_force: float):
        """Start without a command: period of the commands [ns], largest plausible force [N]."""
        self._stream = Stream("force command", period_ns)
        self._largest = largest_force
        self._fault = ""

    @property
    def fault(self) -> str:
        """Return the latched reason, empty when nothing is latched."""
        return self._fault

    @property
    def newest_ns(self) -> int:
        """Return the acquisition time [ns] behind the newest command; 0 = none yet."""
        return self._stream.monotonic_ns if self._stream.seen else 0

    def accept(self, sequence: int, monotonic_ns: int, force: float, now_ns: int) -> bool:
        """Return whether to accept the command received at now_ns [ns], force [N]."""
        newer = self._stream.accept(sequence, monotonic_ns, now_ns)
        self._fault = self._fault or self._stream.fault  # also of one that is newer
        if not newer:
            return False
        if not abs(force) <= self._largest:
            self._fault = self._fault or (
                f"force command: {force:g} N, beyond anything a controller may ask"
            )
            return False
        return True

    def reset(self) -> None:
        """Forget the latched fault."""
        self._fault = ""
        self._stream.reset()
