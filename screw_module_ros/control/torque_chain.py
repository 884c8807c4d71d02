# SPDX-License-Identifier: Apache-2.0
"""From a force command to the torque command on the wire; every caller uses this one chain.

::

    force -> 4000 N/s -> 95 N up, 75 N down -> gate's scale -> T = F L / 2 pi (eq 5.2)
          -> I2t and peak (3.1.6) -> linearization (4.1.1) -> whole per mille of rated (6071)

Nodes, closed-loop tests, the compiled in-process loop and tests of the wire protocol call it. The
state is the heat of the motor, and for `followed` the last force.
"""

from __future__ import annotations

from typing import NamedTuple

from ..geometry import SCREW, Screw, force_to_torque
from ..safety.checks import LARGEST_COMMAND
from ..units import from_per_mille, to_per_mille
from .limits import ANY_RATE, COLD, CommandLimits, TorqueLimits, clamp, limit_torque, slew
from .linearization import IDENTITY, Linearization, torque_command

_MOMENT = 1e-3  # [s] time for which a cold motor may give its peak torque


class TorqueChain(NamedTuple):
    """Parameters of the chain.

    commands: limits of the force; limits: limits of the torque; screw: converts force to torque;
    linearization: with `IDENTITY` the command equals the torque; rated_torque: of the drive, object
    6076 [Nm].
    """

    commands: CommandLimits = CommandLimits()
    limits: TorqueLimits = TorqueLimits()
    screw: Screw = SCREW
    linearization: Linearization = IDENTITY
    rated_torque: float = 0.42  # [Nm] thesis: continuous_torque


class Commanded(NamedTuple):
    """torque: desired torque of the motor [Nm]; command: torque command to the drive, before
    rounding to whole per mille [Nm]; limited: a limit acted."""

    torque: float
    command: float
    limited: bool


def followed(chain: TorqueChain, last: float, force: float, dt: float) -> float:
    """Return the rate-limited force [N], dt [s] after the `last` one [N].

    Zero passes at once, without the rate limit.
    """
    return 0.0 if force == 0.0 else slew(last, force, chain.commands.command_rate * dt)


def commanded(
    chain: TorqueChain, heat: float, force: float, scale: float, dt: float
) -> tuple[Commanded, float]:
    """Return the torque for a force command [N], and the motor's heat dt [s] later [Nm^2].

    heat: last returned value, `COLD` at first; scale: factor of the gate, 0 to 1.
    """
    allowed = clamp(force, -chain.commands.command_down, chain.commands.command_up)
    wanted = scale * force_to_torque(allowed, chain.screw)
    made, heat = commanded_torque(chain, heat, wanted, dt)
    return Commanded(made.torque, made.command, made.limited or allowed != force), heat


def commanded_torque(
    chain: TorqueChain, heat: float, wanted: float, dt: float
) -> tuple[Commanded, float]:
    """Return the same for a desired motor torque [Nm]; see `commanded`."""
    torque, heat = limit_torque(chain.limits, heat, wanted, dt)
    # Zero stays zero whatever the map makes of it: without a command no torque.
    command = torque_command(chain.linearization, torque) if torque != 0.0 else torque
    return Commanded(torque, command, torque != wanted), heat


def excitation_chain(chain: TorqueChain) -> TorqueChain:
    """Return the chain of mode EXCITATION: a sine passes as it is, up to what the motor may give.

    No linearization, no limit of the rate; I2t stays. LARGEST_COMMAND is 0.455 Nm: the
    motor's 0.42 Nm and a dead zone. The nominal screw undoes what the controller did with it.
    """
    return chain._replace(
        commands=CommandLimits(LARGEST_COMMAND, LARGEST_COMMAND, ANY_RATE),
        screw=SCREW,
        linearization=IDENTITY,
    )


def largest_command(chain: TorqueChain) -> float:
    """Return the largest torque command [Nm] of either sign that the chain can give.

    The driver writes it to the drive as its limit, object 6072.
    """
    up, down = chain.commands.command_up, chain.commands.command_down
    return max(
        abs(commanded(chain, COLD, force, 1.0, _MOMENT)[0].command) for force in (up, -down)
    )


def on_the_wire(chain: TorqueChain, command: float) -> float:
    """Return a torque command [Nm] rounded to the resolution of object 6071."""
    return from_per_mille(to_per_mille(command, chain.rated_torque), chain.rated_torque)
