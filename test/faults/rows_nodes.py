# SPDX-License-Identifier: Apache-2.0
"""Rows about nodes: each one killed, frozen and stopped."""

from __future__ import annotations

from typing import NamedTuple

from row import (
    AT_ONCE,
    CLEAR,
    COMMAND,
    DYING,
    GOES_ON,
    HOME,
    LOST,
    MISSED,
    MODE,
    OFF,
    PLANE_BACK,
    PLANE_CLEAR,
    SAFETY,
    STALE,
    STOPPED,
    TARE,
    VIA_SUPERVISOR,
    Report,
    Row,
)

from screw_module_ros.graph import MODULE

GROUP = "nodes"
KILLED, FROZEN, ENDED = "killed", "frozen", "stopped"
_ACTS = {
    KILLED: "killed (SIGKILL)",
    FROZEN: "frozen (SIGSTOP), later continued",
    ENDED: "stopped (SIGTERM)",
}
_ENDING = 30  # samples for which a node still publishes after SIGTERM


class Part(NamedTuple):
    """A process and the effect of its loss.

    within: samples for the vertical axis and for the plane; mode: see `Row`; acts: the faults.
    """

    node: str
    noticed_by: str
    within: tuple[int, int]
    report: Report
    services: tuple[str, ...] = ()
    outcome: str = OFF
    mode: int = 1
    acts: tuple[str, ...] = (KILLED, FROZEN, ENDED)


_LOST = r"no message for more than"
_SENSOR = (STALE + 2 + DYING, STALE + 2 + VIA_SUPERVISOR + DYING)
_DRIVE = COMMAND + 4 + DYING  # the drive drops the torque by itself
_MISSING = LOST + 2 * 20 + 6 + DYING  # the supervisor reads and decides at 50 Hz each
_SILENT = SAFETY + 6 + DYING
_ITSELF = "the vertical drive itself: RPDO and heartbeat gone"
_AMPLIFIER = Report("supervisor", f"amplifier: {_LOST}", f"amplifier: {_LOST}")
_ENTRY = "the operator: its diagnostics entry is missing"
PARTS = (
    Part("supervisor", "amplifier, manus: safety_state is stale", (_SILENT, _SILENT),
         Report("amplifier", "no fresh safety_state"), (PLANE_CLEAR, *MISSED)),
    Part("encoder", "impedance_controller: no fresh sample", _SENSOR,
         Report("impedance_controller", "encoder: no sample", "encoder"), (HOME, *MISSED)),
    Part("force_sensor", "impedance_controller: no fresh sample", _SENSOR,
         Report("impedance_controller", "force sensor: no sample", "force"),
         (TARE, PLANE_CLEAR, *MISSED), mode=3),
    Part("impedance_controller", "amplifier: no fresh command", _SENSOR,
         Report("amplifier", "no fresh command", "amplifier|impedance_controller"),
         (MODE, *MISSED)),
    Part("amplifier", _ITSELF, (_DRIVE, _MISSING), _AMPLIFIER, (CLEAR, *STOPPED)),
    Part("module", _ITSELF, (_DRIVE, _MISSING), _AMPLIFIER, (HOME, TARE, CLEAR, PLANE_CLEAR,
         MODE, *STOPPED),
         mode=4),
    Part("manus", "the planar drives themselves; supervisor", (_MISSING, _DRIVE),
         Report("supervisor", f"manus: {_LOST}", f"manus: {_LOST}"), PLANE_BACK),
    Part("endpoint_state", _ENTRY, (0, 0), Report("endpoint_state", ""), outcome=GOES_ON,
         acts=(KILLED, FROZEN)),
    Part("session_recorder", _ENTRY, (0, 0), Report("session_recorder", ""), outcome=GOES_ON,
         acts=(KILLED, FROZEN)),
)  # fmt: skip


def _row(part: Part, act: str) -> Row:
    node = part.node

    def inject(robot) -> float:
        begin = robot.time
        {KILLED: robot.kill, FROZEN: robot.freeze, ENDED: robot.terminate}[act](node)
        return begin

    def mend(robot) -> None:
        (robot.thaw if act == FROZEN else robot.restart)(node)

    slack = _ENDING if act == ENDED else 0
    within, plane_within = (n + slack if n else 0 for n in part.within)
    return Row(
        f"{node}-{act}", GROUP, f"{node} {_ACTS[act]}", inject, part.report, part.services,
        part.noticed_by, within, plane_within, part.mode, part.outcome, mend,
        shared=None if node in MODULE.parts else MODULE,
    )  # fmt: skip


def _power_cycle(robot) -> float:
    begin = robot.time
    robot.kill("sim_rig")
    robot.restart("sim_rig")
    robot.await_restarted()
    return begin


ROWS = [_row(part, act) for part in PARTS for act in part.acts]
ROWS.append(Row(  # the loss of the rig is that of all power
    "sim_rig-killed", GROUP, "sim_rig killed (SIGKILL), all devices start again", _power_cycle,
    Report("amplifier", "drive|position|command|sample", "encoder|amplifier|manus|force"),
    (HOME, TARE, CLEAR, *PLANE_BACK), "amplifier, manus, encoder: boot-ups", AT_ONCE, AT_ONCE,
    shared=MODULE,
))  # fmt: skip
