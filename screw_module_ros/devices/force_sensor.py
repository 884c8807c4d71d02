# SPDX-License-Identifier: Apache-2.0
"""ATI six-axis transducer, polled once a tick (thesis 3.1.9), with NETCANOEM electronics.

wrench = matrix @ (gauges - bias) / counts per unit. The driver keeps the bias as a wrench. `ati`
has the layout of the frames. They carry no number, so a sample is valid only when both halves came
before the next request. `ati_net` has the driver for the Net F/T box.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from ..can_io.load import Traffic
from ..can_io.port import Port
from ..samples import FORCE_FAULT_MASK, ForceReading
from ..settings import validated
from . import ati
from .ati import Dialogue, SensorIdentity
from .canopen import UNWATCHED_NS
from .doubt import TARE, Doubt
from .errors import BusError, NotAnswering, NotConfigured, NotNow, Occupied, WrongDevice
from .force_sensor_settings import (
    ANY_CALIBRATION,
    ForceSensorSettings,
    unchanged_samples,
)
from .polled import FRESH, LATE, UNEXPECTED, Polled
from .tare import mean_wrench

Wrench = tuple[float, ...]
_NO_WRENCH: Wrench = (0.0,) * ati.AXES
_RESTART_S = 0.02  # silence after which the board may have lost its supply and come back


class ForceSensor:
    """Driver of one sensor; `request` and `reading` belong to the realtime loop.

    A sensor with another protocol is a subclass (CONTRIBUTING.md); two frames are one answer.

    counters: those of `Polled`, out_of_order (second halves without their first), saturated
    (samples with a gauge at its end), frozen (samples withheld because the gauges were constant),
    status_faults (samples whose status forbids their use), reserved_bits (samples with such bits),
    foreign_requests (of another master), restarts (of the board), bus_errors, slow_polls_failed.
    fault: the first problem found, latched until `clear_fault`. The driver still delivers samples
    with their status word, so that their users see the problem. It withholds saturated samples, all
    samples after a restart that lost the selected calibration or a setting of somebody else, and
    all samples while the gauges have been constant for `freeze_time`: the status word does not show
    these, and the force feedback must not use them. voltages: of the board by name [ADC counts], of
    the last slow poll.
    bias: the wrench that is removed. tared: it is the zero of a `tare` since which the board has
    not restarted, as far as is known. A bias from before stays in use: without it the force would
    jump by the handle's weight.
    """

    REQUEST = b""
    FIRST, SECOND = ati.READ_GAUGES, ati.READ_GAUGES_SECOND
    SIZES = ati.GAUGES_FIRST.size, ati.GAUGES_SECOND.size
    SETTINGS: tuple[int, ...] = (ati.SET_CALIBRATION, ati.RESET)
    SATURATED = ati.SATURATED

    def __init__(self, port: Port, settings: ForceSensorSettings, label: str = "force sensor"):
        self.settings = validated(settings)
        self.counters: Counter[str] = Counter()
        self.fault = ""
        self.sensor = SensorIdentity()
        self.voltages: dict[str, int] = {}
        self.bias: Wrench = _NO_WRENCH
        self.tared = False
        self._doubt = Doubt(settings.tare_shift, TARE)
        self._port = port
        self._label = label
        self._dialogue = Dialogue(port, settings.base_id, label, settings.timeout)
        self._request_id = settings.base_id << 4
        self._rows: tuple[ati.Row, ...] = ()
        self._poll: Polled[ForceReading] = Polled(port, self.counters, self._on_doubled, parts=2)
        self._earlier: list[tuple[Wrench, bool]] = []
        self._running = False
        self._needs_reset = self._calibration_lost = self._frozen = False
        self._last_status: int | None = None
        self._half: bytes | None = None
        self._newest: tuple[int, ...] = ()
        self._unchanged = self._unanswered = self._configured_ns = 0
        self._too_many_unchanged = unchanged_samples(settings)
        self._too_many_unanswered = max(10, round(_RESTART_S * settings.rate))
        port.subscribe(self._request_id | self.FIRST, self._on_first)
        port.subscribe(self._request_id | self.SECOND, self._on_second)
        if self.FIRST != 0:  # else a foreign request has the identifier of the first half
            port.subscribe(self._request_id, self._on_request)
        for opcode in self.SETTINGS:
            port.subscribe(self._request_id | opcode, self._on_foreign_setting)

    # -- configuration: blocking -----------------------------------------------------------------

    @property
    def identity(self) -> str:
        """Identity that the device reports, for hardware_id."""
        return self.sensor.text

    @property
    def configured(self) -> bool:
        """Whether `start` may follow: it runs, or was configured just now and not left since.

        While nobody polls it, it may restart with another calibration, and its status word is then
        the first one: no earlier one shows the restart.
        """
        age_ns = self._port.clock.now_ns() - self._configured_ns
        return bool(self._rows) and (self._running or age_ns <= UNWATCHED_NS)

    @property
    def traffic(self) -> list[Traffic]:
        """Frames for the bus load."""
        sizes = (len(self.REQUEST), *self.SIZES)
        names = ("request", "first half", "second half")
        return [
            Traffic(f"{self._label} {name}", size, self.settings.rate)
            for name, size in zip(names, sizes, strict=True)
        ]

    def configure(self) -> None:
        """Find the sensor, check its identity and read its calibration; blocking.

        Raises Occupied, NotAnswering, WrongDevice, NotConfigured, BusError.
        """
        settings = self.settings
        self._running = False
        self._port.restore()
        if self._port.listen({self._request_id: self._is_poll}, settings.listen) is not None:
            raise Occupied(
                f"somebody already polls the {self._label} (base id 0x{settings.base_id:02X}) on "
                f"{self._port.name}: is a second copy of this node running?"
            )
        self.sensor, matrix = self.find()
        turn = ati.rotation(settings.roll, settings.pitch, settings.yaw)
        self._rows = ati.counts_to_wrench(matrix, self.sensor, turn, settings.sign)
        self._needs_reset = self._calibration_lost = self._frozen = False
        self._lose_tare()  # nobody watched it, or it has restarted
        self._configured_ns = self._port.clock.now_ns()

    def find(self) -> tuple[SensorIdentity, list[ati.Row]]:
        """Return identity, units and calibration of the sensor; raises as `configure`."""
        settings, dialogue = self.settings, self._dialogue
        serial = dialogue.serial()
        if settings.serial and serial != settings.serial:
            raise WrongDevice(
                f"{self._label} on {self._port.name} has serial {serial!r}; "
                f"{settings.serial!r} is wanted"
            )
        if settings.calibration != ANY_CALIBRATION:
            dialogue.set_calibration(settings.calibration)
        return dialogue.identify(), dialogue.matrix()

    def start(self) -> None:
        """Deliver samples from the next request on.

        Raises NotConfigured before `configure` and after `stop`.
        """
        if not self._rows:
            raise NotConfigured(f"{self._label} is not configured")
        self._poll.restart()
        self._last_status = None
        self._unanswered = 0
        self._running = True

    def stop(self) -> None:
        """Stop polling; nobody watches any more, so the configuration counts as gone."""
        self._running, self._rows = False, ()

    def reset(self) -> None:
        """Restart the board and configure it again; blocking, raises as `configure`."""
        self._running = False
        # If it needs longer than we wait, the next call must not restart it once more.
        self._needs_reset, self._calibration_lost = False, True
        self._dialogue.reset()
        self.configure()

    def clear_fault(self) -> None:
        """Clear a latched fault; one from the status word or frozen gauges restarts the board.

        A restart blocks and raises as `configure`; then the fault stays latched. Gauges that still
        show the same values count as frozen at once. A bus that has failed is opened anew.
        """
        self._port.restore()
        stopped = self._needs_reset or self._calibration_lost
        if self._needs_reset:
            self.reset()
        elif self._calibration_lost:
            self.configure()
        self.fault = ""  # before the first sample, which may latch it again
        if stopped:
            self.start()

    # -- cyclic: realtime loop -------------------------------------------------------------------

    def request(self, sequence: int, monotonic_ns: int, stamp_ns: int) -> None:
        """Poll once. sequence: tick number; monotonic_ns, stamp_ns: now, on both clocks [ns].

        Raises BusError.
        """
        if not self._running:
            return
        self._half = None
        self._unanswered += 1
        try:
            if self._poll.begin(sequence, monotonic_ns, stamp_ns):
                self._port.send(self._request_id, self.REQUEST)
        except BusError:
            self.counters["bus_errors"] += 1
            raise

    def reading(self) -> ForceReading | None:
        """Return the answer to the last request once; None while there is none."""
        return self._poll.take()

    def _on_first(self, data: bytes, _arrival_ns: int) -> None:
        if not self._running:
            return
        if self._is_poll(data):
            self._note_foreign_poll()
            return
        if self._unanswered > self._too_many_unanswered:
            # Bit 0 of the status word shows a restart by the watchdog, not one of the supply.
            self._note_restart("was silent and may have restarted")
        self._unanswered = 0
        if self._poll.note(len(data) == self.SIZES[0], 0) == FRESH:
            self._half = data

    def _on_request(self, data: bytes, _arrival_ns: int) -> None:
        if self._running and self._is_poll(data):
            self._note_foreign_poll()

    def _is_poll(self, data: bytes) -> bool:
        return bytes(data) == self.REQUEST

    def _note_foreign_poll(self) -> None:
        """Latch that another master polls: its answers would pass for ours."""
        self.counters["foreign_requests"] += 1
        self._latch(f"somebody else polls the {self._label} on {self._port.name}")

    def _on_foreign_setting(self, _data: bytes, _arrival_ns: int) -> None:
        """Stop delivering samples; while it runs, we ask for neither, nor is this our reply."""
        if not self._running:
            return
        self.counters["foreign_requests"] += 1
        self._lose_calibration(
            f"somebody else set up or restarted the {self._label} on {self._port.name}, its "
            "calibration may be another now"
        )

    def _on_doubled(self) -> None:
        """Stop delivering samples: their halves may be of two sensors."""
        self._lose_calibration(
            f"more than one device answers as the {self._label} (base id "
            f"0x{self.settings.base_id:02X}) on {self._port.name}: two samples per request; leave "
            "one of them on the bus and give it another id, then tare"
        )

    def _lose_calibration(self, why: str) -> None:
        self._calibration_lost = True
        self._lose_tare()
        self._latch(why)

    def _on_second(self, data: bytes, _arrival_ns: int) -> None:
        if not self._running:
            return
        verdict = self._poll.note(len(data) == self.SIZES[1], 1)
        if verdict in (LATE, UNEXPECTED):
            return  # an older second half: the present first half still needs its own
        half, self._half = self._half, None
        if verdict == FRESH and half is not None:
            self._complete(half, data)
        elif verdict == FRESH:
            self.counters["out_of_order"] += 1

    def _complete(self, first: bytes, second: bytes) -> None:
        status, values = self.values(first, second)
        if values is None:
            return
        if status or self._last_status != 0:
            self._note_status(status)
        if self._is_frozen(values):
            self.counters["frozen"] += 1
            return
        if max(map(abs, values)) >= self.SATURATED:
            self.counters["saturated"] += 1
            return
        if self._calibration_lost:
            return
        g0, g1, g2, g3, g4, g5 = values
        fx, fy, fz, tx, ty, tz = [
            a * g0 + b * g1 + c * g2 + d * g3 + e * g4 + f * g5 - bias
            for (a, b, c, d, e, f), bias in zip(self._rows, self.bias, strict=True)
        ]
        self._poll.deliver(ForceReading(*self._poll.asked, fx, fy, fz, tx, ty, tz, status))

    def values(self, first: bytes, second: bytes) -> tuple[int, tuple[int, ...] | None]:
        """Return status word and six counts of the two halves, None for counts not to be used."""
        status, g0, g2, g4 = ati.GAUGES_FIRST.unpack(first)
        g1, g3, g5 = ati.GAUGES_SECOND.unpack(second)
        return status, (g0, g1, g2, g3, g4, g5)

    def _is_frozen(self, values: tuple[int, ...]) -> bool:
        """Return whether the gauges are frozen."""
        before, self._newest = self._newest, values
        if values != before:  # nearly always, so this is mostly the end
            self._unchanged = 0
            return self._frozen
        self._unchanged += 1
        if 0 < self._too_many_unchanged <= self._unchanged and not self._frozen:
            self._frozen = self._needs_reset = True
            self._latch(
                f"the gauges of the {self._label} have not changed for "
                f"{self._too_many_unchanged / self.settings.rate:g} s: its converter "
                "hangs; restart the sensor, then tare"
            )
        return self._frozen

    def _note_status(self, status: int) -> None:
        before, self._last_status = self._last_status, status
        if status & ati.RESERVED_MASK:
            self.counters["reserved_bits"] += 1
        if status & FORCE_FAULT_MASK:
            self.counters["status_faults"] += 1
            self._needs_reset = True
            self._latch(f"{self._label} status: {', '.join(ati.status_names(status))}")
        if before is not None and status & ~before & ati.RESTARTED:
            self.counters["restarts"] += 1
            self._note_restart("restarted")

    def _note_restart(self, why: str) -> None:
        self._lose_tare()
        if self.settings.calibration != ANY_CALIBRATION:
            self._lose_calibration(f"the {self._label} {why}, its calibration may be another now")

    def _latch(self, reason: str) -> None:
        self.fault = self.fault or reason

    # -- taring, slow polls ----------------------------------------------------------------------

    def tare(self, readings: Sequence[ForceReading]) -> Wrench:
        """Make the mean of `readings` the new zero; return the bias now in use [N, Nm].

        Raises NotNow when there are too few readings, one is unusable, the gauges are frozen, or
        the handle is loaded or moved; the first time also when the new zero contradicts that of the
        last tare since the board's start: see `Doubt`.
        """
        if self._frozen:
            raise NotNow(self.fault)
        mean = mean_wrench(readings, self.settings)
        if self.tared or self._doubt.contradicted:
            now_ns = self._port.clock.now_ns()
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

    def poll_slow(self) -> None:
        """Read the diagnostic voltages into `voltages`; not for the loop."""
        try:
            named = ati.DIAGNOSTICS.items()
            self.voltages = {name: self._dialogue.diagnostic(i) for i, name in named}
        except (NotAnswering, BusError):
            self.counters["slow_polls_failed"] += 1
