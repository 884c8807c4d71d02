# SPDX-License-Identifier: Apache-2.0
"""The plane's impedance at the handle, with force feedback (MIT-MANUS, thesis 3.3).

pull = stiffness (to_position - position) + damping (to_velocity - velocity), eq 3.3, of which the
envelope lets `pressed` press (thesis: Fpd).

The thesis leaves friction and mass as they are. They were specified at 0.56 to 1.11 N and 2/3 to
4/3 kg without the module (appendix D), which was estimated at 5.5 kg (2.2.4). What the hand feels
beyond -pressed is due to them, so a gain k on pressed + force, the patient's on the robot, divides
both by 1 + k, as in the vertical law (eqs 6.6 to 6.8): k w / (s + w) (pressed + force), one along x
and one along y. Without a force sample the gain fades, and the impedance is left.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..gain_guard import leaky_gain
from ..limits import slew
from ..planar_settings import PlanarSettings, least_damping
from ..plane_law import Needs, PlaneLaw, PlaneMotion, PlaneSample

GUIDED = 100.0
"""Spring of a usual slot, which is not in the input [N/m]."""


@dataclass(slots=True)
class Memory:
    """gain: k in use; error_x, error_y: pressed + force of the last sample [N]."""

    gain: float = 0.0
    error_x: float = 0.0
    error_y: float = 0.0


def rest(own: PlanarSettings, m: Memory) -> None:
    """Forget the motion."""
    m.gain = m.error_x = m.error_y = 0.0


def needs(own: PlanarSettings, m: Memory, u: PlaneSample, stiffness: float) -> Needs:
    """Take the gain a sample further; return the dampers that it needs."""
    m.gain = slew(m.gain, own.force_gain if u.known else 0.0, own.gain_rate * u.dt)
    in_slot = least_damping(own, max(stiffness, GUIDED), m.gain) if u.guided > 0.0 else 0.0
    return Needs(least_damping(own, stiffness, m.gain), in_slot, min(1.0, m.gain))


def helps(
    own: PlanarSettings, m: Memory, u: PlaneSample, now: PlaneMotion, pressed: tuple[float, float],
    share: tuple[float, float],
) -> tuple[float, float]:  # fmt: skip
    """Return the force feedback [N] (eqs 6.6 to 6.8)."""
    error_x = pressed[0] + u.force_x if u.known else 0.0
    error_y = pressed[1] + u.force_y if u.known else 0.0
    mean_x, mean_y = 0.5 * (error_x + m.error_x), 0.5 * (error_y + m.error_y)
    m.error_x, m.error_y = error_x, error_y
    return (
        leaky_gain(u.helped_x, mean_x, share[0], m.gain, own.force_cutoff, u.dt),
        leaky_gain(u.helped_y, mean_y, share[1], m.gain, own.force_cutoff, u.dt),
    )


def new_memory(own: PlanarSettings) -> Memory:
    """Return the memory before the first sample."""
    return Memory()


PLANE_IMPEDANCE = PlaneLaw(
    "impedance", PlanarSettings, new_memory, needs, help=helps, rest=rest, heeds=True
)
