# SPDX-License-Identifier: Apache-2.0
"""A law of the plane: what it is told of a sample, what it may ask for, what it says of itself.

As one of the vertical axis (`law`) it moves no motor: `plane_envelope.enveloped(law, arm)` is the
step that does, and it bounds whatever the law asks for. A tick calls its functions in this order,
with `own` (the law's settings) and `m` (its memory):

- `needs(own, m, sample, stiffness)`: the damper that a released handle needs with its force gains.
- `ask(own, m, sample, motion)`: the force that shall press on the hand, x and y [N].
- `help(own, m, sample, motion, pressed, share)`: the force that helps the hand against friction and
  inertia [N], told what of its wish the envelope lets press [N], and of its gains the guard, 0 to
  1, both x and y.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from .law import no_memory
from .planar_settings import PlanarSettings


class PlaneSample(NamedTuple):
    """One sample; x to the patient's right, y away from the patient, from the workspace's centre.

    dt: since the last one [s]; x, y: of the handle [m], vx, vy [m/s]; force_x, force_y: of the
    patient on the robot [N], 0 while they are not `known`; guided: share of spring and damper that
    a slot replaces, 0 to 1; helped_x, helped_y: of the last help what its limits let pass [N].
    """

    dt: float
    x: float
    y: float
    vx: float
    vy: float
    force_x: float
    force_y: float
    known: bool
    guided: float
    helped_x: float
    helped_y: float


class PlaneMotion(NamedTuple):
    """to_x, to_y [m], to_vx, to_vy [m/s]: the set point; stiffness [N/m], damping [Ns/m]: in use,
    while they follow their settings and the law's needs."""

    to_x: float
    to_y: float
    to_vx: float
    to_vy: float
    stiffness: float
    damping: float


class Needs(NamedTuple):
    """What a law's force gains need.

    damper: least one with the spring, so that a released handle comes to rest, in_slot: where a
    slot has taken the spring's place [Ns/m]; watched: weight of the gains that the guard watches
    over, 0 to 1, heard of a law that `heeds` alone.
    """

    damper: float
    in_slot: float
    watched: float


def no_needs(own: Any, m: Any, sample: PlaneSample, stiffness: float) -> Needs:
    """Need no damper."""
    return Needs(0.0, 0.0, 1.0)


def spring(own: Any, m: Any, sample: PlaneSample, motion: PlaneMotion) -> tuple[float, float]:
    """Ask for the robot's spring and damper (thesis 3.3, eq 3.3)."""
    u, now = sample, motion
    return (
        now.stiffness * (now.to_x - u.x) + now.damping * (now.to_vx - u.vx),
        now.stiffness * (now.to_y - u.y) + now.damping * (now.to_vy - u.vy),
    )


def no_help(
    own: Any, m: Any, sample: PlaneSample, motion: PlaneMotion, pressed: tuple[float, float],
    share: tuple[float, float],
) -> tuple[float, float]:  # fmt: skip
    """Help against nothing."""
    return 0.0, 0.0


def forget_nothing(own: Any, m: Any) -> None:
    """Keep the memory while no force acts."""


def settings_alone(settings: Any, plane: PlanarSettings) -> Any:
    """Return the settings: a law needs nothing else."""
    return settings


def no_objection(settings: Any) -> str:
    """Return that all settings go together."""
    return ""


@dataclass(frozen=True, eq=False)
class PlaneLaw:
    """A law of the plane, which is itself alone: another one of equal fields is another law.

    name: also the prefix of its parameters; settings: a NamedTuple of `Setting`s, whose fields
    become parameters; memory: makes the record of its memory from `own`; needs, ask, help: see the
    module's text; rest: called in place of them while no force acts, to forget the motion; own:
    makes what the functions get from the settings and those of the plane; refusal: why settings do
    not go together, empty if they do; shown: up to eight numbers of its memory, by their names,
    which are published and recorded.

    heeds: it reduces itself by `share` and needs no guard where it has no gain. The envelope does
    both for any other law; a law from outside this package cannot heed.
    """

    name: str
    settings: Any
    memory: Callable[[Any], Any] = no_memory
    needs: Callable[[Any, Any, PlaneSample, float], Needs] = no_needs
    ask: Callable[[Any, Any, PlaneSample, PlaneMotion], tuple[float, float]] = spring
    help: Callable[..., tuple[float, float]] = no_help
    rest: Callable[[Any, Any], None] = forget_nothing
    own: Callable[[Any, PlanarSettings], Any] = settings_alone
    refusal: Callable[[Any], str] = no_objection
    shown: tuple[str, ...] = ()
    heeds: bool = False


