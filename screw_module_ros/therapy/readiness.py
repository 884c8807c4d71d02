# SPDX-License-Identifier: Apache-2.0
"""Checks from `endpoint_state` whether the robot is ready for a session."""

from __future__ import annotations

from collections.abc import Sequence

from .line import PLANE, SPACE, VERTICAL

SAFETY_OK = 0  # SafetyState.OK


def stop_reason(
    space: str, valid: Sequence[bool], enabled: Sequence[bool], locked: bool, safety: int
) -> str:
    """Return why a session in this space must stop, empty if it may continue.

    valid: of x, y, z; enabled: plane, vertical; locked: the vertical axis is locked by the pin;
    safety: level of SafetyState.
    """
    wants_plane, wants_vertical = space in (PLANE, SPACE), space in (VERTICAL, SPACE)
    if safety != SAFETY_OK:
        return "the robot's safety monitor permits no motion"
    if wants_plane and not (valid[0] and valid[1]):
        return "the plane's position is not known: home it"
    if wants_vertical and not valid[2]:
        return "the vertical position is not known: home it"
    if wants_vertical and locked:
        return "the vertical axis is locked"
    if wants_plane and not enabled[0]:
        return "the plane's torque is off"
    if wants_vertical and not enabled[1]:
        return "the vertical torque is off"
    return ""
