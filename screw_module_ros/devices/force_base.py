# SPDX-License-Identifier: Apache-2.0
"""What every force sensor does alike, whatever it is reached by: its life, its zero, its faults.

A driver is a subclass. It finds its device, asks it for a sample each tick and hands six values to
`take`; the base turns them into the wrench at the handle, or withholds them. `force_frames` has the
half of this that all sensors on CAN share which answer one frame with several.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

from ..can_io.load import Traffic
from ..can_io.port import Port
from ..clock import Clock
from ..samples import (
    FORCE_FAULT_MASK,
    FORCE_RESERVED_MASK,
    FORCE_RESTARTED,
    ForceReading,
    force_status_names,
)
from ..settings import validated
from .doubt import TARE, Doubt
from .errors import BusError, NotConfigured, NotNow
from .force_sensor_settings import ANY_CALIBRATION, ForceSensorSettings, unchanged_samples
from .life import Life, Phase, Remedy
from .polled import Line, Polled
from .tare import mean_wrench

AXES = 6
Row = tuple[float, ...]
Wrench = tuple[float, ...]
_NO_WRENCH: Wrench = (0.0,) * AXES
_RESTART_S = 0.02  # silence after which the board may have lost its supply and come back


class NoSettings(NamedTuple):
    """Settings of a driver's own: none."""


class ForceSensor(Life, ABC):
    """Driver of one sensor; `request` and `reading` belong to the realtime loop.

    port: what the sensor is reached by. own: a record of OWN, from `settings` of its profile.
    parts: frames of one answer.
    counters: those of `Polled`, saturated (samples with a value at its end), frozen (samples
    withheld because the values were constant), status_faults (samples whose status forbids their
    use), reserved_bits (samples with such bits), restarts (of the sensor), bus_errors,
    slow_polls_failed.
    identity: what the device reports, for hardware_id; set by `identify`.
    fault: the first problem found, latched until `clear_fault`. The driver still delivers samples
    with their status word, so that their users see the problem. It withholds saturated samples, all
    samples after a restart that lost the selected calibration or a setting of somebody else, and
    all samples while the values have been constant for `freeze_time`: the status word does not show
    these, and the force feedback must not use them. shown: further values for the diagnostics, by
    name.
    bias: the wrench that is removed. tared: it is the zero of a `tare` since which the sensor has
    not restarted, as far as is known. A bias from before stays in use: without it the force would
    jump by the handle's weight.
    """

    OWN: ClassVar[type] = NoSettings
    identity = ""
    #: Absolute value from which on a sample is saturated.
    SATURATED: ClassVar[float]
    #: Whether a restart loses what the sensor was told; else only a calibration that was chosen.
    FORGETS: ClassVar[bool] = True

    def __init__(
        self,
        port: Line,
        settings: ForceSensorSettings,
        label: str = "force sensor",
        own: Any = None,
        parts: int = 1,
    ):
        super().__init__(port.clock)
        self.port = port
        self.settings = validated(settings)
        self.own = self.OWN() if own is None else own
        self.label = label
        self.counters: Counter[str] = Counter()
        self.fault = ""
        self.shown: dict[str, object] = {}
        self.bias: Wrench = _NO_WRENCH
        self.tared = False
        self._doubt = Doubt(settings.tare_shift, TARE)
        self._rows: tuple[Row, ...] = ()  # none: no sample may be delivered
        self._poll: Polled[ForceReading] = Polled(port, self.counters, self._on_doubled, parts)
        self._earlier: list[tuple[Wrench, bool]] = []
        self._frozen = False
        self._last_status: int | None = None
        self._newest: tuple[float, ...] = ()
        self._unchanged = self._unanswered = 0
        self._too_many_unchanged = unchanged_samples(settings)
        self._too_many_unanswered = max(10, round(_RESTART_S * settings.rate))

    @classmethod
    def opened(
        cls, settings: ForceSensorSettings, own: Any, open_port: Callable[..., Port], clock: Clock
    ) -> ForceSensor:
        """Return a driver on its line.

        open_port(*claims): opens the CAN bus of the node, and keeps what is claimed there for this
        process alone, like `node 5` (`locks.lock_device`). A driver of a sensor that is not on CAN
        opens something else in its place, and refuses a clock that is simulated. Raises BusError,
        AlreadyRunning.
        """
        return cls(open_port(*settings.claims), settings, own=own)

    # -- hooks -----------------------------------------------------------------------------------

    @property
    def place(self) -> str:
        """How it is addressed, for messages."""
        return f"base id 0x{self.settings.base_id:02X}"

    @property
    def traffic(self) -> list[Traffic]:
        """Frames for the load of a CAN bus."""
        return []

    def refuse_others(self) -> None:
        """Raise Occupied when somebody else already asks this sensor."""

    @abstractmethod
    def identify(self) -> list[Row]:
        """Find the sensor and set it up; blocking.

        Returns the matrix from its six values to fx, fy, fz [N] and tx, ty, tz [Nm] in its own
        axes. Raises as `configure`.
        """

    def reset_device(self) -> None:
        """Restart the device, where it can be told to; blocking. Raises NotAnswering, BusError."""

    @abstractmethod
    def ask(self, monotonic_ns: int) -> None:
        """Ask for one sample; monotonic_ns: now [ns]. Raises BusError."""

    def poll_slow(self) -> None:
        """Read further values into `shown`; blocking, not for the loop."""

    # -- configuration: blocking -----------------------------------------------------------------

    def configure(self) -> None:
        """Find the sensor, check its identity and read its calibration; blocking.

        Raises Occupied, NotAnswering, WrongDevice, NotConfigured, BusError.
        """
        self.become_new()
        self.port.restore()
        self.refuse_others()
        rows = self.identify()
        if [len(row) for row in rows] != [AXES] * AXES or not (
            all(map(any, rows)) and all(math.isfinite(x) for row in rows for x in row)
        ):
            raise NotConfigured(
                f"the driver of the {self.label} gave {rows} as its matrix: six rows of six finite "
                "numbers are wanted, none of zeros alone"
            )
        self._rows = mounted(rows, self.settings)
        self.remedy, self._frozen = Remedy.NOTHING, False
        self._lose_tare()  # nobody watched it, or it has restarted
        self.become_configured()

    def start(self) -> None:
        """Deliver samples from the next request on.

        Raises NotConfigured before `configure` and after `stop`.
        """
        if self.phase is Phase.NEW:
            raise NotConfigured(f"{self.label} is not configured")
        self._poll.restart()
        self._last_status = None
        self._unanswered = 0
        self.become_running()

    def stop(self) -> None:
        """Stop polling; nobody watches any more, so the configuration counts as gone."""
        self.become_new()

    def reset(self) -> None:
        """Restart the device and configure it again; blocking, raises as `configure`."""
        self.become_new()
        # If it needs longer than we wait, the next call must not restart it once more.
        self.remedy = Remedy.CONFIGURE
        self.reset_device()
        self.configure()

    def clear_fault(self) -> None:
        """Clear a latched fault; one from the status word or frozen values restarts the device.

        A restart blocks and raises as `configure`; then the fault stays latched. Values that still
        are the same count as frozen at once. A bus that has failed is opened anew.
        """
        self.port.restore()
        stopped = self.remedy is not Remedy.NOTHING
        if self.remedy is Remedy.RESET:
            self.reset()
        elif stopped:
            self.configure()
        before, self.fault = self.fault, ""  # before the first sample, which may latch it again
        if stopped:
            try:
                self.start()
            except BaseException:
                self.need(Remedy.CONFIGURE)
                self.latch(before)
                raise

    # -- cyclic: realtime loop -------------------------------------------------------------------

    def request(self, sequence: int, monotonic_ns: int, stamp_ns: int) -> None:
        """Poll once. sequence: tick number; monotonic_ns, stamp_ns: now, on both clocks [ns].

        Raises BusError.
        """
        if self.phase is not Phase.RUNNING:
            return
        self._unanswered += 1
        try:
            if self._poll.begin(sequence, monotonic_ns, stamp_ns):
                self.ask(monotonic_ns)
        except BusError:
            self.counters["bus_errors"] += 1
            raise

    def reading(self) -> ForceReading | None:
        """Return the answer to the last request once; None while there is none."""
        return self._poll.take()

    def take(self, status: int, values: tuple[float, ...]) -> None:
        """Deliver the answer to the newest request, or withhold it.

        status: bits of `samples.FORCE_STATUS_BITS`. values: six, as `identify` has described them;
        others are a fault of the driver: a zero made of them would spoil all samples after it.
        """
        if len(values) != AXES or not math.isfinite(sum(values)):
            self.lose(
                f"the driver of the {self.label} gave {values} in place of six finite numbers"
            )
            return
        if status or self._last_status != 0:
            self._note_status(status)
        if self._is_frozen(values):
            self.counters["frozen"] += 1
            return
        if max(map(abs, values)) >= self.SATURATED:
            self.counters["saturated"] += 1
            return
        if not self._rows:
            return
        g0, g1, g2, g3, g4, g5 = values
        fx, fy, fz, tx, ty, tz = [
            a * g0 + b * g1 + c * g2 + d * g3 + e * g4 + f * g5 - bias
            for (a, b, c, d, e, f), bias in zip(self._rows, self.bias, strict=True)
        ]
        self._poll.deliver(ForceReading(*self._poll.asked, fx, fy, fz, tx, ty, tz, status))

    def heard(self) -> None:
        """Note that the device has answered; after a silence it may have restarted."""
        if self._unanswered > self._too_many_unanswered:
            # Bit 0 of the status word shows a restart by the watchdog, not one of the supply.
            self.restarted("was silent and may have restarted")
        self._unanswered = 0

    def restarted(self, why: str) -> None:
        """Note that the device has begun anew; why: what it did, as the rest of a sentence."""
        self._lose_tare()
        if self.FORGETS or self.settings.calibration != ANY_CALIBRATION:
            self.lose(f"the {self.label} {why}, its calibration may be another now")

    def lose(self, why: str) -> None:
        """Latch why no sample can be trusted until the sensor is configured again."""
        self._rows = ()
        self.need(Remedy.CONFIGURE)
        self._lose_tare()
        self.latch(why)

    def latch(self, reason: str) -> None:
        """Latch a fault; the first one stays."""
        self.fault = self.fault or reason

    def _on_doubled(self) -> None:
        """Stop delivering samples: their halves may be of two sensors."""
        self.lose(
            f"more than one device answers as the {self.label} ({self.place}) on {self.port.name}: "
            "two samples per request; leave one of them on the bus and give it another id, then "
            "tare"
        )

    def _is_frozen(self, values: tuple[float, ...]) -> bool:
        """Return whether the values are frozen."""
        before, self._newest = self._newest, values
        if values != before:  # nearly always, so this is mostly the end
            self._unchanged = 0
            return self._frozen
        self._unchanged += 1
        if 0 < self._too_many_unchanged <= self._unchanged and not self._frozen:
            self._frozen = True
            self.need(Remedy.RESET)
            self.latch(
                f"the gauges of the {self.label} have not changed for "
                f"{self._too_many_unchanged / self.settings.rate:g} s: its converter "
                "hangs; restart the sensor, then tare"
            )
        return self._frozen

    def _note_status(self, status: int) -> None:
        before, self._last_status = self._last_status, status
        if status & FORCE_RESERVED_MASK:
            self.counters["reserved_bits"] += 1
        if status & FORCE_FAULT_MASK:
            self.counters["status_faults"] += 1
            self.need(Remedy.RESET)
            self.latch(f"{self.label} status: {', '.join(force_status_names(status))}")
        if before is not None and status & ~before & FORCE_RESTARTED:
            self.counters["restarts"] += 1
            self.restarted("restarted")

    # -- taring ----------------------------------------------------------------------------------

    def tare(self, readings: Sequence[ForceReading]) -> Wrench:
        """Make the mean of `readings` the new zero; return the bias now in use [N, Nm].

        Raises NotNow when there are too few readings, one is unusable, the values are frozen, or
        the handle is loaded or moved; the first time also when the new zero contradicts that of the
        last tare since the sensor's start: see `Doubt`.
        """
        if self._frozen:
            raise NotNow(self.fault)
        mean = mean_wrench(readings, self.settings)
        if self.tared or self._doubt.contradicted:
            now_ns = self._clock.now_ns()
            if refused := self._doubt.refusal((0.0, 0.0, 0.0), mean[:3], now_ns):
                self.tared = False
                raise NotNow(refused)
        self._earlier.append((self.bias, self.tared))
        self.bias = tuple(old + new for old, new in zip(self.bias, mean, strict=True))
        self.tared = True
        return self.bias

    def untare(self) -> Wrench:
        """Undo the last `tare`; return the bias now in use, zero when no tare is left."""
        self.bias, self.tared = self._earlier.pop() if self._earlier else (_NO_WRENCH, False)
        return self.bias

    def _lose_tare(self) -> None:
        self.tared = False
        self._doubt.forget()
        self._earlier = [(bias, False) for bias, _ in self._earlier]


def rotation(roll: float, pitch: float, yaw: float) -> tuple[tuple[float, float, float], ...]:
    """Return the matrix that turns sensor axes into handle axes; fixed x, y, z angles [rad]."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def mounted(rows: list[Row], settings: ForceSensorSettings) -> tuple[Row, ...]:
    """Return the matrix from six values to fx, fy, fz [N], tx, ty, tz [Nm] in handle axes.

    rows: the same in the axes of the sensor.
    """
    turn = rotation(settings.roll, settings.pitch, settings.yaw)
    signed = [[settings.sign * x for x in row] for row in rows]
    return tuple(
        tuple(sum(turn[axis][k] * block[k][value] for k in range(3)) for value in range(AXES))
        for block in (signed[:3], signed[3:])
        for axis in range(3)
    )
