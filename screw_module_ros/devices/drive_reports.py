# SPDX-License-Identifier: Apache-2.0
"""The drive's own reports: cyclic answers, error code, mode, emergencies (CiA 402, CiA 301)."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from ..can_io.port import SYNC_ID, Port
from ..samples import DriveReading
from . import cia402
from .cia402 import Goal, State
from .drive_logic import DriveLogic, describe
from .drive_settings import DriveSettings
from .emcy import Emergency
from .motion import FULL_RANGE, Unwrapper

#: TPDO1: statusword, position [counts, wraps at 32 bit], torque [per mille of the rated torque].
_STATUS = struct.Struct("<HIh")
#: TPDO2: error code, mode display, digital inputs.
_SLOW_STATUS = struct.Struct("<HbI")
_WITHOUT_INPUTS = 3  # bytes


@dataclass
class DriveCounters:
    """Events since the driver was created.

    writes: commands sent. received: statuswords. missing: SYNCs without one. unexpected:
    statuswords without a SYNC. wrong_length: frames dropped. bad_statusword: patterns not in
    CiA 402. illegal_transitions: states that cannot follow each other. bad_torque: commands that
    were not finite. saturated: commands beyond max_torque. foreign: commands of another master.
    foreign_sdo: requests of another SDO client.
    """

    writes: int = 0
    received: int = 0
    missing: int = 0
    unexpected: int = 0
    wrong_length: int = 0
    bad_statusword: int = 0
    illegal_transitions: int = 0
    bad_torque: int = 0
    saturated: int = 0
    emcy: int = 0
    boot_ups: int = 0
    bus_errors: int = 0
    foreign: int = 0
    foreign_sdo: int = 0


class DriveReports:
    """Decodes the drive's frames and passes states and faults to its logic.

    reading: the newest cyclic answer. shown: the state in it. error_code: object 603F.
    position_of: one count of object 6064 [m or rad], direction included.
    mode_display: object 6061. digital_inputs: object 60FD. emergency: text of the last one.
    """

    def __init__(
        self,
        port: Port,
        settings: DriveSettings,
        label: str,
        logic: DriveLogic,
        counters: DriveCounters,
        position_of: float,
    ):
        self.reading: DriveReading | None = None
        self.shown = State.UNKNOWN
        self.error_code = self.mode_display = self.digital_inputs = 0
        self.emergency = ""
        self._label = label
        self._logic = logic
        self._counters = counters
        self._stale_ns = round(settings.stale_periods * 1e9 / settings.rate)
        self._divider = settings.sync_divider
        self._mode = 0
        self._torque_of = 0.0
        self._position_of = position_of
        self._unwrapper = Unwrapper(FULL_RANGE)
        self._slow_size = _SLOW_STATUS.size
        self._syncs_owed = 0
        port.subscribe(0x180 + settings.node_id, self._on_status)
        port.subscribe(0x280 + settings.node_id, self._on_slow_status)
        port.subscribe(SYNC_ID, self._on_sync)

    def configured(self, mode: int, torque_of: float, inputs: bool) -> None:
        """Set the mode in use and the torque of one per mille [Nm], direction included.

        inputs: the drive has digital inputs. The position restarts: the drive may have been
        switched off in between.
        """
        self.mode_display = self._mode = mode
        self._slow_size = _SLOW_STATUS.size if inputs else _WITHOUT_INPUTS
        self._torque_of = torque_of
        self._unwrapper = Unwrapper(FULL_RANGE)

    def restart(self) -> None:
        """Drop the states shown before a start."""
        self.reading, self.shown = None, State.UNKNOWN
        self._syncs_owed = 0

    def forget_errors(self) -> None:
        """Drop the errors from before a recovery."""
        self.emergency, self.error_code = "", 0

    def state(self, now_ns: int) -> State:
        """Return the state shown, UNKNOWN when it is older than ten periods."""
        reading = self.reading
        if reading is None or now_ns - reading.monotonic_ns > self._stale_ns:
            return State.UNKNOWN
        return self.shown

    def _on_status(self, data: bytes, arrival_ns: int) -> None:
        counters = self._counters
        if len(data) != _STATUS.size:
            counters.wrong_length += 1
            return
        statusword, raw, per_mille = _STATUS.unpack(data)
        counters.received += 1
        if not self._syncs_owed:
            counters.unexpected += 1
        self._syncs_owed = 0
        position = self._unwrapper.step(raw) * self._position_of
        self.reading = DriveReading(arrival_ns, statusword, position, per_mille * self._torque_of)
        before, self.shown = self.shown, cia402.decode(statusword)
        if self.shown is not before:
            self._changed(before, self.shown)

    def _changed(self, before: State, after: State) -> None:
        if after is State.UNKNOWN:
            self._counters.bad_statusword += 1
        elif before is not State.UNKNOWN and not cia402.is_legal(before, after):
            self._counters.illegal_transitions += 1
        self._logic.changed(before, after, self.emergency or describe(self.error_code))

    def _on_slow_status(self, data: bytes, _arrival_ns: int) -> None:
        if len(data) != self._slow_size:
            self._counters.wrong_length += 1
            return
        whole = bytes(data).ljust(_SLOW_STATUS.size, b"\0")
        self.error_code, self.mode_display, self.digital_inputs = _SLOW_STATUS.unpack(whole)
        self._logic.explain(describe(self.error_code))
        if self._enabling and self.mode_display != self._mode:
            self._logic.latch(f"the {self._label} left torque mode, 6061 is {self.mode_display}")

    def _on_sync(self, _data: bytes, _arrival_ns: int) -> None:
        self._syncs_owed += 1
        if self._syncs_owed > self._divider:
            self._counters.missing += 1
            self._syncs_owed = 1

    def on_emergency(self, emergency: Emergency) -> None:
        """Process one emergency message; while enabled, it stops the drive."""
        self._counters.emcy += 1
        self.emergency = "" if emergency.is_reset else emergency.text
        if not self.emergency:
            return
        self.error_code = emergency.code
        self._logic.explain(self.emergency)
        if self._enabling:
            self._logic.latch(f"the {self._label} sent an emergency", self.emergency)

    @property
    def _enabling(self) -> bool:
        return self._logic.goal is Goal.OPERATION_ENABLED
