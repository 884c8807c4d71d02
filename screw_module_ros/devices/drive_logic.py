# SPDX-License-Identifier: Apache-2.0
"""Decides the controlword of each tick: goals, latched faults, recovery. No bus, no clock.

An exit from operation enabled without a request latches a fault, also if the drive reports none; so
does a stay in operation enabled without a request. A recovery leads up to switched on at most;
enabling again is a separate act.

After a latched fault the torque must go to zero, even if another master commands the drive between
two of our commands. If the drive stays in operation enabled, or another master commands it, the
driver sends it to NMT STOPPED. There it accepts no commands (CiA 301, 7.3.2.2) and treats the
connection as lost (CiA 402, 6007): see `nmt_stop_due`. So it does with a drive that fell back to
PRE-OPERATIONAL while enabled: our commands do not reach it, but our heartbeat does, and the
deadline 1400:05 need not run there (CANopenNode clears it).
"""

from __future__ import annotations

from collections import deque

from canopen.nmt import NMT_STATES

from .canopen import OPERATIONAL, PRE_OPERATIONAL
from .cia402 import (
    CONTROLWORD,
    DISABLE_OPERATION,
    DISABLE_VOLTAGE,
    FAULT_RESET,
    QUICK_STOP,
    Goal,
    State,
)

_RECOVERED = (State.SWITCH_ON_DISABLED, State.READY_TO_SWITCH_ON, State.SWITCHED_ON)
_FAULTY = (State.FAULT, State.FAULT_REACTION_ACTIVE)
_STOPPING = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE)
_PATIENCE_NS = 20_000_000
"""Time for which a drive may still show operation enabled, or reach it, after a disabling."""
_NMT_EVERY_NS = 100_000_000
_EDGE_EVERY_NS = 50_000_000

# Of the excess torque.
_LATE_NS = 5_000_000
_SHORTEST_NS = 20_000_000
_PERIODS = 3
_ROUNDING = 1e-9


class Recovery:
    """One recovery from a fault, up to switched on at most (CiA 402 transition 15).

    The target torque stays zero. NMT start follows in case the drive fell back to PRE-OPERATIONAL.
    Then controlword bit 7 rises; the edge repeats, because the drive refuses it while the cause
    persists. timeout: give up after this long [s].
    """

    def __init__(self, timeout: float):
        self._timeout_ns = round(timeout * 1e9)
        self.begin()
        self.active = False

    def begin(self) -> None:
        """Start; the time limit runs from the first tick on."""
        self._begun_ns: int | None = None
        self._nmt_ns: int | None = None
        self._edge_ns: int | None = None
        self.active = True

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


class DriveLogic:
    """Request to one drive, and the reason why it is off.

    label: name of the drive in messages. brake: a latched fault stops with the quick stop ramp, a
    disabling with that of 605C, instead of coasting. enable_timeout: limit for enabling and for
    recovering [s]. silence: time without a heartbeat after which the drive is lost [s]. leaving: a
    disabling is under way; a new request has to wait, or the drive's obedience to the old one would
    look like an exit by itself. lost: its heartbeat was missing; a reset of its communication may
    help.
    """

    def __init__(self, label: str, brake: bool, enable_timeout: float, silence: float):
        self.goal = Goal.OFF
        self.reason = ""
        self.recovery = Recovery(enable_timeout)
        self._label = label
        self._brake = brake
        self._cause = ""
        self._enable_timeout = enable_timeout
        self._enable_ns = round(enable_timeout * 1e9)
        self._silence_ns = round(silence * 1e9)
        self._started_ns = 0
        self._enabling_since_ns: int | None = None
        self._unrequested_since_ns: int | None = None
        self._nmt_stopped_ns: int | None = None
        self._disabled_ns: int | None = None
        self.leaving = self.lost = self._intruded = self._cut_off = False

    @property
    def fault(self) -> str:
        """Why the drive is off, with the cause that the drive reports; empty while healthy."""
        return f"{self.reason}: {self._cause}" if self.reason and self._cause else self.reason

    @property
    def enabling(self) -> bool:
        """Whether operation enabled is requested."""
        return self.goal is Goal.OPERATION_ENABLED

    # -- requests --------------------------------------------------------------------------------

    def start(self, now_ns: int) -> None:
        """Begin to supervise at `now_ns`; a latched fault stays."""
        self._started_ns = now_ns
        self.leaving = False
        self.goal = Goal.OFF if self.reason else Goal.SWITCHED_ON

    def enable(self) -> None:
        """Request operation enabled; what the drive reported before explains no later fault."""
        self._enabling_since_ns = None
        if not self.reason:
            self._cause = ""
        self.goal = Goal.OPERATION_ENABLED

    def disable(self) -> None:
        """Request torque off."""
        if self.enabling:
            self.goal = Goal.SWITCHED_ON
            self.leaving, self._disabled_ns = True, None

    def recover(self) -> None:
        """Begin the recovery from a fault."""
        self.goal = Goal.OFF
        self.recovery.begin()

    def forget(self) -> None:
        """Drop a latched fault, after the drive has been configured again."""
        self.reason = self._cause = ""
        self.lost = self._intruded = self.recovery.active = False

    # -- what happens ----------------------------------------------------------------------------

    def latch(self, reason: str, cause: str = "") -> None:
        """Switch off and stay off; the first reason stays.

        cause: the drive's own report; without one, what it has reported since the enabling.
        """
        self.goal = Goal.OFF
        self.recovery.active = False
        if not self.reason:
            self.reason, self._cause = reason, cause or self._cause

    def intruded(self, reason: str) -> None:
        """Latch that another master commands the drive. reason: the message."""
        self.latch(reason)
        self._intruded = True

    def explain(self, cause: str) -> None:
        """Keep the drive's first report, for the fault that is latched or may follow."""
        self._cause = self._cause or cause

    def changed(self, before: State, after: State, cause: str) -> None:
        """Process a change of the drive's state."""
        if before is State.OPERATION_ENABLED and self.enabling:
            reason = f"the {self._label} left operation enabled by itself, to {after.text}"
            self.latch(reason, cause)

    def step(
        self, state: State, shown: State, beat_ns: int | None, nmt: int | None, now_ns: int
    ) -> int:
        """Return the controlword for this tick.

        state: UNKNOWN when the statusword is stale. shown: state in the last statusword. beat_ns:
        arrival of the last heartbeat, None when the drive sends none. nmt: network state in it.
        now_ns: CLOCK_MONOTONIC [ns].
        """
        self._update_unrequested(state, now_ns)
        self._update_leaving(state, now_ns)
        silent = state is State.UNKNOWN and shown is State.OPERATION_ENABLED
        # Without its heartbeat nobody knows whether it fell back.
        self._cut_off = silent and (nmt == PRE_OPERATIONAL or beat_ns is None)
        if self.recovery.active:
            self._recover(state, now_ns)
        elif not self.reason:
            if wrong := self._present_fault(state, beat_ns, nmt, now_ns) or (
                self._enabling_fault(state, silent, now_ns) if self.enabling else ""
            ):
                self.latch(wrong)
        if self.recovery.active:
            return self.recovery.controlword(state, now_ns)
        if self._brake and self.reason and state in _STOPPING:
            return QUICK_STOP
        if self._brake and self.goal is Goal.SWITCHED_ON and state is State.OPERATION_ENABLED:
            return DISABLE_OPERATION
        return CONTROLWORD[self.goal][state]

    def nmt_stop_due(self, now_ns: int) -> bool:
        """Return whether to send the node to NMT STOPPED now, after `step`; True every 100 ms.

        False during a recovery, which needs the drive's answers.
        """
        needed = self._intruded or self._cut_off or self._stays_enabled(now_ns)
        if not (self.reason and needed) or self.recovery.active:
            return False
        last_ns = self._nmt_stopped_ns
        if last_ns is not None and now_ns - last_ns < _NMT_EVERY_NS:
            return False
        self._nmt_stopped_ns, self._intruded = now_ns, False
        return True

    def _update_unrequested(self, state: State, now_ns: int) -> None:
        """Record since when the drive is in operation enabled without a request."""
        if state is not State.OPERATION_ENABLED or self.enabling:
            self._unrequested_since_ns = None
        elif self._unrequested_since_ns is None:
            self._unrequested_since_ns = now_ns

    def _update_leaving(self, state: State, now_ns: int) -> None:
        """End a disabling once the drive is out, and the statuswords under way have come."""
        if not self.leaving:
            return
        if self._disabled_ns is None:
            self._disabled_ns = now_ns
        out = state not in (State.OPERATION_ENABLED, State.UNKNOWN)
        self.leaving = not out or now_ns - self._disabled_ns < _PATIENCE_NS

    def _stays_enabled(self, now_ns: int) -> bool:
        since_ns = self._unrequested_since_ns
        # A drive that is configured to brake on disabling may need longer.
        ramp = self._brake and self.leaving
        patience_ns = max(self._enable_ns, _PATIENCE_NS) if ramp else _PATIENCE_NS
        return since_ns is not None and now_ns - since_ns >= patience_ns

    def _present_fault(
        self, state: State, beat_ns: int | None, nmt: int | None, now_ns: int
    ) -> str:
        """Return why the drive must be off, whatever was requested; empty if nothing is wrong."""
        if state in _FAULTY:
            return f"the {self._label} is in {state.text}"
        if beat_ns is not None:
            if now_ns - max(beat_ns, self._started_ns) > self._silence_ns:
                self.lost = state is not State.UNKNOWN  # it answers SYNC, and beats no more
                return f"the heartbeat of the {self._label} is missing"
            # Heartbeats from before and just after the start still carry the old state.
            settled = beat_ns - self._started_ns > self._silence_ns
            if settled and nmt not in (None, OPERATIONAL):
                return f"the {self._label} fell back to {NMT_STATES.get(nmt, nmt)}"
        if self._stays_enabled(now_ns):
            return f"the {self._label} is in operation enabled, but nobody asked for it"
        return ""

    def _enabling_fault(self, state: State, silent: bool, now_ns: int) -> str:
        """Return why an enabling has failed, empty if it has not."""
        since_ns = self._enabling_since_ns
        if state is State.OPERATION_ENABLED or since_ns is None:
            self._enabling_since_ns = now_ns
            return ""
        if silent:
            return f"the {self._label} is silent: its statusword is stale"
        if now_ns - since_ns > self._enable_ns:
            return (
                f"the {self._label} did not reach operation enabled in {self._enable_timeout:g} s, "
                f"it is in {state.text}"
            )
        return ""

    def _recover(self, state: State, now_ns: int) -> None:
        if state in _RECOVERED:
            self.forget()
            self.start(now_ns)
        elif self.recovery.expired(now_ns):
            self.recovery.active = False
            self.goal = Goal.OFF
            self.reason = f"the {self._label} does not recover, it is in {state.text}"


class ExcessTorque:
    """Compares the reported torque (6077) with the recent commands; all times are passed in.

    Too little torque makes a weak robot; too much, or of the wrong sign, makes a dangerous one. An
    excess above `lasting` fills a leaky bucket, a smaller one empties it. So an excess of `largest`
    is a fault after 20 ms and a smaller one later, and a mean excess above `lasting` always becomes
    a fault, also if it is intermittent.
    """

    def __init__(self, largest: float, lasting: float, period_ns: int):
        """Start without reports: both excesses [Nm], period of the commands [ns]."""
        self._largest, self._lasting = largest, lasting
        patience_ns = max(_SHORTEST_NS, _PERIODS * period_ns)
        self._late_ns = max(_LATE_NS, _PERIODS * period_ns)
        self._longest_ns = period_ns * _PERIODS
        self._bucket = (largest - lasting) * patience_ns * (1.0 - _ROUNDING)
        self._commanded: deque[tuple[int, float]] = deque()
        self.restart()

    def restart(self) -> None:
        """Reset, while the drive is not enabled."""
        self._dose = 0.0
        self._last_ns: int | None = None
        self._commanded.clear()

    def check(self, commanded: float, reported: float, now_ns: int) -> bool:
        """Return whether the excess torque [Nm] has lasted too long at now_ns [ns].

        commanded: torque of the newest command. The drive responds with a delay: each torque
        commanded within the last 5 ms, or three periods if these are longer, counts as correct.
        """
        while self._commanded and now_ns - self._commanded[0][0] > self._late_ns:
            self._commanded.popleft()
        self._commanded.append((now_ns, commanded))
        low = high = 0.0
        for _, torque in self._commanded:
            if torque < low:
                low = torque
            elif torque > high:
                high = torque
        excess = max(reported - high, low - reported, 0.0)
        elapsed_ns = 0 if self._last_ns is None else now_ns - self._last_ns
        self._last_ns = now_ns
        fill = (min(excess, self._largest) - self._lasting) * min(elapsed_ns, self._longest_ns)
        self._dose = max(0.0, self._dose + fill)
        return self._dose >= self._bucket
