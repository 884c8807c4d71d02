# SPDX-License-Identifier: Apache-2.0
"""Bags of a session without its samples: what the record reads, in milliseconds."""

from __future__ import annotations

import functools
import json
import math
from datetime import datetime
from pathlib import Path

from rcl_interfaces.msg import Log
from rclpy.serialization import serialize_message
from screw_module_msgs.msg import (
    EndpointState,
    ImpedanceState,
    SafetyState,
    TherapyState,
    TrialResult,
)
from session_bag import short_text

from screw_module_ros import graph
from screw_module_ros.recording.bag import Bag, Message, Topic
from screw_module_ros.recording.definitions import Definitions
from screw_module_ros.therapy.protocol_file import sha256
from screw_module_ros.therapy.session import State

_S = 1_000_000_000
MARCH = 1_772_539_500  # 2026-03-03 12:05 UTC
protocol = functools.cache(short_text)


@functools.cache
def _definition(kind: str):
    return Definitions().find(kind)


def small_bag(
    folder: Path, patient: str = "P-7K3QX", begin_s: float = MARCH, reaches=(), side: str = "left",
    acts=((State.RUNNING, ""), (State.FINISHED, "")), definition: str = "", closed: bool = True,
    hand_off=(), actions=(), software: str = "0.1.0 0123456789ab",
) -> Path:  # fmt: skip
    """Write a bag below a folder, named as a session's node names it; return it.

    reaches: fields of TrialResult, each an unassisted reach of 1 s, one each 2 s; acts: states with
    their reasons, at the beginning and after; closed: False leaves it unfinished; hand_off: times
    after the beginning [s], with whether the hand is off then; actions: time after the
    beginning [s], page, action and level of each; software: as safety_state tells it.
    """
    begun = datetime.fromtimestamp(begin_s).astimezone()
    name = f"{patient}_clock_adaptive_{begun:%Y_%m_%d-%H_%M_%S}"
    bag, text = Bag(folder / name), definition or protocol()
    bag.note("clock", {"begun": begun.isoformat()})
    bag.note("parameters", {"/endpoint_state": json.dumps({"use_sim_time": False})})
    channels = {}

    def tell(topic: str, after_s: float, message) -> None:
        kind = graph.TOPICS[topic].type
        if topic not in channels:
            channels[topic] = bag.add_topic(Topic(f"/{topic}", kind, _definition(kind)))
        at = round((begin_s + after_s) * _S)
        stamp = message.stamp if isinstance(message, Log) else message.header.stamp
        stamp.sec, stamp.nanosec = divmod(at, _S)
        bag.write([Message(channels[topic], at, at, 0, bytes(serialize_message(message)))])

    tell(graph.ENDPOINT_STATE, 0.0, EndpointState())
    tell(graph.SAFETY_STATE, 0.0, SafetyState(software=software))
    tell(graph.CONTROLLER_STATE, 0.0, ImpedanceState(law="force 1.0", calibration="SIM-0001"))
    for after_s, is_off in hand_off:
        tell(graph.CONTROLLER_STATE, after_s, ImpedanceState(hand_off=is_off))
    for after_s, page, action, level in actions:
        tell(graph.THERAPY_ACTION, after_s, Log(name=page, msg=action, level=level))
    for number, (state, reason) in enumerate(acts):
        tell(graph.THERAPY_STATE, 1.0 + 1e-3 * number, TherapyState(
            state=state, reason=reason, patient=patient, side=side, state_since=number + 1,
            definition="" if number else text, definition_sha256=sha256(text), monotonic_ns=number,
            arm_weight=18.0))  # fmt: skip
    for number, values in enumerate(reaches, 1):
        fields = {"kind": "reach", "jerk_cutoff": 6.0, "duration": 1.0, "reached": True,
                  "work_area": math.nan, "largest_force": math.nan,
                  "score": math.nan, **values}  # fmt: skip
        message = TrialResult(trial=number, block=1, circuit=1, patient=patient, **fields)
        at = round((begin_s + 2 * number) * _S)
        message.started.sec, message.started.nanosec = divmod(at, _S)
        message.ended.sec, message.ended.nanosec = divmod(at + _S, _S)
        tell(graph.THERAPY_TRIAL, 2.0 * number + 1.5, message)
    bag.flush()
    if closed:
        bag.close()
    else:
        bag.cut_back()
    return bag.folder
