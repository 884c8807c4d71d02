# SPDX-License-Identifier: Apache-2.0
"""Converts records of a session to messages."""

from __future__ import annotations

import math
from typing import Any

from screw_module_msgs.msg import AssistanceChange, TherapySlot, TherapyState, TrialResult

from screw_module_ros.therapy.adaptation import Change
from screw_module_ros.therapy.arm import Arm
from screw_module_ros.therapy.asked import Asked
from screw_module_ros.therapy.hand import HandSample, Point
from screw_module_ros.therapy.line import SlotWish
from screw_module_ros.therapy.measures import COLUMNS, Row
from screw_module_ros.therapy.protocol import WEIGH
from screw_module_ros.therapy.session import Session
from screw_module_ros.therapy.smoothness import JERK_CUTOFF
from screw_module_ros.therapy.trial import Phase

_S = 1_000_000_000
_SLOT_NUMBERS = (
    "duration", "back_stiffness", "side_stiffness", "damping", "half_width", "end_half_width",
    "growth",
)  # fmt: skip


def fill_slot(message: TherapySlot, wish: SlotWish, support: float) -> None:
    """Write a wish into a slot message, and the support of the arm [N]."""
    plane, vertical = wish.plane, wish.vertical
    message.planar, message.vertical = plane is not None, vertical is not None
    message.start_ns, message.held = wish.start_ns or 0, [False, False]
    message.support = support
    if plane is not None:
        message.start.x, message.start.y = plane.start_x, plane.start_y
        message.target.x, message.target.y = plane.target_x, plane.target_y
    if vertical is not None:
        message.start.z, message.target.z = vertical.start_x, vertical.target_x
    if wish.hold is not None:
        (x, y, z), is_z, message.hold_stiffness = wish.hold
        message.held = [not is_z, is_z]
        if is_z:
            message.start.z = z
        else:
            message.start.x, message.start.y = x, y
    slot = plane or vertical
    for name in _SLOT_NUMBERS if slot is not None else ():
        setattr(message, name, getattr(slot, name))


def fill_state(
    message: TherapyState, session: Session, patient: str, sample: HandSample | None
) -> None:
    """Write the state of a patient's session; sample: the newest."""
    message.patient, message.protocol = patient, session.protocol.name
    message.sequence = sample.sequence if sample else 0
    message.state, message.reason = session.state, session.reason
    message.state_since = session.since
    message.trials = session.trials
    message.duration, message.side_stiffness = session.assistance
    message.hit_radius = session.protocol.rules.hit_radius
    message.rest = session.rest_left
    trial = session.trial
    message.phase, message.since = Phase.NONE, math.nan
    if trial is None:
        return
    block = session.protocol.blocks[trial.plan.block - 1]
    message.trial, message.circuit = trial.plan.number, trial.plan.circuit
    message.block, message.kind, message.assisted = block.title, block.kind, block.assisted
    message.phase = trial.phase
    _fill_points(message, trial.plan.start, trial.plan.target)
    start_ns = session.wish.start_ns
    if start_ns is not None and sample is not None and trial.phase != Phase.PREPARE:
        message.since = (sample.time_ns - start_ns) * 1e-9


def fill_arm(message: TherapyState, arm: Arm) -> None:
    """Write what is known of the arm, and where the dialogue is that weighs it."""
    message.arm, message.support = arm.refusal if arm.lowering else arm.told, arm.force
    message.arm_weight, message.arm_spread, _ = arm.weight
    if arm.weighing:
        hangs = Phase.MOVING if arm.weighing.wish.plane else Phase.NONE
        message.kind, message.phase = WEIGH, Phase.WAIT if arm.weighing.waits else hangs
    elif message.kind == WEIGH:
        message.kind, message.phase = "", Phase.NONE


def fill_asked(message: TherapyState, asked: Asked) -> None:
    """Write what the patient is asked and has told, and the therapist's word on it."""
    message.asks, message.goes_on = asked.asks, asked.goes_on
    message.pain, message.tired = asked.told["pain"], asked.told["tired"]


def result_message(result: Row, patient: str, protocol: str, side: str = "") -> TrialResult:
    """Return a trial's result as a message, without header; side: of the arm."""
    values = {name: result[name] for name in COLUMNS}
    message = TrialResult(
        patient=patient, protocol=protocol, side=side, jerk_cutoff=JERK_CUTOFF, **values
    )
    _fill_points(message, result["start"], result["target"])
    message.started.sec, message.started.nanosec = divmod(result["started_ns"], _S)
    message.ended.sec, message.ended.nanosec = divmod(result["ended_ns"], _S)
    return message


def change_message(change: Change, patient: str, protocol: str, block: int) -> AssistanceChange:
    """Return a change of assistance as a message, without header."""
    return AssistanceChange(patient=patient, protocol=protocol, **change.row(block))


def _fill_points(message: Any, start: Point, target: Point) -> None:
    message.start.x, message.start.y, message.start.z = start
    message.target.x, message.target.y, message.target.z = target
