# SPDX-License-Identifier: Apache-2.0
"""What is judged: samples, commands, joints. The same rule wherever a sample arrives.

Each check returns a sentence that names what is wrong, empty if nothing is, or sets it into the
`Latch` of its owner, where it stays until a reset. Samples may be the drivers' readings or the
messages made of them; both have the same field names. `permit.CONDITIONS` says what follows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

from ..samples import (
    FORCE_FAULT_MASK,
    FORCE_STATUS_BITS,
    EncoderReading,
    ForceReading,
    sequence_gap,
)
from ..settings import Setting
from .latch import Latch

LARGEST_COMMAND = 150.0
"""Largest force command of any controller of this robot [N]."""
HOME_AGAIN = "bring the nut to its mark and call encoder/home"
_COUNT = 1e-6  # [m], a little more than the resolution of the encoder
# A leaky bucket: every sample fills it, accepted or not, and time empties it a little faster than a
# single sender can fill it. If it holds more than a burst of late samples, another sender exists,
# whatever its rate.
_BURST = 10.0
_DRAIN = 1.02
_SKEW = 0.04  # [s] largest age of the slower position; a state at 100 Hz is up to 25 ms old


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


class AgreementSettings(NamedTuple):
    """How far and how long encoder and drive may differ."""

    tolerance: Annotated[float, Setting("difference allowed at rest", "m", 1e-5, 0.1)] = 0.002
    duration: Annotated[float, Setting("how long more is tolerated", "s", 0.0, 10.0)] = 0.05


class FreezeSettings(NamedTuple):
    """When the position of a joint that does not move counts as frozen.

    3 Nm are 6 to 7 N at the handle; the joints' friction is 0.3 Nm in the simulation (ours), an
    error of 4 N of the force sensor makes 2 Nm. A net torque of 3 Nm moves a joint with the
    module's 1.3 kg m2 by a count of 0.1 mrad in 9 ms.
    """

    torque: Annotated[
        float, Setting("net torque on a joint that must move it", "Nm", 0.5, 100.0)
    ] = 3.0
    time: Annotated[
        float, Setting("such torque without a change of count means a frozen position, 0 = off",
                       "s", 0.0, 10.0)
    ] = 0.1


class Stream:
    """One stream of samples that are numbered by their ticks: which of them are new.

    name: every reason begins with it. period_ns: of the samples [ns]. numbered: each tick has a
    sample, so its number must be the tick's. seen: a sample was accepted; monotonic_ns: acquisition
    of the newest [ns]. Reasons against the stream as a whole go into the latch.
    """

    def __init__(self, name: str, period_ns: int, latch: Latch, numbered: bool = True):
        self.name = name
        self.seen = False
        self.monotonic_ns = 0
        self._latch = latch
        self._period_ns, self._numbered = period_ns, numbered
        self._held, self._seen_ns = 0.0, 0

    def accept(self, sequence: int, monotonic_ns: int, now_ns: int) -> bool:
        """Note a sample received at now_ns [ns]; return whether it is newer than all before."""
        self._count(now_ns)
        if not 0 < monotonic_ns <= now_ns + self._period_ns:
            # A future stamp would stay fresh for ever.
            self._latch.set(f"{self.name}: a sample is stamped in the future, or with no time")
            return False
        # A tick's number is its time over the period; a late wake-up may belong to the next one.
        off = sequence_gap(monotonic_ns // self._period_ns, sequence) + 1
        if self._numbered and not -1 <= off <= 1:
            self._latch.set(
                f"{self.name}: ticks at {sequence * 1e9 / monotonic_ns:.0f} Hz by the numbers of "
                f"its samples, this node at {1e9 / self._period_ns:.0f} Hz: give encoder, "
                "force_sensor, impedance_controller and amplifier one `rate`; or is a second node "
                "sending?"
            )
            return False
        if self.seen and monotonic_ns <= self.monotonic_ns:
            return False
        self.seen, self.monotonic_ns = True, monotonic_ns
        return True

    def _count(self, now_ns: int) -> None:
        """Latch a fault when samples come faster than their period lets one node send them."""
        elapsed = max(0, now_ns - self._seen_ns) / self._period_ns
        self._seen_ns = now_ns
        self._held = max(0.0, self._held - _DRAIN * elapsed) + 1.0
        if self._held > _BURST:
            self._latch.set(
                f"{self.name}: more samples than one each {self._period_ns / 1e6:g} ms; is a "
                "second node sending, or one with another rate?"
            )

    def check_age(self, now_ns: int, largest_ns: int) -> None:
        """Latch a fault when the newest sample is older than largest_ns at now_ns [ns]."""
        age_ns = now_ns - self.monotonic_ns
        if age_ns > largest_ns:
            self._latch.set(f"{self.name}: no sample for {age_ns / 1e6:.1f} ms")

    def restart(self) -> None:
        """Count anew how fast samples come. The time of the newest sample stays."""
        self._held = 0.0


@dataclass(slots=True)
class Motion:
    """What `encoder_flaw` remembers of the samples before.

    monotonic_ns, position [m]: of the last one, None after a reset; speed: between the last two
    [m/s]; homed, homings: of the last one. home_doubt: why its home cannot be trusted, until the
    next homing.
    """

    monotonic_ns: int | None = None
    position: float = 0.0
    speed: float | None = None
    homed: bool = False
    homings: int = 0
    home_doubt: str = ""

    def restart(self) -> None:
        """Expect nothing of the next sample's place: after a reset, and after a homing."""
        self.monotonic_ns = self.speed = None


def encoder_flaw(
    bounds: WatchSettings, motion: Motion, sample: EncoderReading, period_ns: int
) -> str:
    """Return why a new encoder sample cannot be real: lost home, too fast, out of travel, a jump.

    motion: is brought up to date. period_ns: of the samples [ns].
    """
    if not is_measured(sample):
        return "encoder: position or velocity is not a finite number"
    lost = motion.homed and not sample.homed
    if sample.homings != motion.homings:
        motion.restart()  # homing moves the origin
        motion.homings, motion.home_doubt = sample.homings, ""
    motion.homed = sample.homed
    jump = _jump(bounds, motion, sample, period_ns)
    if lost:
        return "encoder: lost its home position"
    if abs(sample.velocity) > bounds.speed:
        return f"encoder: {sample.velocity:.3g} m/s, faster than {bounds.speed:g} m/s"
    if sample.homed and not bounds.lowest <= sample.position <= bounds.highest:
        return f"encoder: {sample.position:.4g} m lies outside the travel"
    return jump


def is_measured(sample: EncoderReading) -> bool:
    """Return whether position and velocity of a sample are finite numbers."""
    return math.isfinite(sample.position) and math.isfinite(sample.velocity)


def _jump(bounds: WatchSettings, motion: Motion, sample: EncoderReading, period_ns: int) -> str:
    """Return a gap between samples, or a change of speed that no motor can make."""
    last_ns, last = motion.monotonic_ns, motion.position
    motion.monotonic_ns, motion.position = sample.monotonic_ns, sample.position
    if last_ns is None:
        return ""
    elapsed_ns = sample.monotonic_ns - last_ns
    elapsed = elapsed_ns * 1e-9
    before, motion.speed = motion.speed, (sample.position - last) / elapsed
    if elapsed_ns > int(bounds.stale_periods * period_ns):
        return f"encoder: a gap of {elapsed_ns / 1e6:.1f} ms between samples"
    if before is None:
        return ""
    change = bounds.acceleration * max(elapsed, period_ns * 1e-9)
    if abs(motion.speed - before) <= change + 2.0 * _COUNT / elapsed:
        return ""
    jump = (motion.speed - before) * elapsed * 1e3
    motion.home_doubt = (
        f"encoder: jumped by {jump:.4g} mm, more than any motor can move it; {HOME_AGAIN}"
    )
    return motion.home_doubt


def force_flaw(sample: ForceReading, size: float, largest: float) -> str:
    """Return why a force sample must not be used, or stops the robot.

    size: of the force on the axes that are judged; largest: what stops them, both [N].
    """
    if not is_finite(sample):
        return "force sensor: a force or torque is not a finite number"
    if fault := status_problem(sample.status):
        return fault
    if size > largest:
        return f"force sensor: {size:.4g} N on the handle, more than {largest:g} N"
    return ""


def is_finite(sample: ForceReading) -> bool:
    """Return whether every force and torque of a sample is a finite number."""
    return math.isfinite(sample.fx + sample.fy + sample.fz + sample.tx + sample.ty + sample.tz)


def status_problem(status: int) -> str:
    """Return the first fault in the force sensor's status word (ATI NETCANOEM)."""
    faults = status & FORCE_FAULT_MASK
    if not faults:
        return ""
    bit = (faults & -faults).bit_length() - 1
    return f"force sensor: {FORCE_STATUS_BITS[bit]} (status bit {bit})"


def command_flaw(force: float) -> str:
    """Return why no controller of this robot can have sent a force command [N]."""
    if abs(force) <= LARGEST_COMMAND:
        return ""
    return f"force command: {force:g} N, beyond anything a controller may ask"


class VerticalChecks:
    """Encoder and force samples of one controller; all times are passed in [ns].

    Until the first sample it waits. A stream that stops, or a sample that cannot be real, is
    latched in `fault` until `reset`, whatever comes after.
    """

    def __init__(self, settings: WatchSettings, period_ns: int):
        """Start without samples; period_ns is the period of both streams."""
        self.fault = Latch()
        self._settings = settings
        self._period_ns = period_ns
        self._stale_ns = int(settings.stale_periods * period_ns)
        self._encoder = Stream("encoder", period_ns, self.fault)
        self._force = Stream("force sensor", period_ns, self.fault)
        self._motion = Motion()

    @property
    def force_seen(self) -> bool:
        """Whether there was a force sample; its age is watched from then on."""
        return self._force.seen

    @property
    def home_in_doubt(self) -> bool:
        """Whether the encoder jumped or slipped, and no homing has come since."""
        return bool(self._motion.home_doubt)

    def encoder(self, sample: EncoderReading, now_ns: int) -> bool:
        """Check an encoder sample; return whether the controller may use it."""
        if not self._encoder.accept(sample.sequence, sample.monotonic_ns, now_ns):
            return False
        self.fault.set(encoder_flaw(self._settings, self._motion, sample, self._period_ns))
        return is_measured(sample)

    def force(self, sample: ForceReading, now_ns: int) -> bool:
        """Check a force sample; return whether the controller may use it."""
        if not self._force.accept(sample.sequence, sample.monotonic_ns, now_ns):
            return False
        fx, fy, fz = sample.fx, sample.fy, sample.fz
        size = math.sqrt(fx * fx + fy * fy + fz * fz)
        self.fault.set(force_flaw(sample, size, self._settings.force))
        return is_finite(sample)

    def check(self, now_ns: int) -> str:
        """Return why the force must be zero at now_ns; call before every command."""
        if self.fault.reason:
            return self.fault.reason
        if not self._encoder.seen:
            return "encoder: no sample yet"
        required = self._settings.force_required
        if required and not self._force.seen:
            return "force sensor: no sample yet"
        self._encoder.check_age(now_ns, self._stale_ns)
        if required or self._force.seen:
            self._force.check_age(now_ns, self._stale_ns)
        motion = self._motion
        return self.fault.reason or (motion.home_doubt if motion.homed else "encoder: not homed")

    def doubt_home(self, why: str) -> None:
        """Latch a reason that a homing must follow; no `reset` replaces it."""
        self._motion.home_doubt = self._motion.home_doubt or why
        self.fault.set(why)

    def reset(self, now_ns: int) -> str:
        """Clear the latched fault; return why the force still stays at zero.

        A cause that persists latches again at once.
        """
        self.fault.clear()
        self._motion.restart()
        self._encoder.restart()
        self._force.restart()
        return self.check(now_ns)


class Agreement:
    """Compares two measurements of one motion: the encoder, and the position the drive reports.

    A frozen or slipping encoder alone looks plausible, but the spring then pulls with a constant
    force and without damping. The drive's position (CiA 402 object 6064) has no home, so only the
    change of the difference counts. If the two nodes describe different screws, the positions
    diverge in proportion to the travel; the message then names the parameters.
    """

    def __init__(self, settings: AgreementSettings):
        """Start without a reference."""
        self._settings = settings
        self._reference: tuple[float, float] | None = None  # encoder and drive at the start [m]
        self._apart_since_ns: int | None = None

    def restart(self) -> None:
        """Take the next pair as the new reference: after a homing, a reset, a silence."""
        self._reference = self._apart_since_ns = None

    def check(self, encoder: float, drive: float, velocity: float, now_ns: int) -> str:
        """Return why the two positions [m] disagree at now_ns [ns].

        velocity: from the encoder [m/s]. The two measurements may be 40 ms apart. Values that are
        not finite count as a disagreement.
        """
        if self._reference is None:
            self._reference = encoder, drive
        moved, drive_moved = encoder - self._reference[0], drive - self._reference[1]
        difference = moved - drive_moved
        if abs(difference) <= self._settings.tolerance + abs(velocity) * _SKEW:
            self._apart_since_ns = None
            return ""
        if self._apart_since_ns is None:
            self._apart_since_ns = now_ns
        if now_ns - self._apart_since_ns < self._settings.duration * 1e9:
            return ""
        cause = self._cause(moved, drive_moved)
        return f"encoder and drive disagree by {difference * 1e3:.1f} mm{cause}; {HOME_AGAIN}"

    def _cause(self, encoder: float, drive: float) -> str:
        """Return the parameter that explains why two real travels [m] differ."""
        least = self._settings.tolerance
        if abs(encoder) < least or abs(drive) < least:
            return ""
        if encoder * drive < 0.0:
            return "; they move opposite ways: compare `direction` of encoder and amplifier"
        return (
            f" after {encoder * 1e3:.1f} and {drive * 1e3:.1f} mm: compare `lead` and "
            "`counts_per_turn` of encoder and amplifier"
        )


class Frozen:
    """Finds a frozen position sensor of a planar joint, which has one sensor only.

    The joint is light and direct-driven: the torques of motor and hand move it unless they balance.
    The check adds up the time during which the net torque exceeds friction and sensor errors while
    the position stays *the same to the last count*. A change by one count resets the sum. It does
    not grow when the net torque is small: a handle at rest, a hand that holds against a set point
    out of reach, a wall at the handle.

    Limits of the check. Without a known hand force it does not judge. It cannot distinguish rest
    from motion that needs less net torque than `FreezeSettings.torque` (slow, even motion with a
    constant force). It does not find a sensor that sticks for less than `FreezeSettings.time`,
    drifts or has a wrong scale. A link that something blocks elsewhere than at the handle also
    looks frozen; that errs on the safe side. Near the joints' stops the caller does not judge.
    """

    def __init__(self, settings: FreezeSettings):
        self._settings = settings
        self._position = math.nan
        self._time = 0.0

    def restart(self) -> None:
        """Forget the sum: no torque passes that would move the joint."""
        self._time = 0.0

    def check(self, position: float, torque: float, dt: float) -> str:
        """Return why the position counts as frozen, dt [s] after the last call.

        position: of the joint [rad]; torque: net, motor and hand, that acted during dt [Nm], NaN =
        not known.
        """
        limits = self._settings
        if limits.time == 0.0 or position != self._position:
            self._position, self._time = position, 0.0
            return ""
        self._time += dt if abs(torque) > limits.torque else 0.0
        if self._time < limits.time:
            return ""
        self.restart()
        return (
            f"position (6064) has not changed by a count in {limits.time:g} s of more than "
            f"{limits.torque:g} Nm on the joint: it is frozen, or something blocks the arm; "
            "home the plane again"
        )
