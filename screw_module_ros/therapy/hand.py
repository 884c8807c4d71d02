# SPDX-License-Identifier: Apache-2.0
"""One sample of the patient's hand, from `endpoint_state`, and whether a session may use it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

Point = tuple[float, float, float]

PLANE, VERTICAL, SPACE = "plane", "vertical", "space"
AXES = {PLANE: (0, 1), VERTICAL: (2,), SPACE: (0, 1, 2)}
"""Axes of a movement, by the protocol's space."""
OTHER = {PLANE: VERTICAL, VERTICAL: PLANE}
"""Axes that a protocol does not use, by its space; in space it uses all."""

SAFETY_OK = 0  # SafetyState.OK
FARTHEST = 1.0  # [m] on any axis; larger positions are impossible on this robot
FASTEST = 10.0  # [m/s] on any axis; larger velocities are impossible


class HandSample(NamedTuple):
    """Position, velocity and force of the hand, in frame manus_base.

    sequence: its number; time_ns: acquisition on a clock that nobody sets [ns]; x, y from the
    workspace centre and z from the bottom of travel [m]; vx, vy, vz [m/s]; fx, fy, fz: force of the
    patient on the robot [N]; stop: why the session must stop, empty if it may continue; stamp_ns:
    the same moment on the system clock [ns]; others: the axes that the session does not use can be
    held, since they have torque and a known position; support: of the arm in use [N], NaN if it is
    not known.
    """

    sequence: int
    time_ns: int
    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float
    fx: float
    fy: float
    fz: float
    stop: str = ""
    stamp_ns: int = 0
    others: bool = True
    support: float = math.nan

    @property
    def position(self) -> Point:
        """Return x, y, z [m]."""
        return self[2:5]

    @property
    def velocity(self) -> Point:
        """Return vx, vy, vz [m/s]."""
        return self[5:8]

    @property
    def force(self) -> Point:
        """Return fx, fy, fz [N]."""
        return self[8:11]


def point_of(message: Any) -> Point:
    """Return x, y, z of a message that has them."""
    return message.x, message.y, message.z


def hand_sample(message: Any, space: str) -> HandSample:
    """Return the sample of an EndpointState, with the reason to stop a session in this space.

    The message may come from the graph or from a bag: a replay takes what the session took.
    Messages of older bags have no monotonic time: there the stamp counts.
    """
    p, v, f = message.position, message.velocity, message.force
    stamp_ns = ns_of(message.header.stamp)
    robot = (message.valid, message.enabled, message.vertical_locked, message.safety)
    return HandSample(
        int(message.sequence), int(getattr(message, "monotonic_ns", stamp_ns)),
        p.x, p.y, p.z, v.x, v.y, v.z, f.x, f.y, f.z,
        stop_reason(space, *robot), stamp_ns, not stop_reason(OTHER.get(space, space), *robot),
    )  # fmt: skip


def ns_of(stamp: Any) -> int:
    """Return the stamp of a message [ns]."""
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def stop_reason(
    space: str, valid: Sequence[bool], enabled: Sequence[bool], locked: bool, safety: int
) -> str:
    """Return why a session in this space must stop, empty if it may continue.

    valid: of x, y, z; enabled: plane, vertical; locked: the vertical axis is locked by the pin;
    safety: level of SafetyState.
    """
    wants_plane, wants_vertical = space != VERTICAL, space != PLANE
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


def plausible(space: str, sample: HandSample) -> bool:
    """Return whether position and velocity are possible on the axes of a space; NaN is not."""
    position, velocity = sample.position, sample.velocity
    return all(
        abs(position[a]) <= FARTHEST and abs(velocity[a]) <= FASTEST for a in AXES[space]
    )


def distance(space: str, one: Point, other: Point) -> float:
    """Return the distance of two points [m] on the axes of a space."""
    return math.sqrt(sum((one[a] - other[a]) ** 2 for a in AXES[space]))


def speed_of(space: str, sample: HandSample) -> float:
    """Return the hand's speed [m/s] on the axes of a space."""
    velocity = sample.velocity
    return math.sqrt(sum(velocity[a] ** 2 for a in AXES[space]))
