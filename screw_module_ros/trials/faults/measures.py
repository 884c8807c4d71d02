# SPDX-License-Identifier: Apache-2.0
"""Measures of a row: duration of the torque, force on the patient, reported alarms."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from .limits import PERIOD
from .listener import NO_JOINT_TORQUE, NO_TORQUE, Listener, Moment
from .row import Alarm

STEP_S = 0.025
"""A change of the force on the hand within this time is a step [s]."""
LARGEST_STEP = 5.0
"""Allowed change of the force on the resting hand within `STEP_S` [N]."""
SILENT_S = 2.5
"""A node without a diagnostics entry for this time counts as silent [s]."""
LARGEST_TORQUE = 0.34
"""Torque of a command of 95 N, plus the linearization's 0.025 Nm [Nm]."""
LARGEST_JOINT_TORQUE = 26.0
"""Limit of the planar drives [Nm]."""


def vertical(moment: Moment) -> bool:
    """Return whether the vertical motor gives torque."""
    return abs(moment.torque) > NO_TORQUE


def plane(moment: Moment) -> bool:
    """Return whether a motor of the plane gives torque."""
    return max(map(abs, moment.joints)) > NO_JOINT_TORQUE


def torque_samples(
    moments: Sequence[Moment], begin: float, has_torque: Callable[[Moment], bool]
) -> float:
    """Return the number of samples from `begin` [s] to the last torque."""
    last = max((moment.time for moment in moments if has_torque(moment)), default=begin)
    return (last - begin) / PERIOD


def beyond_limits(moments: Sequence[Moment]) -> str:
    """Return which torque exceeds its limit, empty when none does."""
    if any(abs(moment.torque) > LARGEST_TORQUE for moment in moments):
        return "the vertical torque exceeds its limit"
    if any(max(map(abs, moment.joints)) > LARGEST_JOINT_TORQUE for moment in moments):
        return "a joint's torque exceeds its limit"
    return ""


def largest_step(moments: Sequence[Moment]) -> float:
    """Return the largest change of a component of the patient's force within STEP_S [N].

    The median of three samples removes a knock of 5 ms in the play between nut and handle.
    """
    largest, first = 0.0, 0
    times = [moment.time for moment in moments[1:-1]]
    forces = [_median(three) for three in zip(moments, moments[1:], moments[2:], strict=False)]
    for time_now, force in zip(times, forces, strict=True):
        while times[first] < time_now - STEP_S * 1.01:
            first += 1
        pairs = zip(forces[first], force, strict=True)
        largest = max(largest, *(abs(b - a) for a, b in pairs))
    return largest


def _median(three: Sequence[Moment]) -> tuple[float, ...]:
    return tuple(sorted(axis)[1] for axis in zip(*(one.force for one in three), strict=True))


def missing_of(alarm: Alarm, listener: Listener, facts: dict[str, str]) -> str:
    """Return the missing part of the alarm, empty if it is complete.

    facts: receives the found messages as `alarm` and `reason`.
    """
    if alarm.node and not alarm.said:
        if listener.silent_for(f"diagnostics of {alarm.node}") < SILENT_S:
            return f"{alarm.node} still publishes diagnostics"
    elif alarm.node:
        said = listener.alarms().get(alarm.node, [])
        found = [message for message in said if re.search(alarm.said, message)]
        if not found:
            return f"diagnostics of {alarm.node}: {alarm.said!r}"
        facts["alarm"] = f"{alarm.node}: {found[0]}"
    if alarm.reason:
        found = [reason for reason in listener.reasons() if re.search(alarm.reason, reason)]
        if not found:
            return f"safety_state reason {alarm.reason!r}"
        facts["reason"] = found[0]
    return ""
