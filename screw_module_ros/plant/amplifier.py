# SPDX-License-Identifier: Apache-2.0
"""Servo amplifier BAS-10 and motor constant (thesis 3.1.6, 3.1.7, 4.1, appendix C.2).

Command [A] -> saturation and dead zone -> 60 us pure delay -> first order 1 kHz -> motor current.
The command is constant over a substep, so delay and pole are integrated exactly, also when the
delay is no multiple of the substep.

The dead zone is soft, as the crossover of a switching bridge is: with u = Kt x command,
torque = u - d tanh(sharpness u / d), d = 0.025 Nm. Near zero little comes out (slope 1 -
sharpness); beyond about 2 d the line u - d is reached (thesis figs 4-2, 4-3).
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..settings import Setting

HISTORY = 3  # earlier commands kept, so a delay of up to three substeps


class Amplifier(NamedTuple):
    """Amplifier and motor constant of the vertical module."""

    torque_constant: Annotated[float, Setting("motor, peak current", "Nm/A", 1e-3, 10.0)]
    current_limit: Annotated[float, Setting("saturation of the command", "A", 0.1, 100.0)]
    dead_zone: Annotated[float, Setting("torque lost beyond the dead zone", "Nm", 0.0, 1.0)]
    sharpness: Annotated[float, Setting("1 = no torque at all near zero", "", 0.0, 1.0)]
    delay: Annotated[float, Setting("pure delay", "s", 0.0, 1e-3)]
    bandwidth: Annotated[float, Setting("first-order pole", "Hz", 10.0, 1e5)]


class AmplifierStep(NamedTuple):
    """The amplifier discretised for one substep.

    whole: substeps of delay; early, late: parts of the substep before and after the delayed command
    changes [s]; early_decay, late_decay: of the pole over these; time: of the pole [s]; dt [s].
    """

    whole: int
    early: float
    late: float
    early_decay: float
    late_decay: float
    time: float
    dt: float


def amplifier_step_settings(a: Amplifier, dt: float) -> AmplifierStep:
    """Return the discretised amplifier for substeps of dt [s].

    Raises ValueError when the delay is longer than `HISTORY` substeps.
    """
    p = discretised(a, dt)
    if p.whole >= HISTORY:
        raise ValueError(
            f"substep = {dt:g} s is too short for the amplifier's delay of {a.delay:g} s: "
            f"at least {a.delay / HISTORY:g} s is wanted"
        )
    return p


def discretised(a: Amplifier, dt: float) -> AmplifierStep:
    """Return the discretised amplifier for substeps of dt [s] of any length: `delayed_step`."""
    whole = math.floor(a.delay / dt * (1.0 + 1e-12))
    early = max(a.delay - whole * dt, 0.0)
    late = dt - early
    time = 1.0 / (2.0 * math.pi * a.bandwidth)
    return AmplifierStep(
        whole, early, late, math.exp(-early / time), math.exp(-late / time), time, dt
    )


def bridge_current(a: Amplifier, command: float) -> float:
    """Return the current [A] the bridge settles at for a command [A]: saturation and dead zone."""
    limited = min(max(command, -a.current_limit), a.current_limit)
    if a.dead_zone == 0.0:
        return limited
    lost = a.dead_zone / a.torque_constant
    return limited - lost * math.tanh(a.sharpness * limited / lost)


def amplifier_step(
    p: AmplifierStep,
    current: float,
    command: float,
    command_1: float,
    command_2: float,
    command_3: float,
) -> tuple[float, float]:
    """Advance delay and pole by one substep.

    current: motor current [A]; command: of this substep, from `bridge_current` [A];
    command_1..3: of the substeps before [A].
    Returns (current at the end, mean current over the substep) [A].
    """
    if p.whole == 0:
        return delayed_step(p, current, command_1, command)
    if p.whole == 1:
        return delayed_step(p, current, command_2, command_1)
    return delayed_step(p, current, command_3, command_2)


def delayed_step(
    p: AmplifierStep, current: float, older: float, newer: float
) -> tuple[float, float]:
    """Advance the pole by one substep in which the delayed command goes from `older` to `newer`.

    current: motor current [A]; newer: command of `p.whole` substeps before [A]; older: of one
    substep more [A]. Returns (current at the end, mean current over the substep) [A].
    """
    change = (current - older) * (1.0 - p.early_decay)
    middle = current - change
    last = newer + (middle - newer) * p.late_decay
    mean = (older * p.early + newer * p.late + p.time * (change + middle - last)) / p.dt
    return last, mean
