# SPDX-License-Identifier: Apache-2.0
"""The supervisor's decision: permission to move, from the last message of every node.

A fault while a drive is enabled stops the robot and stays latched until `reset`. A fault while no
drive is enabled withholds the permission until it is over; nothing needs a latch, because enabling
is a separate act. An emergency stop always latches. `reset` is refused while the cause persists and
while a drive is still enabled: otherwise a stop could come and go between two messages, and the
drives would miss it.

All functions are pure: they take state, reports and times, and return decision and state.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

from ..settings import Setting

# Levels of screw_module_msgs/SafetyState.
OK = 0
WAITING = 1
STOPPED = 2

EARLIER = "before the supervisor was started anew: "
"""Prefix of a latched reason that is older than the supervisor's process."""

NOT_SEEN = "not seen yet"
"""End of the reason that a node has sent nothing since the supervisor was started."""

VERTICAL_DRIVE = "amplifier"
PLANAR_DRIVE = "manus"
# It clears its fault when the reset counter of safety_state rises, so its fault cannot block a
# reset.
CLEARED_BY_RESET = "impedance_controller"
ALL_NODES = ("encoder", "force_sensor", CLEARED_BY_RESET, VERTICAL_DRIVE, PLANAR_DRIVE)


class SupervisionSettings(NamedTuple):
    """Nodes that must be alive for the robot to move, and time limits."""

    required: Annotated[
        tuple[str, ...], Setting("nodes that must be alive; a robot without a plane names fewer")
    ] = ALL_NODES
    timeout: Annotated[
        float, Setting("age of a node's newest message that counts as lost", "s", 0.02, 10.0)
    ] = 0.2
    reset_grace: Annotated[
        float, Setting("time the controller has to follow a reset", "s", 0.05, 10.0)
    ] = 0.5


class NodeReport(NamedTuple):
    """State of one node now.

    seen: a message has come at least once; age: of its newest message [s]; error: /diagnostics says
    ERROR (for nodes whose messages have no fault flag); faulted: it has latched a fault; enabled:
    it lets torque pass; reason: its own text.
    """

    seen: bool
    age: float = 0.0
    error: bool = False
    faulted: bool = False
    enabled: bool = False
    reason: str = ""


class SupervisorState(NamedTuple):
    """Memory of the supervisor.

    latched: reasons of the stop, empty when there is none; estopped: emergency stop; locked: the
    pin of the vertical axis is in; enabled: a drive was enabled at the last decision; resets:
    successful resets; reset_ns: time of the last one [ns].
    """

    latched: tuple[str, ...] = ()
    estopped: bool = False
    locked: bool = False
    enabled: bool = False
    resets: int = 0
    reset_ns: int | None = None


class Decision(NamedTuple):
    """The decision, as in SafetyState; reasons: why motion is not permitted, worst first."""

    level: int
    motion_permitted: bool
    vertical_permitted: bool
    planar_permitted: bool
    reasons: tuple[str, ...]


class _Trouble(NamedTuple):
    """Fault of one node; lost: no message in time; faulty: the node reports a fault."""

    node: str
    text: str
    lost: bool
    faulty: bool


def decide(
    settings: SupervisionSettings,
    state: SupervisorState,
    reports: Mapping[str, NodeReport],
    now_ns: int,
) -> tuple[Decision, SupervisorState]:
    """Return the decision at now_ns [ns] and the next state; call it at 50 Hz and on events."""
    troubles = _troubles(settings, reports)
    serious = [t for t in troubles if not _excused(settings, state, t, now_ns)]
    enabled = _enabled_drive(settings, reports) != ""
    if serious and not state.latched and (enabled or state.enabled):
        state = state._replace(latched=tuple(t.text for t in serious))
    state = state._replace(enabled=enabled)

    reasons = ["emergency stop"] if state.estopped else []
    reasons += state.latched
    reasons += [t.text for t in sorted(troubles, key=lambda t: not t.faulty)]
    stopped = state.estopped or state.latched or any(t.faulty for t in serious)
    level = STOPPED if stopped else WAITING if troubles else OK
    ok = level == OK
    decision = Decision(
        level,
        ok,
        ok and not state.locked and VERTICAL_DRIVE in settings.required,
        ok and PLANAR_DRIVE in settings.required,
        tuple(dict.fromkeys(reasons)),
    )
    return decision, state


def estop(state: SupervisorState) -> SupervisorState:
    """Return the state after an emergency stop."""
    return state._replace(estopped=True)


def lock(state: SupervisorState, locked: bool) -> SupervisorState:
    """Return the state with the pin of the vertical axis in or out."""
    return state._replace(locked=locked)


def kept(state: SupervisorState) -> dict[str, Any]:
    """Return the state to keep over a restart of the process, for JSON; {} if there is none."""
    if not (state.estopped or state.locked or state.latched):
        return {}
    return {
        "estopped": state.estopped, "locked": state.locked, "latched": list(state.latched)
    }  # fmt: skip


def restored(values: Any) -> SupervisorState:
    """Return the initial state from the values that `kept` returned before.

    Raises ValueError for values that `kept` never returns.
    """
    if values == {}:
        return SupervisorState()
    if not isinstance(values, dict) or values.keys() != {"estopped", "locked", "latched"}:
        raise ValueError("estopped, locked and latched are wanted")
    estopped, locked, latched = values["estopped"], values["locked"], values["latched"]
    if not (isinstance(estopped, bool) and isinstance(locked, bool)):
        raise ValueError("estopped and locked must be true or false")
    if not (isinstance(latched, list) and all(isinstance(each, str) for each in latched)):
        raise ValueError("latched must be a list of texts")
    reasons = tuple(EARLIER + each.removeprefix(EARLIER) for each in latched)
    return SupervisorState(latched=reasons, estopped=estopped, locked=locked)


def reset(
    settings: SupervisionSettings,
    state: SupervisorState,
    reports: Mapping[str, NodeReport],
    now_ns: int,
) -> tuple[SupervisorState, str]:
    """Return the state after a request to reset at now_ns [ns], and why it was refused, if it was.

    A reset enables nothing: each drive stays off until it is enabled again.
    """
    drive = _enabled_drive(settings, reports)
    if drive:
        return state, f"{drive}: still enabled; disable it or wait until it has stopped"
    for trouble in _troubles(settings, reports):
        follows = trouble.node == CLEARED_BY_RESET and trouble.faulty
        if (trouble.lost or trouble.faulty) and not follows:
            return state, f"the cause persists: {trouble.text}"
    return (
        state._replace(
            latched=(), estopped=False, enabled=False, resets=state.resets + 1, reset_ns=now_ns
        ),
        "",
    )


def _troubles(settings: SupervisionSettings, reports: Mapping[str, NodeReport]) -> list[_Trouble]:
    """Return the faults of the required nodes."""
    troubles = []
    for node in settings.required:
        report = reports.get(node, NodeReport(seen=False))
        if not report.seen:
            troubles.append(_Trouble(node, f"{node}: {NOT_SEEN}", lost=False, faulty=False))
        elif not report.age <= settings.timeout:
            text = f"{node}: no message for more than {settings.timeout:g} s"
            troubles.append(_Trouble(node, text, lost=True, faulty=False))
        elif report.faulted or report.error:
            text = f"{node}: {report.reason or 'reports an error'}"
            troubles.append(_Trouble(node, text, lost=False, faulty=True))
    return troubles


def _excused(
    settings: SupervisionSettings, state: SupervisorState, trouble: _Trouble, now_ns: int
) -> bool:
    """Return whether the controller still has time to clear its fault after a reset."""
    if trouble.node != CLEARED_BY_RESET or not trouble.faulty or state.reset_ns is None:
        return False
    return 0 <= now_ns - state.reset_ns < settings.reset_grace * 1e9


def _enabled_drive(settings: SupervisionSettings, reports: Mapping[str, NodeReport]) -> str:
    """Return a required node whose last message says that torque passes, empty without one."""
    for node in settings.required:
        if node in reports and reports[node].enabled:
            return node
    return ""
