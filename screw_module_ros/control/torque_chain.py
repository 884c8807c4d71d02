# SPDX-License-Identifier: Apache-2.0
"""From a force command to the torque command that goes on the wire: the one chain there is.

::

    force -> 4000 N/s -> 95 N up, 75 N down -> gate's scale -> T = F L / 2 pi (5.2)
          -> I2t and peak (3.1.6) -> linearization (4.1.1) -> whole per mille of rated (6071)

Nodes, closed-loop tests, the compiled in-process loop and tests of the wire call it. It remembers
the heat of the motor, and `followed` the last force.
"""

from __future__ import annotations

from typing import NamedTuple

from ..geometry import SCREW, Screw, force_to_torque
from ..units import from_per_mille, to_per_mille
from .limits import CommandLimits, TorqueLimits, clamp, limit_torque, slew
from .linearization import IDENTITY, Linearization, torque_command

_MOMENT = 1e-3  # [s], in which a cold motor may give its peak torque
COLD = 0.0
"""Heat of a motor that has rested [Nm^2]."""


class TorqueChain(NamedTuple):
    """What the chain is made of.

    commands, limits: of force and of torque; screw: between them; linearized: whether the
    linearization is used; rated_torque: of the drive, object 6076 [Nm].
    """

    commands: CommandLimits = CommandLimits()
    limits: TorqueLimits = TorqueLimits()
    screw: Screw = SCREW
    linearized: bool = False
    linearization: Linearization = IDENTITY
    rated_torque: float = 0.42


class Commanded(NamedTuple):
    """torque: that the motor is to give [Nm]; command: to the drive for it, before rounding to
    whole per mille [Nm]; limited: a limit acted."""

    torque: float
    command: float
    limited: bool


def torque_chain(
    commands: CommandLimits,
    limits: TorqueLimits,
    linearization: Linearization | None,
    screw: Screw,
    rated_torque: float,
) -> TorqueChain:
    """Return the chain; a linearization of None leaves the torque as it is."""
    return TorqueChain(
        commands,
        limits,
        screw,
        linearization is not None,
        IDENTITY if linearization is None else linearization,
        rated_torque,
    )


def followed(chain: TorqueChain, last: float, force: float, dt: float) -> float:
    """Return the force [N] to act upon dt [s] after the `last` one [N]: at a limited rate.

    Zero acts at once, past the rate limit.
    """
    return 0.0 if force == 0.0 else slew(last, force, chain.commands.command_rate * dt)


def commanded(
    chain: TorqueChain, heat: float, force: float, scale: float, dt: float
) -> tuple[Commanded, float]:
    """Return what a force command [N] comes to, and the motor's heat dt [s] later [Nm^2].

    heat: as returned last, `COLD` at first; scale: the gate's, 0 to 1.
    """
    allowed = clamp(force, -chain.commands.command_down, chain.commands.command_up)
    wanted = scale * force_to_torque(allowed, chain.screw)
    made, heat = commanded_torque(chain, heat, wanted, dt)
    return Commanded(made.torque, made.command, made.limited or allowed != force), heat


def commanded_torque(
    chain: TorqueChain, heat: float, wanted: float, dt: float
) -> tuple[Commanded, float]:
    """Return the same of a motor torque [Nm]; see `commanded`."""
    torque, heat = limit_torque(chain.limits, heat, wanted, dt)
    command = torque
    if chain.linearized and torque != 0.0:
        command = torque_command(chain.linearization, torque)
    return Commanded(torque, command, torque != wanted), heat


def largest_command(chain: TorqueChain) -> float:
    """Return the largest torque command [Nm] of either sign that the chain can ask for.

    Limit written to the drive, object 6072: no command of ours is larger.
    """
    up, down = chain.commands.command_up, chain.commands.command_down
    return max(
        abs(commanded(chain, COLD, force, 1.0, _MOMENT)[0].command) for force in (up, -down)
    )


def on_the_wire(chain: TorqueChain, command: float) -> float:
    """Return a torque command [Nm] as object 6071 can hold it."""
    return from_per_mille(to_per_mille(command, chain.rated_torque), chain.rated_torque)
