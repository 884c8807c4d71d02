# SPDX-License-Identifier: Apache-2.0
"""Every node killed, frozen and stopped, in every control mode."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from screw_module_ros.control.modes import MODE_NAMES

from .row import GOES_ON, MISSED, OFF, Alarm, Row
from .ticks import COMMAND_S, HEARTBEAT_S, SAFETY_S, STALE, SUPERVISOR_S, samples

GROUP = "nodes"
KILLED, FROZEN, STOPPED = "killed", "frozen", "stopped"
_ENDING = 10  # samples in which a node that ends in order still speaks
_SLACK = 6  # samples: wake-ups of two processes and of the rig


class Part(NamedTuple):
    """A node and what its loss means; within: samples for the vertical axis and for the plane."""

    node: str
    noticed_by: str
    within: tuple[int, int]
    alarm: Alarm
    way_back: str
    safe: str = OFF
    blind: bool = False


_LOST = r"no message for more than"
_SILENT = 10  # periods without a statusword
_SUPERVISOR = samples(SUPERVISOR_S) + 4  # it decides at 50 Hz, the drives hear of it and stop
_SAFETY = samples(SAFETY_S)
_FOLLOWS = STALE + 10  # the other axes: fault told at 100 Hz, decided at 50 Hz
_GUARD = max(samples(COMMAND_S), samples(HEARTBEAT_S))
PARTS = (
    Part("sim_rig", "amplifier, manus: no drive answers", (_SILENT, _SILENT),
         Alarm("amplifier", "drive|position|command|sample", "encoder|amplifier|manus|force"),
         "power on; encoder/home, force_sensor/tare, clear_fault, reset, enable", OFF, True),
    Part("supervisor", "amplifier, manus: safety_state is stale", (_SAFETY, _SAFETY),
         Alarm("amplifier", "no fresh safety_state"),
         "start it; clear_fault of both drives, reset, enable"),
    Part("encoder", "impedance_controller: no fresh sample", (STALE, _FOLLOWS),
         Alarm("impedance_controller", "encoder: no sample", "encoder"),
         f"start it; encoder/home at the reference mark, {MISSED}, reset, enable"),
    Part("force_sensor", "impedance_controller: no fresh sample", (STALE, _FOLLOWS),
         Alarm("impedance_controller", "force sensor: no sample", "force"),
         f"start it; force_sensor/tare, {MISSED}, reset, enable"),
    Part("impedance_controller", "amplifier: no fresh command", (STALE, _FOLLOWS),
         Alarm("amplifier", "no fresh command", "amplifier|impedance_controller"),
         "start it; amplifier/clear_fault, reset, enable"),
    Part("amplifier", "the vertical drive itself: RPDO and heartbeat gone", (_GUARD, _SUPERVISOR),
         Alarm("supervisor", f"amplifier: {_LOST}", f"amplifier: {_LOST}"),
         "start it; clear_fault, reset, enable"),
    Part("manus", "the planar drives themselves; supervisor", (_SUPERVISOR, _GUARD),
         Alarm("supervisor", f"manus: {_LOST}", f"manus: {_LOST}"),
         "start it; manus/home at the reference mark, clear_fault, reset, enable"),
    Part("endpoint_state", "who looks: its diagnostics entry is missing", (0, 0),
         Alarm("endpoint_state", ""), "start it", GOES_ON),
    Part("session_recorder", "who looks: its diagnostics entry is missing", (0, 0),
         Alarm("session_recorder", ""), "start it", GOES_ON),
)  # fmt: skip
_ACTS = {
    KILLED: "killed (SIGKILL)",
    FROZEN: "frozen (SIGSTOP), later continued",
    STOPPED: "stopped (SIGTERM)",
}


def rows() -> Iterator[Row]:
    """Every node x signal x mode."""
    for mode in MODE_NAMES:
        for part in PARTS:
            for act in _ACTS:
                yield _row(part, act, mode)


def _row(part: Part, act: str, mode: int) -> Row:
    node = part.node

    def inject(stand) -> None:
        {KILLED: stand.kill, FROZEN: stand.freeze, STOPPED: stand.terminate}[act](node)

    def back(stand) -> None:
        if act == FROZEN:
            stand.thaw(node)
        else:
            stand.restart(node)

    slack = _SLACK + (_ENDING if act == STOPPED else 0)
    within, plane_within = (n + slack if n else 0 for n in part.within)
    return Row(
        name=f"{node}-{act}-{MODE_NAMES[mode].lower()}",
        group=GROUP,
        fault=f"{node} {_ACTS[act]}",
        inject=inject,
        back=back,
        alarm=part.alarm,
        way_back=part.way_back,
        noticed_by=part.noticed_by,
        within=within,
        plane_within=plane_within,
        mode=mode,
        safe=part.safe,
        blind=part.blind,
    )

