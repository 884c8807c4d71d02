# SPDX-License-Identifier: Apache-2.0
"""The belt drive that was not built (thesis appendix D, eqs 1 to 3): motor, belt, load.

The paper prints results but no parameters. They are chosen here: belt stiffness, belt damping and
inertia from the resonance, from the damping factor at a tenth of the belt damping and from the
bandwidth without damping; the damping to ground, equal on both sides, from the bandwidth of the
whole drive. The only independent result is the bandwidth with belt damping alone.

The paper does not define its bandwidth. An undamped, freely turning system has no static gain for a
3 dB limit. Here the bandwidth is the frequency at which the load's speed per motor torque falls
below a fixed level, 1 rad/s per Nm, which only scales the inertia. We chose this definition because
the independent bandwidth then comes near the paper's.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy import signal
from scipy.optimize import brentq

LEVEL = 1.0
"""The bandwidth ends where |speed of the load / torque| falls below this [rad/s per Nm]."""
_SLOWEST, _FASTEST = 2.0 * math.pi * 0.01, 2.0 * math.pi * 1e4  # rad/s, for the search


class Belt(NamedTuple):
    """Parameters of eqs 1 to 3.

    motor, load: inertias [kg m^2]; stiffness [Nm/rad] and damping [Nm s/rad] of the belt; ground:
    damping of motor and of load to ground, each [Nm s/rad].
    """

    motor: float
    load: float
    stiffness: float
    damping: float = 0.0
    ground: float = 0.0


class Printed(NamedTuple):
    """Printed results: resonance [Hz], bandwidths [Hz], damping factor at a tenth of damping."""

    resonance: float = 3.0
    undamped: float = 10.6
    tenth_factor: float = 0.446
    whole: float = 40.0


PRINTED = Printed()


def system(belt: Belt) -> signal.StateSpace:
    """Return motor torque [Nm] -> speed of the load [rad/s]; states: both speeds and the twist."""
    return signal.StateSpace(
        [
            [-(belt.ground + belt.damping) / belt.motor, belt.damping / belt.motor,
             -belt.stiffness / belt.motor],
            [belt.damping / belt.load, -(belt.ground + belt.damping) / belt.load,
             belt.stiffness / belt.load],
            [1.0, -1.0, 0.0],
        ],
        [[1.0 / belt.motor], [0.0], [0.0]],
        [[0.0, 1.0, 0.0]],
        [[0.0]],
    )  # fmt: skip


def mode(belt: Belt) -> tuple[float, float]:
    """Return frequency [Hz] and damping factor of the twist; above 1 it does not oscillate."""
    poles = np.linalg.eigvals(system(belt).A)
    pair = poles[np.argsort(np.abs(poles))[1:]]
    if np.abs(poles.imag).max() > 0.0:
        pair = poles[np.abs(poles.imag) > 0.0]
    natural = math.sqrt(abs(np.prod(pair)))
    return natural / (2.0 * math.pi), float(-pair.sum().real / (2.0 * natural))


def bandwidth(belt: Belt) -> float:
    """Return the highest frequency [Hz] at which |speed of the load / torque| falls below LEVEL.

    Raises ValueError if there is none.
    """
    omega = np.geomspace(_SLOWEST, _FASTEST, 3000)
    above = np.flatnonzero(_gain(belt, omega) > LEVEL)
    if len(above) == 0 or above[-1] == len(omega) - 1:
        raise ValueError("the load's speed per torque does not fall through the level")
    low, high = omega[above[-1]], omega[above[-1] + 1]
    last = brentq(lambda w: float(_gain(belt, np.array([w]))[0]) - LEVEL, low, high)
    return last / (2.0 * math.pi)


def chosen(printed: Printed = PRINTED) -> Belt:
    """Return the parameters that reproduce the printed results, with equal inertias on both sides.

    Raises ValueError if there are none.
    """
    natural = 2.0 * math.pi * printed.resonance
    if printed.undamped <= printed.resonance:
        raise ValueError("the undamped bandwidth lies above the resonance")
    omega = 2.0 * math.pi * printed.undamped
    total = 1.0 / (LEVEL * omega * ((omega / natural) ** 2 - 1.0))
    reduced = total / 4.0
    damping = 10.0 * 2.0 * printed.tenth_factor * natural * reduced
    free = Belt(total / 2.0, total / 2.0, natural**2 * reduced, damping)
    most = 0.4 / LEVEL  # from 0.5 on the gain is below the level even at zero frequency

    def excess(ground: float) -> float:
        return bandwidth(free._replace(ground=ground)) - printed.whole

    if excess(0.0) < 0.0 or excess(most) > 0.0:
        raise ValueError(f"no damping to ground gives a bandwidth of {printed.whole:g} Hz")
    return free._replace(ground=brentq(excess, 0.0, most))


def _gain(belt: Belt, omega: np.ndarray) -> np.ndarray:
    """Return |speed of the load / torque| from eqs 1 to 3, the twist eliminated."""
    coupled = np.array([belt.damping, belt.stiffness])
    motor, load = np.array([belt.motor, belt.ground]), np.array([belt.load, belt.ground])
    turning = np.polymul(np.polymul(motor, load), [1.0, 0.0])  # times s
    whole = np.polyadd(turning, np.polymul(coupled, motor + load))
    return np.abs(signal.freqs(np.trim_zeros(coupled, "f"), whole, omega)[1])
