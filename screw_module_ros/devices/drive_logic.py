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

from .cia402 import CONTROLWORD, QUICK_STOP, Goal, State
from .drive_recovery import Recovery
from .emcy import code_name
from .node import NMT_STATES, OPERATIONAL, PRE_OPERATIONAL

_RECOVERED = (State.SWITCH_ON_DISABLED, State.READY_TO_SWITCH_ON, State.SWITCHED_ON)
_FAULTY = (State.FAULT, State.FAULT_REACTION_ACTIVE)
_STOPPING = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE)
_PATIENCE_NS = 20_000_000
"""Time for which a drive may still show operation enabled after the request has ended."""
_NMT_EVERY_NS = 100_000_000


class DriveLogic:
    """Request to one drive, and the reason why it is off.

    label: name of the drive in messages. brake: a latched fault stops with the quick stop ramp
    instead of coasting. enable_timeout: limit for enabling and for recovering [s]. silence: time
    without a heartbeat after which the drive is lost [s].
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
        self._unasked_since_ns: int | None = None
        self._leaving = False
        self._intruded = self._cut_off = False
        self._nmt_stopped_ns: int | None = None

    @property
    def fault(self) -> str:
        """Why the drive is off, with the cause that the drive reports; empty while healthy."""
        return f"{self.reason}: {self._cause}" if self.reason and self._cause else self.reason

    # -- requests --------------------------------------------------------------------------------

    def start(self, now_ns: int) -> None:
        """Begin to supervise at `now_ns`; a latched fault stays."""
        self._started_ns = now_ns
        self.goal = Goal.OFF if self.reason else Goal.SWITCHED_ON

    def enable(self) -> None:
        """Request operation enabled."""
        self._enabling_since_ns = None
        self.goal = Goal.OPERATION_ENABLED

    def disable(self) -> None:
        """Request torque off."""
        if self.goal is Goal.OPERATION_ENABLED:
            self.goal = Goal.SWITCHED_ON
            self._leaving = True

    def recover(self) -> None:
        """Begin the recovery from a fault."""
        self.goal = Goal.OFF
        self.recovery.begin()

    def forget(self) -> None:
        """Drop a latched fault, after the drive has been configured again."""
        self.reason = self._cause = ""
        self._intruded = False
        self.recovery.finish()

    # -- what happens ----------------------------------------------------------------------------

    def latch(self, reason: str, cause: str = "") -> None:
        """Switch off and stay off; the first reason stays. cause: the drive's own report."""
        self.goal = Goal.OFF
        self.recovery.finish()
        if not self.reason:
            self.reason, self._cause = reason, cause

    def intruded(self, reason: str) -> None:
        """Latch that another master commands the drive. reason: the message."""
        self.latch(reason)
        self._intruded = True

    def explain(self, cause: str) -> None:
        """Add the drive's report to a fault that was latched before the report came."""
        self._cause = self._cause or cause

    def changed(self, before: State, after: State, cause: str) -> None:
        """Process a change of the drive's state."""
        if before is State.OPERATION_ENABLED and self.goal is Goal.OPERATION_ENABLED:
            reason = f"the {self._label} left operation enabled by itself, to {after.text}"
            self.latch(reason, cause)

    def step(
        self, state: State, shown: State, heard_ns: int | None, nmt: int | None, now_ns: int
    ) -> int:
        """Return the controlword for this tick.

        state: UNKNOWN when the statusword is stale. shown: state in the last statusword. heard_ns:
        arrival of the last heartbeat, None when the drive sends none. nmt: network state in it.
        now_ns: CLOCK_MONOTONIC [ns].
        """
        self._note_unasked(state, now_ns)
        silent = state is State.UNKNOWN and shown is State.OPERATION_ENABLED
        self._cut_off = silent and nmt == PRE_OPERATIONAL
        if self.recovery.active:
            self._recover(state, now_ns)
        elif not self.reason:
            self._supervise(state, shown, heard_ns, nmt, now_ns)
        if self.recovery.active:
            return self.recovery.controlword(state, now_ns)
        if self._brake and self.reason and state in _STOPPING:
            return QUICK_STOP
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

    def _note_unasked(self, state: State, now_ns: int) -> None:
        """Record since when the drive is in operation enabled without a request."""
        if state is not State.OPERATION_ENABLED:
            self._leaving = self._leaving and state is State.UNKNOWN
            self._unasked_since_ns = None
        elif self.goal is Goal.OPERATION_ENABLED:
            self._unasked_since_ns = None
        elif self._unasked_since_ns is None:
            self._unasked_since_ns = now_ns

    def _stays_enabled(self, now_ns: int) -> bool:
        since_ns = self._unasked_since_ns
        # A drive that is configured to brake on disabling may need longer.
        ramp = self._brake and self._leaving
        patience_ns = max(self._enable_ns, _PATIENCE_NS) if ramp else _PATIENCE_NS
        return since_ns is not None and now_ns - since_ns >= patience_ns

    def _supervise(
        self, state: State, shown: State, heard_ns: int | None, nmt: int | None, now_ns: int
    ) -> None:
        if state in _FAULTY:
            self.latch(f"the {self._label} is in {state.text}")
        elif heard_ns is not None and self._is_lost(heard_ns, now_ns):
            self.latch(f"the heartbeat of the {self._label} is missing")
        elif heard_ns is not None and self._fell_back(heard_ns, nmt):
            self.latch(f"the {self._label} fell back to {NMT_STATES.get(nmt, nmt)}")
        elif self._stays_enabled(now_ns):
            self.latch(f"the {self._label} is in operation enabled, but nobody asked for it")
        elif self.goal is Goal.OPERATION_ENABLED:
            self._supervise_enabling(state, shown, now_ns)

    def _is_lost(self, heard_ns: int, now_ns: int) -> bool:
        return now_ns - max(heard_ns, self._started_ns) > self._silence_ns

    def _fell_back(self, heard_ns: int, nmt: int | None) -> bool:
        # Heartbeats from before and just after the start still carry the old state.
        settled = heard_ns - self._started_ns > self._silence_ns
        return settled and nmt is not None and nmt != OPERATIONAL

    def _supervise_enabling(self, state: State, shown: State, now_ns: int) -> None:
        since_ns = self._enabling_since_ns
        if state is State.OPERATION_ENABLED or since_ns is None:
            self._enabling_since_ns = now_ns
        elif state is State.UNKNOWN and shown is State.OPERATION_ENABLED:
            self.latch(f"the {self._label} is silent: its statusword is stale")
        elif now_ns - since_ns > self._enable_ns:
            self.latch(
                f"the {self._label} did not reach operation enabled in {self._enable_timeout:g} s, "
                f"it is in {state.text}"
            )

    def _recover(self, state: State, now_ns: int) -> None:
        if state in _RECOVERED:
            self.forget()
            self.start(now_ns)
        elif self.recovery.expired(now_ns):
            self.recovery.finish()
            self.goal = Goal.OFF
            self.reason = f"the {self._label} does not recover, it is in {state.text}"


def describe(code: int) -> str:
    """Return an error code (object 603F) with its name, empty for none."""
    return f"0x{code:04X} {code_name(code)}" if code else ""
