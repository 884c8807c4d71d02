# SPDX-License-Identifier: Apache-2.0
"""The rotor locked to ground through the force transducer (thesis 4.1.3, appendix C.3).

The motor is off the screw; J phi'' + B phi' + K phi = T, and the transducer reads K phi.

Damping: C.3 prints B = 7.2 Nm/(rad/s). With this value the mode is heavily overdamped (damping
ratio 8.1, a slow pole at K/B = 1389 rad/s, 221 Hz). That explains why magnitude and phase fall
below 200 Hz in fig 4-9; with light damping they would rise towards the folded resonance at 400 Hz.
So the printed value is the default; a small one shows the 3600 Hz mode.

The poles are too fast for the substep, so a substep with constant torque is solved exactly. The
rotor's own breakaway torque (5.44 mNm) is left out: over the microradians of a locked rotor its
bristles, soft compared with the transducer, carry no torque.
"""

from __future__ import annotations

import cmath
from typing import Annotated, NamedTuple

from ..settings import Setting


class Transducer(NamedTuple):
    """Rotor and transducer of the locked-rotor fixture."""

    rotor_inertia: Annotated[float, Setting("motor rotor", "kg m^2", 1e-7, 1e-2)]
    stiffness: Annotated[float, Setting("transducer about z", "Nm/rad", 10.0, 1e6)]
    damping: Annotated[float, Setting("B of thesis C.3", "Nm s/rad", 0.0, 1e3)]


class RotorStep(NamedTuple):
    """Exact transition of angle and velocity over one substep; compliance [rad/Nm]."""

    angle_angle: float
    angle_velocity: float
    velocity_angle: float
    velocity_velocity: float
    compliance: float


def rotor_step_settings(t: Transducer, dt: float) -> RotorStep:
    """Return the transition over dt [s] from the closed form of the matrix exponential."""
    square = t.stiffness / t.rotor_inertia
    half = 0.5 * t.damping / t.rotor_inertia
    root = cmath.sqrt(half * half - square)
    slow, fast = -half + root, -half - root
    if abs(root) < 1e-9 * half:  # critically damped: the limit of the formulas below
        slow += 1e-6 * half
        fast -= 1e-6 * half
    slow = square / fast  # avoids the cancellation in -half + root
    a, b = cmath.exp(slow * dt), cmath.exp(fast * dt)
    gap = slow - fast
    rise = ((a - b) / gap).real
    return RotorStep(
        angle_angle=((slow * b - fast * a) / gap).real,
        angle_velocity=rise,
        velocity_angle=-square * rise,
        velocity_velocity=((slow * a - fast * b) / gap).real,
        compliance=1.0 / t.stiffness,
    )


def rotor_step(p: RotorStep, angle: float, velocity: float, torque: float) -> tuple[float, float]:
    """Return angle [rad] and velocity [rad/s] after a substep of constant torque [Nm]."""
    offset = angle - torque * p.compliance
    return (
        torque * p.compliance + p.angle_angle * offset + p.angle_velocity * velocity,
        p.velocity_angle * offset + p.velocity_velocity * velocity,
    )
