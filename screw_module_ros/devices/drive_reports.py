# SPDX-License-Identifier: Apache-2.0
"""A drive's own reports: cyclic answers, error code, mode, emergencies (CiA 402, CiA 301)."""

from __future__ import annotations

from collections.abc import Mapping

from ..can_io.port import SYNC_ID, Port
from ..profiles import Profile, key_of
from ..samples import DriveReading
from ..units import from_per_mille
from . import cia402
from . import drive_setup as setup
from .canopen import CanopenDevice
from .cia402 import State
from .drive_logic import DriveLogic
from .drive_settings import BRAKE, DriveSettings
from .emcy import Emergency, code_name
from .errors import BusError, NotAnswering, Refused
from .motion import FULL_RANGE, Unwrapper

_HEARTBEATS_MISSED = 3


class DriveReports(CanopenDevice):
    """A drive that is listened to: decodes its frames, passes states and faults to `logic`.

    per_turn: change of position per turn [m or rad]. counters: those of `CanopenDevice`, received
    (statuswords), missing (SYNCs without one), unexpected (statuswords without a SYNC),
    wrong_length (frames dropped), bad_statusword (patterns not in CiA 402), illegal_transitions
    (states that cannot follow each other), slow_polls_failed (of what TPDO2 does not carry).
    logic: goal and fault of the drive. reading: the newest cyclic answer, None before the first.
    shown: the state in it. error_code, mode_display, digital_inputs: objects 603F, 6061 and 60FD,
    the newest known. torque_of: torque of one per mille [Nm], direction included.
    """

    profile = setup.PROFILE

    def __init__(
        self, port: Port, settings: DriveSettings, label: str, per_turn: float, make: Profile
    ):
        super().__init__(port, settings, label, make)
        brake = settings.stop_reaction == BRAKE
        silence = _HEARTBEATS_MISSED * settings.drive_heartbeat
        self.logic = DriveLogic(label, brake, settings.enable_timeout, silence)
        self.error_code = self.mode_display = self.digital_inputs = 0
        self.torque_of = 0.0
        self._setup = setup.DriveSetup(0, settings.rated_torque)
        self._position_of = settings.direction * per_turn / settings.counts_per_turn
        self._unwrapper = Unwrapper(FULL_RANGE)
        self._stale_ns = round(settings.stale_periods * 1e9 / settings.rate)
        self.forget_reports()
        port.subscribe(setup.status_pdo(settings).cob_id, self._on_status)
        port.subscribe(setup.slow_status_id(settings), self._on_slow_status)
        port.subscribe(SYNC_ID, self._on_sync)

    @property
    def step(self) -> float:
        """Change of position per count of object 6064 [m or rad], direction included."""
        return self._position_of

    @property
    def mode(self) -> int:
        """Mode of operation in use: 10 cyclic synchronous torque, 4 profile torque."""
        return self._setup.mode

    def expect(self, found: setup.DriveSetup) -> None:
        """Take over mode and rating; the position restarts: it may have been switched off."""
        self._setup = found
        self.mode_display = found.mode
        self.torque_of = self.settings.direction * from_per_mille(1, found.rated_torque)
        self._unwrapper = Unwrapper(FULL_RANGE)

    def forget_reports(self) -> None:
        """Drop the states shown before a start."""
        self.reading: DriveReading | None = None
        self.shown = State.UNKNOWN
        self._syncs_owed = 0

    def state(self, now_ns: int) -> State:
        """Return the drive's state, UNKNOWN when its statusword is older than ten periods."""
        reading = self.reading
        if reading is None or now_ns - reading.monotonic_ns > self._stale_ns:
            return State.UNKNOWN
        return self.shown

    def _on_status(self, data: bytes, arrival_ns: int) -> None:
        if len(data) != setup.STATUS_LAYOUT.size:
            self.counters["wrong_length"] += 1
            return
        statusword, raw, per_mille = setup.STATUS_LAYOUT.unpack(data)
        self.counters["received"] += 1
        if not self._syncs_owed:
            self.counters["unexpected"] += 1
        self._syncs_owed = 0
        position = self._unwrapper.step(raw) * self._position_of
        # The state first: another thread must not find the old state under a new time.
        before, self.shown = self.shown, cia402.decode(statusword)
        self.reading = DriveReading(arrival_ns, statusword, position, per_mille * self.torque_of)
        if self.shown is before:
            return
        if self.shown is State.UNKNOWN:
            self.counters["bad_statusword"] += 1
        elif before is not State.UNKNOWN and not cia402.is_legal(before, self.shown):
            self.counters["illegal_transitions"] += 1
        self.logic.changed(before, self.shown, self.emergency or _described(self.error_code))

    def _on_slow_status(self, data: bytes, _arrival_ns: int) -> None:
        layout = setup.slow_status_layout(self._setup.slow)
        if len(data) != layout.size:
            self.counters["wrong_length"] += 1
            return
        self._note_slow(dict(zip(self._setup.slow, layout.unpack(data), strict=True)))

    def poll_slow(self) -> None:
        """Read the slow status that this make cannot map; blocking, not for the loop."""
        mapped = [key_of(key)[0] for key in self.make.drive.slow_status]
        polled = [index for index in setup.SLOW_STATUS if index not in mapped]
        for index in polled if self.running else ():
            try:
                read = self.sdo.signed if index == setup.MODE_DISPLAY else self.sdo.unsigned
                self._note_slow({index: read(index)})
            except Refused:
                continue  # it does not have the object
            except (NotAnswering, BusError):
                self.counters["slow_polls_failed"] += 1

    def _note_slow(self, values: Mapping[int, int]) -> None:
        self.error_code = values.get(setup.ERROR_CODE, self.error_code)
        self.mode_display = values.get(setup.MODE_DISPLAY, self.mode_display)
        self.digital_inputs = values.get(setup.DIGITAL_INPUTS, self.digital_inputs)
        self.logic.explain(_described(self.error_code))
        if self.logic.enabling and self.mode_display != self.mode:
            self.logic.latch(f"the {self.label} left torque mode, 6061 is {self.mode_display}")

    def _on_sync(self, _data: bytes, _arrival_ns: int) -> None:
        self._syncs_owed += 1
        if self._syncs_owed > self.settings.sync_divider:
            self.counters["missing"] += 1
            self._syncs_owed = 1

    def reported(self, emergency: Emergency) -> None:
        """Explain a fault by an emergency; while enabled, it stops the drive."""
        self.error_code = emergency.code
        self.logic.explain(self.emergency)
        if self.logic.enabling:
            self.logic.latch(f"the {self.label} sent an emergency", self.emergency)


def _described(code: int) -> str:
    """Return an error code (object 603F) with its name, empty for none."""
    return f"0x{code:04X} {code_name(code)}" if code else ""
