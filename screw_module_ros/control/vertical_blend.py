# SPDX-License-Identifier: Apache-2.0
"""Values and weights of the law while settings and mode change, at limited rates."""

from __future__ import annotations

from typing import NamedTuple

from .limits import slew
from .modes import uses_feedback, uses_friction, uses_impedance, uses_observer
from .vertical_settings import VerticalSettings


class Blend(NamedTuple):
    """Values and weights in use.

    stiffness [N/m], damping [Ns/m], gain [1], gravity [N]; base, friction, feedback, observer:
    weights of the parts, 0 to 1, base for spring, damper and gravity.
    """

    stiffness: float
    damping: float
    gain: float
    gravity: float
    base: float
    friction: float
    feedback: float
    observer: float


def blended(settings: VerticalSettings, blend: Blend, mode: int, dt: float) -> Blend:
    """Return the blend dt [s] later, closer to the settings and the mode."""
    share = dt / settings.fade_time
    return Blend(
        slew(blend.stiffness, settings.stiffness, settings.stiffness_rate * dt),
        slew(blend.damping, settings.damping, settings.damping_rate * dt),
        slew(blend.gain, settings.force_gain, settings.gain_rate * dt),
        slew(blend.gravity, settings.gravity, settings.gravity_rate * dt),
        slew(blend.base, 1.0 if uses_impedance(mode) else 0.0, share),
        slew(blend.friction, 1.0 if uses_friction(mode) else 0.0, share),
        slew(blend.feedback, 1.0 if uses_feedback(mode) else 0.0, share),
        # The observer starts after the other parts: until then the amplifier's ramp may reduce the
        # torque, and the observer would take that for friction.
        slew(blend.observer, 1.0 if uses_observer(mode) and blend.base == 1.0 else 0.0, share),
    )
