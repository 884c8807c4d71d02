# SPDX-License-Identifier: Apache-2.0
"""The gate before the drive: the conditions under which torque may pass.

Torque passes only after an explicit `enable`, while commands are fresh (at most `command_periods`
old), while a fresh safety_state permits it, and while the drive is in operation enabled. Anything
else closes the gate, and only another `enable` opens it. A closing without a request stays
latched until `clear`. When the gate opens, the torque ramps in.

The functions take times as arguments; the services call `enable`, `disable` and `clear`.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..settings import Setting

# Phases of the gate.
CLOSED = 0
OPENING = 1
OPEN = 2

# Why no torque passes.
PASSING = 0
NOT_ENABLED = 1
DRIVE_STARTING = 2
NO_PERMISSION = 3
SAFETY_STALE = 4
COMMAND_STALE = 5
DRIVE_FAULT = 6
DRIVE_LEFT = 7
DRIVE_SLOW = 8

REASONS = {
    PASSING: "",
    NOT_ENABLED: "not enabled",
    DRIVE_STARTING: "the drive is on its way to operation enabled",
    NO_PERMISSION: "safety_state does not permit motion",
    SAFETY_STALE: "no fresh safety_state",
    COMMAND_STALE: "no fresh command",
    DRIVE_FAULT: "the drive reports a fault",
    DRIVE_LEFT: "the drive left operation enabled by itself",
    DRIVE_SLOW: "the drive did not reach operation enabled in time",
}

LONGEST_STEP_NS = 20_000_000  # a longer pause counts as this one in the ramp


class GateSettings(NamedTuple):
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


class GateInput(NamedTuple):
    """Inputs of the gate at one tick, times on CLOCK_MONOTONIC [ns], 0 = never.

    now_ns; command_ns: of the newest command; period_ns: between commands; safety_ns: arrival of
    the newest safety_state; permitted: what it said; drive_enabled: in operation enabled now, by a
    fresh statusword; drive_faulted: the drive driver has a fault latched.
    """

    now_ns: int
    command_ns: int
    period_ns: int
    safety_ns: int
    permitted: bool
    drive_enabled: bool
    drive_faulted: bool


class GateState(NamedTuple):
    """State of the gate.

    phase: OPEN lets torque pass, OPENING asks the drive to enable, CLOSED to disable;
    scale: factor on the torque, 0 to 1, 0 unless OPEN; reason: code in REASONS; latched: `clear` is
    needed before `enable`; since_ns: start of the phase [ns]; last_ns: last tick [ns].
    """

    phase: int
    scale: float
    reason: int
    latched: bool
    since_ns: int
    last_ns: int


GATE_CLOSED = GateState(CLOSED, 0.0, NOT_ENABLED, False, 0, 0)


def gate_step(settings: GateSettings, state: GateState, inp: GateInput) -> GateState:
    """Return the gate at this tick; call it before every write to the drive."""
    now_ns = inp.now_ns
    if state.phase == CLOSED:
        return GateState(CLOSED, 0.0, state.reason, state.latched, state.since_ns, now_ns)
    wrong = _wrong(settings, state, inp)
    if wrong != PASSING:
        asked_for = wrong == NO_PERMISSION or wrong == DRIVE_SLOW
        return GateState(CLOSED, 0.0, wrong, not asked_for, now_ns, now_ns)
    if state.phase == OPENING:
        if not inp.drive_enabled:
            return GateState(OPENING, 0.0, DRIVE_STARTING, False, state.since_ns, now_ns)
        return GateState(OPEN, 0.0, PASSING, False, now_ns, now_ns)
    elapsed_ns = min(max(now_ns - state.last_ns, 0), LONGEST_STEP_NS)
    scale = min(1.0, state.scale + elapsed_ns * 1e-9 / settings.ramp_time)
    return GateState(OPEN, scale, PASSING, False, state.since_ns, now_ns)


def enable(settings: GateSettings, state: GateState, inp: GateInput) -> tuple[GateState, str]:
    """Return the gate after a request to enable, and why it was refused, empty if it was not.

    An open or opening gate stays as it is.
    """
    if state.phase != CLOSED:
        return state, ""
    if state.latched:
        return state, f"{REASONS[state.reason]} is latched: call ~/clear_fault first"
    opening = GateState(OPENING, 0.0, DRIVE_STARTING, False, inp.now_ns, inp.now_ns)
    wrong = _wrong(settings, opening, inp)
    if wrong != PASSING:
        return state, REASONS[wrong]
    return opening, ""


def disable(state: GateState, now_ns: int) -> GateState:
    """Return the gate closed on request; a latch stays."""
    if state.phase == CLOSED:
        return state
    return GateState(CLOSED, 0.0, NOT_ENABLED, False, now_ns, now_ns)


def clear(state: GateState) -> GateState:
    """Return the gate with its latch cleared but still closed. An open gate stays as it is."""
    if state.phase != CLOSED:
        return state
    return GateState(CLOSED, 0.0, NOT_ENABLED, False, state.since_ns, state.last_ns)


def _wrong(settings: GateSettings, state: GateState, inp: GateInput) -> int:
    """Return why an open or opening gate must close, or PASSING."""
    if inp.drive_faulted:
        return DRIVE_FAULT
    if state.phase == OPEN and not inp.drive_enabled:
        return DRIVE_LEFT
    if not _fresh(inp, inp.safety_ns, int(settings.safety_timeout * 1e9)):
        return SAFETY_STALE
    if not inp.permitted:
        return NO_PERMISSION
    if not _fresh(inp, inp.command_ns, int(settings.command_periods * inp.period_ns)):
        return COMMAND_STALE
    if state.phase == OPENING and inp.now_ns - state.since_ns > settings.drive_timeout * 1e9:
        return DRIVE_SLOW
    return PASSING


def _fresh(inp: GateInput, stamp_ns: int, largest_ns: int) -> bool:
    """Return whether a stamp is neither too old nor from the future."""
    return stamp_ns > 0 and -inp.period_ns <= inp.now_ns - stamp_ns <= largest_ns
