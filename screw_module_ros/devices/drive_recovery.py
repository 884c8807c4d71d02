# SPDX-License-Identifier: Apache-2.0
"""Recovery of a drive from a fault, up to switched on at most (CiA 402 transition 15).

The target torque stays zero. NMT start follows in case the drive fell back to PRE-OPERATIONAL. Then
controlword bit 7 rises; the edge repeats, because the drive refuses it while the cause persists.
"""

from __future__ import annotations

from .cia402 import DISABLE_VOLTAGE, FAULT_RESET, State

_NMT_EVERY_NS = 100_000_000
_EDGE_EVERY_NS = 50_000_000


class Recovery:
    """State of one recovery; call `controlword` once per tick while `active`.

    timeout: give up after this long [s].
    """

    def __init__(self, timeout: float):
        self.active = False
        self._timeout_ns = round(timeout * 1e9)
        self.begin()
        self.active = False

    def begin(self) -> None:
        """Start; the time limit runs from the first tick on."""
        self._begun_ns: int | None = None
        self._nmt_ns: int | None = None
        self._edge_ns: int | None = None
        self.active = True

    def finish(self) -> None:
        """End the recovery, successful or not."""
        self.active = False

    def expired(self, now_ns: int) -> bool:
        """Return whether the time limit has passed; it starts with the first call."""
        if self._begun_ns is None:
            self._begun_ns = now_ns
        return now_ns - self._begun_ns > self._timeout_ns

    def nmt_start_due(self, state: State, now_ns: int) -> bool:
        """Return whether to send NMT start: once first, then again while the drive is silent."""
        if self._nmt_ns is not None and (
            state is not State.UNKNOWN or now_ns - self._nmt_ns < _NMT_EVERY_NS
        ):
            return False
        self._nmt_ns = now_ns
        return True

    def controlword(self, state: State, now_ns: int) -> int:
        """Return the controlword in `state`: bit 7 low, then high, until the fault is gone."""
        if state is not State.FAULT:
            return DISABLE_VOLTAGE
        if self._edge_ns is None or now_ns - self._edge_ns >= _EDGE_EVERY_NS:
            self._edge_ns = now_ns
            return DISABLE_VOLTAGE
        return FAULT_RESET
