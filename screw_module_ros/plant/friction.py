# SPDX-License-Identifier: Apache-2.0
"""Friction of the screw module: the thesis's steady map and effects that the thesis left out.

The values are in `params/plant.yaml`, section `friction`. In steady motion the true friction is the
map of thesis 5.2.5: a trend over height, a ripple once per screw turn and a speed factor, one set
for motion against gravity and one for motion with it: by 5.2.4 friction seems to depend more on the
direction of gravity than on the direction on the screw, and the load is one plausible reason.
Height is clamped to the mapped range. In addition there are effects that no controller of this
project models:

- a roller ripple, four per screw turn (figs 5-7, 5-8);
- a Stribeck term, friction falling with speed in the lower half and rising in the upper half as in
  figs 5-10, 5-11; it has no mean over the height, so the map is still what averaging finds;
- stiction: below the slowest speed measured (0.5 mm/s) the map's power law, which runs to zero, is
  replaced by a rise to a breakaway level;
- presliding: an elasto-plastic bristle (dahl1968; LuGre, canudas1995; dupont2002) that
  carries the whole force. Below `ELASTIC` of the level it only bends, so it holds a smaller load
  without creep;
- load: the moment on the linear bearing, from the handle's 77.85 mm offset and from sideways force,
  raises friction above what the same speed has in the passive runs that gave the map;
- waves along the screw that no polynomial of the thesis's order follows;
- slip of the rollers: the phase of their ripple shifts with the distance travelled, so that the
  ripple does not repeat with the height;
- warm-up and wear: the level starts too high and falls with the distance travelled since power-on.

The bristle is integrated implicitly and can only lose energy, at any level and speed.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..settings import Setting

ELASTIC = 0.7  # share of the friction level up to which bristles bend and do not slip
_MM = 1000.0  # the thesis's polynomials are in mm

FifthOrder = tuple[float, float, float, float, float, float]
SeventhOrder = tuple[float, float, float, float, float, float, float, float]
"""Coefficients of a polynomial, highest power first."""


class FrictionMap(NamedTuple):
    """Steady friction in one direction with respect to gravity (thesis 5.2.5), in mm, mm/s and N.

    |friction| = F_v(v) (side (trend(z) + rotation(z) sin(2 pi z / lead + phase) - offset)), with
    F_v = low_scale v^low_power up to `knee`, slope v + intercept above. `trend` and `rotation` are
    polynomials, highest power first; below `flip_below` the rotation term changes its sign.
    """

    trend: Annotated[SeventhOrder, Setting("trend over height, 7th order, highest first", "N")]
    rotation: Annotated[FifthOrder, Setting("amplitude of the turn ripple, 5th order", "N")]
    flip_below: Annotated[float, Setting("ripple changes sign below", "mm", 0.0, 360.0)]
    side: Annotated[float, Setting("+1: force minus offset, -1: reverse", "", choices=(1.0, -1.0))]
    offset: Annotated[float, Setting("gravity in the thesis's fit", "N", 0.0, 100.0)]
    low_scale: Annotated[float, Setting("factor of the power law", "", 0.0, 10.0)]
    low_power: Annotated[float, Setting("power of the speed below the knee", "", 0.0, 2.0)]
    knee: Annotated[float, Setting("speed where line follows power law", "mm/s", 0.01, 100.0)]
    slope: Annotated[float, Setting("rise with speed above the knee", "s/mm", 0.0, 1.0)]
    intercept: Annotated[float, Setting("factor of the line at zero speed", "", 0.0, 10.0)]


class Friction(NamedTuple):
    """Friction of the vertical module; forces at the handle."""

    against: Annotated[FrictionMap, Setting("map for motion against gravity")]
    along: Annotated[FrictionMap, Setting("map for motion with gravity")]
    scale: Annotated[float, Setting("factor on both maps, 1 = the thesis's module", "", 0.1, 10.0)]
    phase: Annotated[float, Setting("phase of the turn ripple at z = 0", "rad", -10.0, 10.0)]
    range_end: Annotated[float, Setting("height where the map ends, held above", "m", 0.01, 1.0)]
    roller_amplitude: Annotated[float, Setting("ripple of four per turn", "N", 0.0, 20.0)]
    slowest: Annotated[float, Setting("speed below which stiction takes over", "m/s", 1e-5, 0.1)]
    stiction_speed: Annotated[float, Setting("speed at which stiction fades", "m/s", 1e-6, 0.01)]
    stiction: Annotated[float, Setting("breakaway over the map's level", "", 1.0, 5.0)]
    stribeck: Annotated[float, Setting("excess at the bottom, slow motion", "N", 0.0, 20.0)]
    stribeck_speed: Annotated[float, Setting("speed where half of that is gone", "m/s", 1e-4, 1.0)]
    smallest: Annotated[float, Setting("friction never falls below", "N", 0.01, 20.0)]
    stiffness: Annotated[float, Setting("bristles before slip", "N/m", 1e3, 1e8)]
    damping: Annotated[float, Setting("bristles before slip", "N s/m", 0.0, 1e5)]
    load_gain: Annotated[float, Setting("friction per bearing moment", "N/Nm", 0.0, 10.0)]
    load_time: Annotated[float, Setting("lag of the load effect", "s", 1e-4, 1.0)]
    wave: Annotated[float, Setting("amplitude of waves along the screw", "N", 0.0, 10.0)]
    wave_length: Annotated[float, Setting("of these waves", "m", 0.005, 1.0)]
    wave_phase: Annotated[float, Setting("of these waves at z = 0", "rad", -10.0, 10.0)]
    roller_phase: Annotated[float, Setting("of the rollers at power-on", "rad", -10.0, 10.0)]
    roller_slip: Annotated[float, Setting("phase lost per distance travelled", "rad/m", 0.0, 100.0)]
    cold: Annotated[float, Setting("excess of the level at power-on", "", 0.0, 2.0)]
    cold_way: Annotated[float, Setting("distance over which that excess decays", "m", 0.01, 1000.0)]


def steady_level(
    p: Friction, turn_rate: float, height: float, speed: float, against: bool, way: float = 0.0
) -> float:
    """Return |friction| at constant speed in a passive run [N], without the load effect.

    turn_rate: 2 pi / lead [rad/m]; height [m], held within the map; speed: |v| [m/s];
    against: moving against gravity; way: travelled since power-on, up and down [m].
    """
    z = min(max(height, 0.0), p.range_end)
    phase = turn_rate * z + p.phase
    sine = math.sin(phase)
    roller = p.roller_amplitude * math.sin(4.0 * phase + p.roller_phase + p.roller_slip * way)
    moving = max(speed, p.slowest) * _MM
    if against:
        place = _place(p.against, z * _MM, sine)
        factor = _speed_factor(p.against, moving)
    else:
        place = _place(p.along, z * _MM, sine)
        factor = _speed_factor(p.along, moving)
    place = p.scale * place + roller
    place += p.wave * math.sin(2.0 * math.pi * z / p.wave_length + p.wave_phase)
    place *= 1.0 + p.cold * math.exp(-way / p.cold_way)
    uneven = p.stribeck * (1.0 - 2.0 * z / p.range_end)
    ratio = speed / p.stribeck_speed
    level = factor * place + uneven / (1.0 + ratio * ratio)
    if speed < p.slowest:
        breakaway = p.stiction * (place + max(uneven, 0.0))
        slowness = speed / p.stiction_speed
        level += (breakaway - level) * math.exp(-slowness * slowness)
    return max(level, p.smallest)


def _place(m: FrictionMap, z: float, sine: float) -> float:
    """Return |friction| at mean speed [N] at height z [mm]; sine: of the ripple's phase."""
    t = m.trend
    trend = ((t[0] * z + t[1]) * z + t[2]) * z + t[3]
    trend = (((trend * z + t[4]) * z + t[5]) * z + t[6]) * z + t[7]
    r = m.rotation
    ripple = (((((r[0] * z + r[1]) * z + r[2]) * z + r[3]) * z + r[4]) * z + r[5]) * sine
    if z <= m.flip_below:
        ripple = -ripple
    return m.side * (trend + ripple - m.offset)


def _speed_factor(m: FrictionMap, speed: float) -> float:
    """Return the factor F_v at a speed above zero [mm/s]."""
    if speed <= m.knee:
        return m.low_scale * speed**m.low_power
    return m.slope * speed + m.intercept


def passive_force(level: float, weight: float, against: bool) -> float:
    """Return |force at the handle| [N] of the passive run that the map was measured in (5.10).

    level: |friction| [N]; weight: of the parts that move up and down [N].
    """
    return level + weight if against else abs(level - weight)


def bristle_terms(
    stiffness: float, damping: float, bristle: float, velocity: float, level: float, dt: float
) -> tuple[float, float, float]:
    """Return (keep, slope, damping) of one implicit bristle step.

    After the step the bristle carries keep * bristle + slope * v [N], with v the velocity [m/s] at
    the end of the step; friction is that plus damping * v. The bristle slips only towards the side
    to which it is bent, and slips more the closer it is to the friction level.

    stiffness [N/m], damping [N s/m], bristle: force it carries now [N], velocity: now [m/s],
    level: |friction| in steady motion [N], dt [s]. The same in Nm and rad for a joint.
    """
    plastic = 0.0
    if bristle * velocity > 0.0:
        plastic = (abs(bristle) / level - ELASTIC) / (1.0 - ELASTIC)
        plastic = min(max(plastic, 0.0), 1.0)
    keep = 1.0 / (1.0 + plastic * stiffness * abs(velocity) * dt / level)
    return keep, keep * stiffness * dt, damping * (1.0 - plastic)


def settled_bristle(bristle: float, before: float, level: float) -> float:
    """Return the bristle force [N] after a step, limited to the friction level.

    A fast step from the elastic range could overshoot. A bristle that was already above the level
    (because the level fell) decays without the limit.
    """
    limit = max(level, abs(before))
    return min(max(bristle, -limit), limit)
