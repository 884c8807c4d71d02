# SPDX-License-Identifier: Apache-2.0
"""What a vertical law's step gets and gives, up positive: `envelope` has the step."""

from __future__ import annotations

from typing import NamedTuple


class VerticalInput(NamedTuple):
    """Inputs of one step, up positive.

    mode: constant of `modes`; position [m], velocity [m/s] of the nut; force: patient on robot,
    tared [N]; setpoint_position [m], NaN = none; setpoint_velocity
    [m/s]; active: False holds the command at zero and the set point at the measured position;
    slot_force: of a slot (`slot`) [N]; slot_weight: 0 to 1, of spring and dampers that it replaces;
    support: force that carries the hand, whatever the law asks for (`support`) [N].
    """

    mode: int
    position: float
    velocity: float
    force: float
    setpoint_position: float
    setpoint_velocity: float
    active: bool
    slot_force: float = 0.0
    slot_weight: float = 0.0
    support: float = 0.0


class VerticalOutput(NamedTuple):
    """Command and its parts.

    force: total after limits [N]; impedance, gravity, friction, feedback, carried (for the mass):
    its parts before the limits on the total [N]; saturated: a limit acted; desired_position [m],
    desired_velocity [m/s]: set point in use; share: of the force gains left by the guard, 0 to 1.
    """

    force: float
    impedance: float
    gravity: float
    friction: float
    feedback: float
    carried: float
    saturated: bool
    desired_position: float
    desired_velocity: float
    share: float = 1.0
