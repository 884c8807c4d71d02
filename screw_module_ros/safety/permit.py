# SPDX-License-Identifier: Apache-2.0
"""The one gate before the drives: torque passes only while every condition of `CONDITIONS` holds.

::

              open (asked for)          every drive in operation enabled
    CLOSED ------------------> OPENING ---------------------------------> OPEN: torque ramps in
       ^                          |                                        |
       +--------------------------+-------- a condition, or close -------------+

Only another `open` opens it again. A condition that latches needs `clear` before that. One thread
calls `step` before each write, and `open`, `close` and `clear` between two steps, as `loop/gate.py`
asks it to for services; any thread may read the properties.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, NamedTuple, Protocol

from ..settings import Setting
from .latch import Age, Latch

# Phases of the gate.
CLOSED = 0
OPENING = 1
OPEN = 2

NOT_ENABLED = "not enabled"
STARTING = "the drive is on its way to operation enabled"

LONGEST_STEP_NS = 20_000_000  # a longer pause counts as this one in the ramp
REFUSAL_HOLD_NS = 200_000_000
"""For so long a refusal holds, whatever another sender says meanwhile [ns]."""


class PermitSettings(NamedTuple):
    """Largest ages of command and permission; duration of the torque's ramp."""

    command_periods: Annotated[
        float, Setting("age of the newest command that closes the gate", "periods", 2.0, 1000.0)
    ] = 5.0
    safety_timeout: Annotated[
        float, Setting("age of safety_state that closes the gate", "s", 0.02, 1.0)
    ] = 0.1
    drive_timeout: Annotated[
        float, Setting("time the drive has to reach operation enabled", "s", 0.05, 10.0)
    ] = 1.0
    ramp_time: Annotated[
        float, Setting("time in which torque ramps in after enabling", "s", 0.05, 10.0)
    ] = 0.5


class Switch(Protocol):
    """What the gate needs of a drive."""

    @property
    def fault(self) -> str:
        """Why it cannot work, empty if it can."""

    @property
    def recovering(self) -> bool:
        """Whether it recovers from a fault."""

    @property
    def leaving(self) -> bool:
        """Whether it is on its way out of operation enabled."""

    def is_on(self, now_ns: int) -> bool:
        """Return whether torque may pass: it is in operation enabled, and in torque mode."""

    def is_enabled(self, now_ns: int) -> bool:
        """Return whether it is in operation enabled, by a fresh statusword, in whatever mode."""

    def refusal(self) -> str:
        """Return why it cannot be enabled now, empty if it can."""

    def request_enable(self) -> None:
        """Request operation enabled; the loop's thread calls it right after `refusal`."""

    def request_disable(self) -> None:
        """Request torque off."""

    def clear_fault(self) -> None:
        """Begin to recover from a fault."""


class Moment(NamedTuple):
    """What is known at now_ns [ns]. on: every drive is; drive_fault: of the first faulty one."""

    now_ns: int
    on: bool
    drive_fault: str


class Permit:
    """Gate and drives of one axis group: no torque passes to any drive unless it may pass to all.

    period_ns: between commands. recovery_s: longest time that a drive's recovery takes [s]. fault:
    the owner's own reason to stop. phase, scale: the gate, and its factor on the torque, 0 to 1.
    latched: `clear` is needed before `open`.
    """

    def __init__(
        self, drives: Sequence[Switch], settings: PermitSettings, period_ns: int,
        recovery_s: float = 1.0,
    ):  # fmt: skip
        self.drives = tuple(drives)
        self.fault = Latch()
        self.phase = CLOSED
        self.scale = 0.0
        self.latched = False
        self.command = Age(settings.command_periods * period_ns, period_ns)
        self.safety = Age(settings.safety_timeout * 1e9, period_ns)
        self.settings = settings
        self.recovery_s = recovery_s
        self._closed_because = NOT_ENABLED
        self._permitted = False
        self._refused_ns: int | None = None
        self._refusal = ""
        self._moment = Moment(0, False, "")
        self._since_ns = self._last_ns = 0

    def supervise(self, permitted: bool, reason: str, now_ns: int) -> None:
        """Process a safety_state that arrived at now_ns [ns]; reason: why not permitted.

        A refusal holds for a while, so that a second sender cannot override the supervisor's.
        """
        if not permitted:
            self._refused_ns, self._refusal = now_ns, reason
        self._permitted = self._refused_ns is None or now_ns - self._refused_ns > REFUSAL_HOLD_NS
        self.safety.note(now_ns)

    def missed(self, in_a_row: int, limit: int) -> None:
        """Stop with a fault after `limit` missed deadlines in a row while torque passes."""
        if self.enabled and in_a_row >= limit:
            self.fault.set(f"{in_a_row} deadlines missed in a row")

    def step(self, command_ns: int, now_ns: int) -> float:
        """Update gate and drives; return the factor on the torque, 0 to 1.

        command_ns: acquisition time of the newest command's sample [ns], 0 = none yet.
        """
        self.command.note(command_ns)
        self._moment = self._look(now_ns)
        if self.phase != CLOSED:
            against, condition = self._against()
            if condition:
                self._close(against, condition.latches)
            elif self.phase == OPENING and self._moment.on:
                self.phase, self.scale = OPEN, 0.0
            elif self.phase == OPEN:
                elapsed_ns = min(max(now_ns - self._last_ns, 0), LONGEST_STEP_NS)
                self.scale = min(1.0, self.scale + elapsed_ns * 1e-9 / self.settings.ramp_time)
        self._last_ns = now_ns
        return self.scale

    def close(self) -> None:
        """Close the gate as `disable` does, also after the loop has ended. A latch stays."""
        if self.phase == CLOSED:
            self._disable_drives()
        else:
            self._close(NOT_ENABLED, latches=False)

    def _look(self, now_ns: int) -> Moment:
        on = all(drive.is_on(now_ns) for drive in self.drives)
        return Moment(now_ns, on, self.drive_fault)

    def _against(self) -> tuple[str, Condition | None]:
        """Return the first condition that does not hold, and its reason."""
        for condition in CONDITIONS:
            if reason := condition.wrong(self, self._moment):
                return reason, condition
        return "", None

    def _close(self, reason: str, latches: bool) -> None:
        self.phase, self.scale = CLOSED, 0.0
        self.latched, self._closed_because = latches, reason
        self._disable_drives()

    def _disable_drives(self) -> None:
        for drive in self.drives:
            drive.request_disable()

    def open(self, now_ns: int) -> str:
        """Begin to open at now_ns [ns]: every drive is asked to enable, or none.

        Return why not, empty if it begins or has begun.
        """
        if self.phase != CLOSED:
            return ""
        self._moment = self._look(now_ns)
        if self.latched and not (self.fault.reason or self._moment.drive_fault):
            return f"{self._closed_because} is latched: call ~/clear_fault first"
        self.phase, self._since_ns = OPENING, now_ns
        refused, _ = self._against()
        refused = refused or next(filter(None, (drive.refusal() for drive in self.drives)), "")
        if refused:
            self.phase = CLOSED
            return refused
        self._closed_because = STARTING
        for drive in self.drives:
            drive.request_enable()
        return ""

    def clear(self, known: str) -> str:
        """Clear what is latched, and the fault `known`; return another fault, empty if none.

        The gate stays closed.
        """
        if self.phase != CLOSED or self.fault.reason != known:
            return self.fault.reason  # it has come just now
        self.fault.clear()
        self.latched, self._closed_because = False, NOT_ENABLED
        return ""

    # What any thread may read -----------------------------------------------------------------

    @property
    def unsettled(self) -> bool:
        """Whether a refusal may be over in a moment: permission or disabling are on their way."""
        return not self._permitted or any(drive.leaving for drive in self.drives)

    @property
    def drive_fault(self) -> str:
        """The fault of the first faulty drive, empty if none."""
        for drive in self.drives:
            if fault := drive.fault:
                return fault
        return ""

    @property
    def enabled(self) -> bool:
        """Whether torque passes."""
        return self.phase == OPEN

    def at_rest(self, now_ns: int) -> bool:
        """Return whether the gate is closed and no drive is in operation enabled at now_ns [ns]."""
        return self.phase == CLOSED and not any(each.is_enabled(now_ns) for each in self.drives)

    @property
    def faulted(self) -> bool:
        """Whether a fault is latched; `clear_fault` clears it."""
        return self.latched or bool(self.fault.reason or self.drive_fault)

    @property
    def reason(self) -> str:
        """Why no torque passes, empty while it does."""
        fault = self.fault.reason or self.drive_fault
        return fault or ("" if self.phase == OPEN else self._closed_because)


class Condition(NamedTuple):
    """One reason against torque.

    wrong: returns the reason at a moment, empty while the condition holds. limit: parameters that
    set it. latches: `clears` is needed before the next enable, else the enable alone. hazard: of
    docs/hazards.md.
    """

    wrong: Callable[[Permit, Moment], str]
    limit: str
    latches: bool
    clears: str
    hazard: str


def _faulty(permit: Permit, moment: Moment) -> str:
    return permit.fault.reason or moment.drive_fault


def _left(permit: Permit, moment: Moment) -> str:
    left = permit.phase == OPEN and not moment.on
    return "the drive left operation enabled by itself" if left else ""


def _unsupervised(permit: Permit, moment: Moment) -> str:
    return "" if permit.safety.fresh(moment.now_ns) else "no fresh safety_state"


def _refused(permit: Permit, moment: Moment) -> str:
    if permit._permitted:
        return ""
    if permit._refusal:
        return f"not permitted: {permit._refusal}"
    return "safety_state does not permit motion"


def _uncommanded(permit: Permit, moment: Moment) -> str:
    return "" if permit.command.fresh(moment.now_ns) else "no fresh command"


def _slow(permit: Permit, moment: Moment) -> str:
    late_ns = moment.now_ns - permit._since_ns - permit.settings.drive_timeout * 1e9
    late = permit.phase == OPENING and late_ns > 0
    return "the drive did not reach operation enabled in time" if late else ""


CONDITIONS = (
    Condition(_faulty, "", True, "~/clear_fault", "Torque without a request"),
    Condition(_left, "", True, "~/clear_fault", "Torque without a request"),
    Condition(_unsupervised, "gate.safety_timeout", True, "~/clear_fault", "Supervisor gone"),
    Condition(_refused, "", False, "supervisor/reset, ~/enable",
          "Emergency stop without effect, or undone by itself"),
    Condition(_uncommanded, "gate.command_periods", True, "~/clear_fault",
          "Controller silent, torque held"),
    Condition(_slow, "gate.drive_timeout", False, "~/enable", "Torque without a request"),
)  # fmt: skip
"""In this order: the first that does not hold is the reason."""
