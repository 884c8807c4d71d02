# SPDX-License-Identifier: Apache-2.0
"""What holds the handle: the patient, nothing, the positioning stage, or the locked rotor.

Before a fixture takes effect, the handle can be moved to a height. It moves there at
`PLACING_SPEED`, so that no sensor sees a jump.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..settings import shown
from .module import LOCKED_ROTOR, STAGE

NAMES = ("human_arm", "free", "stage", "locked_rotor")  # names by number
PLACING_SPEED = 0.1  # [m/s]
PLACED = 2e-6  # tolerance of the desired height [m]
FASTEST = 1.0  # speed of the stage [m/s]


class Fixture(NamedTuple):
    """kind: number of the fixture; locked: the pin is in; upright: +1, upside down -1;
    speed: of the stage, up positive [m/s]; target: where stage or placing end [m];
    placing: the handle is still moving to the start height of the fixture."""

    kind: int
    locked: bool
    upright: float
    speed: float
    target: float
    placing: bool

    @property
    def acting(self) -> int:
        """Number of the fixture that holds the handle now; placing acts like the stage."""
        return STAGE if self.placing else self.kind

    @property
    def pace(self) -> float:
        """Speed of stage or placing, without sign [m/s]."""
        return PLACING_SPEED if self.placing else abs(self.speed)


def changed_fixture(
    old: Fixture,
    travel: float,
    handle: float,
    name: str,
    speed: float,
    position: float,
    upside_down: bool,
    locked: bool,
) -> Fixture:
    """Return the fixture after a change as SetFixture.srv describes it.

    travel, handle: end of travel and position of the handle [m]. Raises ValueError with the
    impossible value and the reason.
    """
    if name and name not in NAMES:
        raise ValueError(f"fixture = {shown(name)}: one of {', '.join(NAMES)} is wanted")
    kind = NAMES.index(name) if name else old.kind
    placing = not math.isnan(position)
    if placing and not 0.0 <= position <= travel:
        raise ValueError(f"position = {position!r} m: between 0 and {travel:g} m is wanted")
    if not abs(speed) <= FASTEST:
        raise ValueError(f"speed = {speed!r} m/s: at most {FASTEST:g} m/s up or down is wanted")
    if locked and (kind == STAGE or placing):
        raise ValueError("with the lock pin in, no stage can move the handle: unlock first")
    if placing and kind == LOCKED_ROTOR:
        raise ValueError("with the rotor locked to the transducer there is no handle to place")
    fixture = Fixture(
        kind, bool(locked), -1.0 if upside_down else 1.0, float(speed), float(position), placing
    )
    return fixture if placing else running(fixture, travel, handle)


def running(fixture: Fixture, travel: float, handle: float) -> Fixture:
    """Return the fixture after placing: a stage moves to the end in the direction of its speed."""
    target = handle
    if fixture.speed != 0.0:
        target = travel if fixture.speed > 0.0 else 0.0
    return fixture._replace(placing=False, target=target)


def placed(fixture: Fixture, handle: float, velocity: float) -> bool:
    """Return whether placing has brought the handle [m], [m/s] to its target."""
    return abs(handle - fixture.target) < PLACED and abs(velocity) < 1e-3


def stage_velocity(
    position: float, velocity: float, speed: float, target: float, acceleration: float, dt: float
) -> float:
    """Return the positioning stage's velocity [m/s] after a substep.

    The stage moves to `target` [m] at `speed` [m/s] and stops there; its speed always allows it to
    brake with `acceleration` [m/s^2]. position [m], velocity: now [m/s], dt [s].
    """
    way = target - position
    step = acceleration * dt
    braking = math.sqrt(0.25 * step * step + 2.0 * acceleration * abs(way)) - 0.5 * step
    wanted = math.copysign(min(speed, braking, abs(way) / dt), way)
    return min(max(wanted, velocity - step), velocity + step)
