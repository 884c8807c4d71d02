# SPDX-License-Identifier: Apache-2.0
"""Rows about nodes: each one killed, frozen and stopped."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from .limits import AT_ONCE, COMMAND, DYING, LOST, SAFETY, STALE, VIA_SUPERVISOR
from .row import GOES_ON, MISSED, OFF, Alarm, Row

GROUP = "nodes"
KILLED, FROZEN, STOPPED = "killed", "frozen", "stopped"
_ENDING = 30  # samples for which a node still publishes after SIGTERM


class Part(NamedTuple):
    """A process and the effect of its loss.

    within: samples for the vertical axis and for the plane; apart, mode: see `Row`; acts: the
    faults.
    """

    node: str
    noticed_by: str
    within: tuple[int, int]
    alarm: Alarm
    recovery: str
    safe: str = OFF
    apart: bool = False
    mode: int = 1
    acts: tuple[str, ...] = (KILLED, FROZEN, STOPPED)


_LOST = r"no message for more than"
_SENSOR = (STALE + 2 + DYING, STALE + 2 + VIA_SUPERVISOR + DYING)
_DRIVE = COMMAND + 4 + DYING  # the drive drops the torque by itself
_MISSING = LOST + 2 * 20 + 6 + DYING  # the supervisor reads and decides at 50 Hz each
_SILENT = SAFETY + 6 + DYING
_AMPLIFIER_BACK = "start it; clear_fault, reset, enable"
PARTS = (
    Part("supervisor", "amplifier, manus: safety_state is stale", (_SILENT, _SILENT),
         Alarm("amplifier", "no fresh safety_state"),
         "start it; clear_fault of both drives, reset, enable"),
    Part("encoder", "impedance_controller: no fresh sample", _SENSOR,
         Alarm("impedance_controller", "encoder: no sample", "encoder"),
         f"start it; encoder/home at the reference mark, {MISSED}, reset, enable", apart=True),
    Part("force_sensor", "impedance_controller: no fresh sample", _SENSOR,
         Alarm("impedance_controller", "force sensor: no sample", "force"),
         f"start it; force_sensor/tare, {MISSED}, reset, enable", apart=True, mode=3),
    Part("impedance_controller", "amplifier: no fresh command", _SENSOR,
         Alarm("amplifier", "no fresh command", "amplifier|impedance_controller"),
         "start it; amplifier/clear_fault, reset, enable", apart=True),
    Part("amplifier", "the vertical drive itself: RPDO and heartbeat gone", (_DRIVE, _MISSING),
         Alarm("supervisor", f"amplifier: {_LOST}", f"amplifier: {_LOST}"), _AMPLIFIER_BACK,
         apart=True),
    Part("module", "the vertical drive itself: RPDO and heartbeat gone", (_DRIVE, _MISSING),
         Alarm("supervisor", f"amplifier: {_LOST}", f"amplifier: {_LOST}"),
         "start it; encoder/home at the reference mark, force_sensor/tare, clear_fault, reset, "
         "enable", mode=4),
    Part("manus", "the planar drives themselves; supervisor", (_MISSING, _DRIVE),
         Alarm("supervisor", f"manus: {_LOST}", f"manus: {_LOST}"),
         "start it; manus/home at the reference mark, clear_fault, reset, enable"),
    Part("endpoint_state", "the operator: its diagnostics entry is missing", (0, 0),
         Alarm("endpoint_state", ""), "start it", GOES_ON, acts=(KILLED, FROZEN)),
    Part("session_recorder", "the operator: its diagnostics entry is missing", (0, 0),
         Alarm("session_recorder", ""), "start it", GOES_ON, acts=(KILLED, FROZEN)),
)  # fmt: skip
_ACTS = {
    KILLED: "killed (SIGKILL)",
    FROZEN: "frozen (SIGSTOP), later continued",
    STOPPED: "stopped (SIGTERM)",
}


def rows() -> Iterator[Row]:
    """Return the rows of every node x signal, and of the rig, whose loss is that of all power."""
    for part in PARTS:
        for act in part.acts:
            yield _row(part, act)
    yield Row(
        name="sim_rig-killed", group=GROUP, fault="sim_rig killed (SIGKILL): simulated time "
        "stands still, then all devices start again", inject=_power_cycle,
        alarm=Alarm("amplifier", "drive|position|command|sample", "encoder|amplifier|manus|force"),
        recovery="encoder/home, force_sensor/tare, manus/home, clear_fault, reset, enable",
        noticed_by="amplifier, manus, encoder: boot-ups", within=AT_ONCE, plane_within=AT_ONCE,
    )  # fmt: skip


def _power_cycle(testbed) -> float:
    begin = testbed.listener.time
    testbed.kill("sim_rig")
    testbed.restart("sim_rig")
    testbed.await_restarted()
    return begin


def _row(part: Part, act: str) -> Row:
    node = part.node

    def inject(testbed) -> float:
        begin = testbed.listener.time
        {KILLED: testbed.kill, FROZEN: testbed.freeze, STOPPED: testbed.terminate}[act](node)
        return begin

    def back(testbed) -> None:
        if act == FROZEN:
            testbed.thaw(node)
        else:
            testbed.restart(node)

    slack = _ENDING if act == STOPPED else 0
    within, plane_within = (n + slack if n else 0 for n in part.within)
    return Row(
        name=f"{node}-{act}",
        group=GROUP,
        fault=f"{node} {_ACTS[act]}",
        inject=inject,
        back=back,
        alarm=part.alarm,
        recovery=part.recovery,
        noticed_by=part.noticed_by,
        within=within,
        plane_within=plane_within,
        mode=part.mode,
        safe=part.safe,
        apart=part.apart,
    )
