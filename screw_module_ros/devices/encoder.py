# SPDX-License-Identifier: Apache-2.0
"""CiA 406 encoder on the screw's motor: one position per SYNC, unwrapped, homed on the host.

CiA 406 has no object for an index pulse, and its preset (6003) may write EEPROM. So homing is an
offset in this driver: `home` declares that the nut stands at the reference mark.
"""

from __future__ import annotations

import math
import struct

from ..can_io.load import Traffic
from ..can_io.port import SYNC_ID, Port
from ..geometry import SCREW, Screw, counts_to_height
from ..profiles import ANY_ENCODER, Profile
from ..samples import SEQUENCE_MASK, EncoderReading
from ..settings import validated
from . import encoder_setup as setup
from .canopen import NMT_PRE_OPERATIONAL, CanopenDevice
from .doubt import HOMING, Doubt
from .emcy import Emergency
from .encoder_setup import EncoderSettings
from .errors import BusError, DeviceError, NotNow
from .life import Phase, Remedy
from .motion import FULL_RANGE, Motion, Unwrapper
from .polled import FRESH, UNEXPECTED, WRONG_LENGTH, Polled
from .reported import Reported

_POSITION = struct.Struct("<I")
#: Largest age of the position for homing, or ten periods if those are longer.
_HOME_WITHIN_NS = 100_000_000
#: Age of the alarms (6503), which are asked for every 5 s, at which they count as unknown.
_ALARMS_UNKNOWN_NS = 12_000_000_000
#: Faster than a hand moves the nut [m/s], and longer than any travel [m].
_FASTEST, _FARTHEST = 2.0, 1.0


class Encoder(CanopenDevice):
    """Driver of one encoder; `request` and `reading` belong to the realtime loop.

    screw: the screw whose turns it counts.
    counters: those of `CanopenDevice` and `Polled`, out_of_range (positions dropped), bus_errors
    and slow_polls_failed (of 6500 to 6505).
    fault: why it delivers no samples, empty while healthy; latched until `clear_fault`.
    warnings: reports of the device that do not stop it.
    """

    profile_number = setup.PROFILE

    def __init__(
        self,
        port: Port,
        settings: EncoderSettings,
        screw: Screw = SCREW,
        profile: Profile = ANY_ENCODER,
    ):
        super().__init__(port, validated(settings), "encoder", profile)
        self.fault = ""
        self.warnings: list[str] = []
        self._reported = Reported(setup.SLOW_STATUS)
        self._period_ns = round(1e9 / settings.rate)
        self._metres = counts_to_height(
            settings.direction, validated(screw), settings.counts_per_turn
        )
        self._motion = Motion(settings.velocity_cutoff, self._period_ns)
        self._poll: Polled[EncoderReading] = Polled(
            port, self.counters, lambda: self.doubled("two positions per SYNC")
        )
        self._unwrapper = Unwrapper(FULL_RANGE)
        self._longest_gap_ns = math.inf
        self._doubt = Doubt(settings.home_shift, HOMING, 1e3)
        self._homings = 0
        self._last: EncoderReading | None = None
        self._sampled_ns = 0
        self._stamp_offset_ns = 0
        self._foreign_sync = 0
        port.subscribe(self.answer_id, self._on_position)
        if not port.sync_producer:
            port.subscribe(SYNC_ID, self._on_sync)

    @property
    def step(self) -> float:
        """Change of height per count [m], direction included."""
        return self._metres

    @property
    def operating_status(self) -> int:
        """Object 6500, the newest known; 0 while it is unknown."""
        return self._reported.value(setup.OPERATING_STATUS) or 0

    @property
    def homed(self) -> bool:
        """Whether the position is absolute."""
        return self._motion.homed

    @property
    def silent(self) -> bool:
        """Whether its newest position, or its start, is too long ago for homing."""
        longest_ns = max(_HOME_WITHIN_NS, 10 * self._period_ns)
        return self.phase is Phase.RUNNING and self._silent_ns > longest_ns

    @property
    def _silent_ns(self) -> int:
        return self._port.clock.now_ns() - self._sampled_ns

    @property
    def sync_rate(self) -> float:
        """SYNCs per second: one in each tick [Hz]."""
        return self.settings.rate

    @property
    def answer_id(self) -> int:
        """Identifier of the TPDO with the position."""
        return setup.position_pdo(self.settings, self.profile.encoder.pdo).cob_id

    @property
    def traffic(self) -> list[Traffic]:
        """Frames for the bus load."""
        return setup.encoder_traffic(self.settings, self._port.sync_producer)

    # -- configuration: blocking; position and homing restart ------------------------------------

    def refuse_others(self) -> None:
        """Raise Occupied when somebody else sends our SYNC."""
        if self._port.sync_producer:
            self.listen_for({})

    def set_up(self) -> int:
        """Write the settings; return the range at which the position wraps [counts]."""
        return setup.set_up(self.sdo, self.settings, self.profile.encoder, abs(self.step))

    def adopt(self, found: int) -> None:
        """Count from the range that was found."""
        self._unwrapper = Unwrapper(found)
        # One sample a period is no silence, whatever the rate.
        longest_ns = _longest_gap_ns(found * abs(self._metres))
        self._longest_gap_ns = max(1.5 * self._period_ns, longest_ns)
        self._motion.restart()
        self._doubt.forget()
        self._reported.restart(self._port.clock.now_ns())
        self._last = None
        self._poll.restart()

    def prepare_start(self) -> None:
        """Drop what came before: each request from now on gives a sample."""
        self._poll.restart()
        self._foreign_sync = self._port.counters["foreign_sync"]
        self._sampled_ns = self._port.clock.now_ns()

    def stop(self) -> None:
        """Back to PRE-OPERATIONAL; nobody watches, the configuration is gone. Raises BusError."""
        super().stop()
        self.command_nmt(NMT_PRE_OPERATIONAL)

    def clear_fault(self) -> None:
        """Clear a latched fault; if the configuration is lost, configure again (blocking).

        It may be lost if the encoder is silent: it restarted unheard, or another master stopped it.
        A bus that has failed is opened anew. Raises as `configure`; then the fault stays latched.
        """
        self._port.restore()
        silent = self.silent
        if silent:
            self._latch("the encoder does not answer")
            self.need(Remedy.RESET)
        stopped = silent or self.phase is not Phase.RUNNING
        if stopped:
            self.configure()
        self._foreign_sync = self._port.counters["foreign_sync"]
        before, self.fault, self.emergency = self.fault, "", ""
        if stopped:  # last: what comes from here on is no fault of before
            try:
                self.start()
            except DeviceError:
                self._latch(before)
                raise
        self.poll_slow()  # an alarm that persists is told once: ask, as its register still has it

    # -- cyclic: realtime loop -------------------------------------------------------------------

    def request(self, sequence: int, monotonic_ns: int, stamp_ns: int) -> None:
        """Request one sample: send SYNC, or record the tick if another node sends SYNC.

        sequence: tick number. monotonic_ns, stamp_ns: now, on both clocks [ns]. Raises BusError.
        """
        if self.phase is not Phase.RUNNING:
            return
        if not self._port.sync_producer:
            self._stamp_offset_ns = stamp_ns - monotonic_ns
            return
        if self._port.counters["foreign_sync"] != self._foreign_sync:
            self._latch(f"somebody else sends SYNC on {self._port.name}")
        try:
            if self._poll.begin(sequence, monotonic_ns, stamp_ns):
                self._port.send_sync(monotonic_ns)
        except BusError:
            self.counters["bus_errors"] += 1
            raise

    def reading(self) -> EncoderReading | None:
        """Return the answer to the last request once; None while there is none."""
        return self._poll.take()

    def _on_sync(self, _data: bytes, arrival_ns: int) -> None:
        if self.phase is Phase.RUNNING:
            sequence = arrival_ns // self._period_ns & SEQUENCE_MASK
            self._poll.begin_unasked(sequence, arrival_ns, arrival_ns + self._stamp_offset_ns)

    def _on_position(self, data: bytes, _arrival_ns: int) -> None:
        well_formed = len(data) >= _POSITION.size  # the mapped bytes come first (CiA 301)
        if self.phase is not Phase.RUNNING:
            self.counters[UNEXPECTED if well_formed else WRONG_LENGTH] += 1
            return
        if self._poll.note(well_formed) != FRESH:
            return
        (raw,) = _POSITION.unpack_from(data)
        if not self._unwrapper.holds(raw):
            self.counters["out_of_range"] += 1
            return
        sample = self._last = self._sample(self._unwrapper.step(raw))
        if not self.fault:
            self._poll.deliver(sample)

    def _sample(self, count: int) -> EncoderReading:
        sequence, monotonic_ns, stamp_ns = self._poll.asked
        motion, last = self._motion, self._last
        self._sampled_ns = monotonic_ns
        elapsed_ns = monotonic_ns - last.monotonic_ns if last is not None else 0
        if elapsed_ns > self._longest_gap_ns:  # it may have wrapped unseen
            motion.homed = False
            self._doubt.forget()
        motion.take(count * self._metres, elapsed_ns)
        return EncoderReading(
            sequence, monotonic_ns, stamp_ns, count, motion.position, motion.velocity, motion.homed,
            self._homings,
        )  # fmt: skip

    # -- homing, slow polls ----------------------------------------------------------------------

    def home(self) -> float:
        """Declare that the nut stands at the reference mark; return that height [m].

        Raises NotNow without a recent sample, with a fault, or while the nut moves; the first
        time also when it contradicts the last homing since `configure`: see `Doubt`.
        """
        last, settings = self._last, self.settings
        if self.fault or last is None or self.phase is not Phase.RUNNING:
            raise NotNow(f"no position to home at: {self.fault or 'no sample yet'}")
        if self.silent:
            raise NotNow(
                f"no position to home at: the newest is {self._silent_ns * 1e-9:.3g} s old, the "
                "encoder does not answer"
            )
        if abs(last.velocity) > settings.home_speed_limit:
            raise NotNow(
                f"the nut moves at {last.velocity:.4f} m/s; let it rest at the reference mark "
                f"(limit {settings.home_speed_limit:g} m/s)"
            )
        if self.homed or self._doubt.contradicted:
            mark, place = settings.home_position, self._motion.position
            if refused := self._doubt.refusal([mark], [place], self._port.clock.now_ns()):
                self._motion.homed = False
                raise NotNow(refused)
        self._motion.home(settings.home_position)
        self._homings += 1
        return settings.home_position

    def poll_slow(self) -> None:
        """Read status, alarms and warnings (6500, 6503, 6505); blocking, not for the loop.

        An encoder that has alarms and has not told them for too long is not trusted any more.
        """
        reported, now_ns = self._reported, self._port.clock.now_ns()
        if not reported.ask(self.sdo, now_ns, 0):
            self.counters["slow_polls_failed"] += 1
        self.check_answers()
        self.warnings = _bit_names(reported.value(setup.WARNING) or 0, setup.WARNINGS)
        if alarms := reported.value(setup.ALARM):
            self._latch(f"encoder alarm: {', '.join(_bit_names(alarms, setup.ALARMS))}")
        age_ns = reported.age_ns(setup.ALARM, now_ns)
        unknown = reported.has(setup.ALARM) and age_ns > _ALARMS_UNKNOWN_NS
        if self.phase is Phase.RUNNING and unknown:
            self._latch(
                f"the encoder does not say whether it has an alarm: 6503 was last heard "
                f"{age_ns * 1e-9:.0f} s ago"
            )

    # -- unsolicited reports of the device -------------------------------------------------------

    def restarted(self) -> None:
        """Stop delivering samples after a boot-up."""
        self._lose_configuration(
            "the encoder restarted (boot-up): its configuration and the home position are gone; "
            "clear the fault to configure it again, then home"
        )

    def altered_by(self, client: str) -> None:
        """Stop delivering samples: direction, scale and preset may have changed."""
        self._lose_configuration(
            f"{client} talks to the encoder and may have changed how it counts: stop it, clear the "
            "fault to configure the encoder again, then home"
        )

    def doubled(self, shown: str) -> None:
        """Stop delivering samples: nobody can say of which encoder they are."""
        self._lose_configuration(self._twins(shown))

    def _lose_configuration(self, why: str) -> None:
        self.become_new()
        self._motion.restart()
        self._doubt.forget()
        self.fault = why

    def reported(self, emergency: Emergency) -> None:
        """Latch an emergency in operation."""
        if self.phase is Phase.RUNNING:
            self._latch(f"encoder emergency {emergency.text}")

    def _latch(self, reason: str) -> None:
        self.fault = self.fault or reason


def _longest_gap_ns(span: float) -> float:
    """Return the time between two samples in which the nut cannot pass half of `span` [m].

    span: travel after which the position wraps. After a longer time the number of wraps is unknown;
    it is none where the whole travel is shorter.
    """
    return math.inf if 0.5 * span >= _FARTHEST else 0.5 * span / _FASTEST * 1e9


def _bit_names(word: int, names: dict[int, str]) -> list[str]:
    return [names.get(bit, f"bit {bit}") for bit in range(16) if word >> bit & 1]
