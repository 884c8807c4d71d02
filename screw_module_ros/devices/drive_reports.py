# SPDX-License-Identifier: Apache-2.0
"""A drive's own reports: cyclic answers, error code, mode, emergencies (CiA 402, CiA 301)."""

from __future__ import annotations

from ..can_io.port import SYNC_ID, Port
from ..profiles import ALWAYS, ENABLED, READY, Profile, key_of
from ..samples import DriveReading
from ..units import from_per_mille
from . import cia402
from . import drive_setup as setup
from . import drive_slow_status as slow_status
from .canopen import CanopenDevice
from .cia402 import State
from .drive_logic import DriveLogic
from .drive_settings import BRAKE, DriveSettings
from .emcy import Emergency, code_name
from .life import Phase
from .motion import FULL_RANGE, Unwrapper
from .reported import Reported
from .surplus import Surplus

_HEARTBEATS_MISSED = 3
_ASKED_AFTER_NS = 300_000_000
"""Age at which an object is asked for: three times the period of TPDO2, which else brings it."""
_MODE_UNKNOWN_NS = 1_000_000_000
"""Age of the mode (6061) at which it counts as unknown."""
_WATCHED_BY_US = (0x1016, 1)
_FROM_READY = (State.READY_TO_SWITCH_ON, State.SWITCHED_ON, State.OPERATION_ENABLED)
_TELLS_MODE_IN = {
    ALWAYS: frozenset(State),
    READY: frozenset(_FROM_READY),
    ENABLED: frozenset(_FROM_READY[-1:]),
}
"""States in which 6061 is true, by a make's `mode_shown`."""


class DriveReports(CanopenDevice):
    """A drive that is listened to: decodes its frames, passes states and faults to `logic`.

    per_turn: change of position per turn [m or rad]. counters: those of `CanopenDevice`, received
    (statuswords), missing (SYNCs without one), unexpected (statuswords without a SYNC),
    wrong_length (frames dropped as too short), bad_statusword (patterns not in CiA 402),
    illegal_transitions (states that cannot follow each other), slow_polls_failed (of what TPDO2
    does not bring). Of a longer frame the mapped bytes count, which come first (CiA 301, 7.5.2.36).
    logic: goal and fault of the drive. brakes: it does when its torque goes off, else it coasts.
    reading: the newest cyclic answer, None before the first.
    shown: the state in it. synced_ns: arrival of the last SYNC, 0 without any since the start.
    torque_of: torque of one in command and actual torque [Nm], direction
    included. mode_confirmed: the drive has said that it is in torque mode, since it can tell.
    """

    profile_number = setup.PROFILE

    def __init__(
        self, port: Port, settings: DriveSettings, label: str, per_turn: float, profile: Profile
    ):
        super().__init__(port, settings, label, profile)
        self.brakes = settings.stop_reaction == BRAKE
        silence = _HEARTBEATS_MISSED * settings.drive_heartbeat
        self.logic = DriveLogic(label, self.brakes, settings.enable_timeout, silence)
        self._reported = Reported(slow_status.SLOW_STATUS, signed=(slow_status.MODE_DISPLAY,))
        self.torque_of = 0.0
        self.mode_confirmed = False
        self._tells_mode_in = _TELLS_MODE_IN[profile.drive.mode_shown]
        self._tells_since_ns = 0
        self._setup = setup.unconfigured(settings)
        self._position_of = settings.direction * per_turn / settings.counts_per_turn
        self._unwrapper = Unwrapper(FULL_RANGE)
        self._stale_ns = round(settings.stale_periods * 1e9 / settings.rate)
        self._surplus = Surplus()
        self.forget_reports()
        port.subscribe(self.answer_id, self._on_status)
        port.subscribe(slow_status.identifier(settings), self._on_slow_status)
        port.subscribe(SYNC_ID, self._on_sync)

    @property
    def sync_rate(self) -> float:
        """SYNCs per second [Hz]."""
        return self.settings.rate * self.settings.sync_divider

    @property
    def own_objects(self) -> frozenset[tuple[int, int]]:
        """The watch of our heartbeat, and what the substitutes of its make write."""
        parts = [part for each in self.profile.drive.substitutes for part in each.objects]
        return frozenset((_WATCHED_BY_US, *(key_of(part.object) for part in parts)))

    @property
    def answer_id(self) -> int:
        """Identifier of TPDO1."""
        return setup.status_pdo(self.settings, self.profile.drive).cob_id

    @property
    def step(self) -> float:
        """Change of position per count of object 6064 [m or rad], direction included."""
        return self._position_of

    @property
    def mode(self) -> int:
        """Mode of operation in use: 10 cyclic synchronous torque, 4 profile torque."""
        return self._setup.mode

    @property
    def error_code(self) -> int:
        """Object 603F, the newest known; 0 for none."""
        return self._reported.value(slow_status.ERROR_CODE) or 0

    @property
    def mode_display(self) -> int:
        """Object 6061, the newest known; 0, which is no mode, while it is unknown."""
        return self._reported.value(slow_status.MODE_DISPLAY) or 0

    @property
    def digital_inputs(self) -> int:
        """Object 60FD, the newest known; 0 while it is unknown."""
        return self._reported.value(slow_status.DIGITAL_INPUTS) or 0

    def mode_refusal(self, now_ns: int) -> str:
        """Return why torque may not pass, empty if the drive says that it is in torque mode.

        Empty, too, in a state in which it does not tell: see `mode_confirmed`.
        """
        if self.shown not in self._tells_mode_in:
            return ""
        age_ns = self._reported.age_ns(slow_status.MODE_DISPLAY, now_ns)
        if age_ns > _MODE_UNKNOWN_NS:
            return (
                f"the {self.label} does not say in which mode it is: 6061 was last heard "
                f"{age_ns * 1e-9:.1f} s ago"
            )
        if self._reported.value(slow_status.MODE_DISPLAY) is None:
            return f"the {self.label} has not said yet in which mode it is (6061)"
        if self.mode_display != self.mode:
            return (
                f"the {self.label} is not in torque mode {self.mode}, "
                f"6061 is {self.mode_display}"
            )
        return ""

    def check_mode(self, now_ns: int) -> None:
        """Latch a mode that is wrong, or that was not heard of for too long, while enabled.

        A drive that has only just come to where it tells its mode is given time for it.
        """
        if not (self.logic.enabling and (wrong := self.mode_refusal(now_ns))):
            return
        if self.mode_confirmed or now_ns - self._tells_since_ns > _MODE_UNKNOWN_NS:
            self.logic.latch(wrong)

    def confirm_mode(self, now_ns: int) -> None:
        """Note that the drive has said that it is in torque mode, since it tells; the loop's."""
        heard_ns = now_ns - self._reported.age_ns(slow_status.MODE_DISPLAY, now_ns)
        if self.shown in self._tells_mode_in and heard_ns >= self._tells_since_ns:
            self.mode_confirmed = self.mode_display == self.mode

    def expect(self, found: setup.DriveSetup) -> None:
        """Take over mode and rating; the position restarts: it may have been switched off."""
        self._setup = found
        now_ns = self._port.clock.now_ns()
        self._reported.restart(now_ns)
        self.mode_confirmed = self.profile.drive.mode_shown == ALWAYS
        if self.mode_confirmed:  # read back just now
            self._reported.note({slow_status.MODE_DISPLAY: found.mode}, now_ns)
        self.torque_of = self.settings.direction * from_per_mille(1, found.thousand)
        self._unwrapper = Unwrapper(FULL_RANGE)

    def forget_reports(self) -> None:
        """Drop the states shown before a start."""
        self.reading: DriveReading | None = None
        self.shown = State.UNKNOWN
        self.synced_ns = self._syncs_owed = 0
        self._foreign_sync = self._port.counters["foreign_sync"]
        self._surplus.restart(*self._answers)

    def forget_errors(self) -> None:
        """Drop what the drive reported of errors before a recovery."""
        self.emergency = ""
        self._reported.note({slow_status.ERROR_CODE: 0}, self._port.clock.now_ns())

    def state(self, now_ns: int) -> State:
        """Return the drive's state, UNKNOWN when its statusword is older than ten periods."""
        reading = self.reading
        if reading is None or now_ns - reading.monotonic_ns > self._stale_ns:
            return State.UNKNOWN
        return self.shown

    def _on_status(self, data: bytes, arrival_ns: int) -> None:
        if len(data) < setup.STATUS_LAYOUT.size:
            self.counters["wrong_length"] += 1
            return
        statusword, raw, per_mille = setup.STATUS_LAYOUT.unpack_from(data)
        self.counters["received"] += 1
        if not self._syncs_owed:
            self.counters["unexpected"] += 1
            if self._surplus.note(*self._answers):
                self._answered_twice()
        self._syncs_owed = 0
        position = self._unwrapper.step(raw) * self._position_of
        # The state first: another thread must not find the old state under a new time.
        before, self.shown = self.shown, cia402.decode(statusword)
        self.reading = DriveReading(arrival_ns, statusword, position, per_mille * self.torque_of)
        if self.shown is before:
            return
        if self.shown in self._tells_mode_in and before not in self._tells_mode_in:
            self.mode_confirmed, self._tells_since_ns = False, arrival_ns
            self._reported.forget(slow_status.MODE_DISPLAY, arrival_ns)
        if self.shown is State.UNKNOWN:
            self.counters["bad_statusword"] += 1
        elif before is not State.UNKNOWN and not cia402.is_legal(before, self.shown):
            self.counters["illegal_transitions"] += 1
        self.logic.changed(before, self.shown, self.emergency or _described(self.error_code))

    def _answered_twice(self) -> None:
        """Latch what makes two answers a SYNC: somebody else's SYNC, or a second drive."""
        if self._port.counters["foreign_sync"] != self._foreign_sync:
            self.logic.latch(f"somebody else sends SYNC on {self._port.name}")
        else:
            self.doubled("two statuswords per SYNC")

    def _on_slow_status(self, data: bytes, arrival_ns: int) -> None:
        layout = slow_status.layout(self._setup.slow)
        if len(data) < layout.size:
            self.counters["wrong_length"] += 1
            return
        values = layout.unpack_from(data)
        self._reported.note(dict(zip(self._setup.slow, values, strict=True)), arrival_ns)
        self.logic.explain(_described(self.error_code))
        self.check_mode(arrival_ns)
        if not self.mode_confirmed:
            self.confirm_mode(arrival_ns)

    def poll_due(self, now_ns: int) -> bool:
        """Return whether `poll_slow` has something to ask for."""
        return self.phase is Phase.RUNNING and bool(self._reported.due(now_ns, _ASKED_AFTER_NS))

    def poll_slow(self) -> None:
        """Read what TPDO2 does not bring, or brings no more; blocking, not for the loop."""
        if self.phase is not Phase.RUNNING:
            return
        if not self._reported.ask(self.sdo, self._port.clock.now_ns(), _ASKED_AFTER_NS):
            self.counters["slow_polls_failed"] += 1
        self.check_answers()
        self.logic.explain(_described(self.error_code))
        self.check_mode(self._port.clock.now_ns())

    @property
    def _answers(self) -> tuple[int, int]:
        """Statuswords that came when they were due, and those that did not come."""
        counters = self.counters
        return counters["received"] - counters["unexpected"], counters["missing"]

    def doubled(self, shown: str) -> None:
        """Latch that more than one device obeys our commands."""
        self.logic.latch(self._twins(shown))

    def _on_sync(self, _data: bytes, arrival_ns: int) -> None:
        self.synced_ns = arrival_ns
        self._syncs_owed += 1
        if self._syncs_owed > self.settings.sync_divider:
            self.counters["missing"] += 1
            self._syncs_owed = 1

    def reported(self, emergency: Emergency) -> None:
        """Explain a fault by an emergency; while enabled, it stops the drive."""
        self._reported.note({slow_status.ERROR_CODE: emergency.code}, self._port.clock.now_ns())
        self.logic.explain(self.emergency)
        if self.logic.enabling:
            self.logic.latch(f"the {self.label} sent an emergency", self.emergency)


def _described(code: int) -> str:
    """Return an error code (object 603F) with its name, empty for none."""
    return f"0x{code:04X} {code_name(code)}" if code else ""
