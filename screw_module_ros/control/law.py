# SPDX-License-Identifier: Apache-2.0
"""A vertical law: what it is told of a sample, what it may ask for, and what it says of itself.

A law is a few functions of numbers over its own settings and its own memory. It moves no motor:
`envelope.enveloped(law)` is the step that does, and it bounds whatever the law asks for. A tick
calls them in this order, with `own` (the law's settings) and `m` (its memory):

- `foresee(own, m, sample)`: what is fed forward on the nut [N]. The estimate of the disturbance
  takes it as known, so it comes before the estimate. (A law that `heeds` adds it to its help.)
- `ask(own, m, sample, motion)`: what shall press on the hand. The envelope bounds it, and the guard
  watches what then happens.
- `help(own, m, sample, motion, pressed)`: what helps the hand against friction and inertia, as the
  guard lets it.

All of a law is compiled where it runs in a simulation (`compiled`): its records hold numbers alone,
and its functions call functions at the top of modules and those of `math`. A law that cannot be
compiled runs on the robot all the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from .friction import FrictionModel


class Sample(NamedTuple):
    """One sample, up positive.

    dt: since the last one [s]; mode: variant of the law that is wanted, while the law fades out the
    last one that was; position of the nut [m],
    travelled: since the last sample [m], velocity [m/s]; force: patient on robot, as measured,
    handle: the same filtered [N]; share: of the force gains that the guard leaves, 0 to 1; settled:
    the law has had all of its weight at the last sample; sent: last command, after all limits [N];
    corner: by which the guard multiplies the cut-off of a leaky gain, 1 or more.
    """

    dt: float
    mode: int
    position: float
    travelled: float
    velocity: float
    force: float
    handle: float
    share: float
    settled: bool
    sent: float
    corner: float = 1.0


class Motion(NamedTuple):
    """What the envelope knows of the motion.

    to_position [m], to_velocity [m/s]: the set point; stiffness [N/m], damping [Ns/m]: in use,
    while they follow their settings; speed: of the nut, estimated, without a filter's lag [m/s];
    disturbance: on the nut, estimated [N]; foreseen: what the law has fed forward [N]; error_x,
    error_y: input and output of the filter of the force on the hand, at the last sample [N].
    """

    to_position: float
    to_velocity: float
    stiffness: float
    damping: float
    speed: float
    disturbance: float
    foreseen: float
    error_x: float
    error_y: float


class Asked(NamedTuple):
    """What shall press on the hand: `pulls` makes one.

    pull: force on the hand [N]; watched: weight of the force gains that the guard watches over,
    leaky: of those that are leaky, both 0 to 1 and heard of a law that `heeds` alone.
    """

    pull: float
    watched: float
    leaky: float


class Help(NamedTuple):
    """What helps the hand: `feeds` makes one.

    friction: against the friction, beside what was foreseen, feedback: of the handle's force [N];
    wanted: force on the hand together with what carries mass for it [N]; relief: against a force on
    the hand beyond the endpoint's limits [N], heard of a law that `heeds` alone.
    """

    friction: float
    feedback: float
    wanted: float
    relief: float


def pulls(force: float) -> Asked:
    """Ask for a force on the hand [N]."""
    return Asked(force, 1.0, 0.0)


def feeds(force: float, pressed: float) -> Help:
    """Help the hand with a force [N]; pressed: what the envelope lets press on it [N]."""
    return Help(0.0, force, pressed, 0.0)


FRICTION, MASS = "friction", "mass"
"""What a mode may use of a module's calibration."""
LINEAR = "linear"
"""How a law's gains are judged: by their largest stable values in a linear model of the loop."""


class Variant(NamedTuple):
    """One mode of a law.

    name: as shown to operators; gains: settings with which it feeds the handle's force back; force:
    it needs the force sensor, so it does not begin before the first sample; uses: of the module's
    calibration, FRICTION or MASS.
    """

    name: str
    gains: tuple[str, ...] = ()
    force: bool = False
    uses: tuple[str, ...] = ()


class Margin(NamedTuple):
    """What the largest stable value of a gain depends on.

    gain: the setting; name: of the gain in results; least, most: settings of the law, then of the
    envelope, or the `rate` of the loop, of which less, or more, makes that value smaller.
    """

    gain: str
    name: str
    least: tuple[str, ...]
    most: tuple[str, ...]


class Robot(NamedTuple):
    """What is known of the module: model of its friction, moving mass [kg] and its weight [N]."""

    friction: FrictionModel
    mass: float
    gravity: float


@dataclass(slots=True)
class Nothing:
    """The memory of a law that needs none."""

    unused: float = 0.0


def settings_alone(settings: Any, robot: Robot) -> Any:
    """Return the settings: a law needs nothing else."""
    return settings


def no_memory(own: Any) -> Nothing:
    """Return the memory of a law that needs none."""
    return Nothing()


def nothing_foreseen(own: Any, m: Any, sample: Sample) -> float:
    """Feed nothing forward."""
    return 0.0


def spring(own: Any, m: Any, sample: Sample, motion: Motion) -> Asked:
    """Ask for the robot's spring and damper (thesis 3.3, eqs 3.3 and 6.1)."""
    pull = motion.stiffness * (motion.to_position - sample.position)
    return pulls(pull + motion.damping * (motion.to_velocity - sample.velocity))


def no_help(own: Any, m: Any, sample: Sample, motion: Motion, pressed: float) -> Help:
    """Help against nothing."""
    return feeds(0.0, pressed)


def forget_nothing(own: Any, m: Any) -> None:
    """Keep the memory while no force acts."""


def no_objection(settings: Any, mode: int) -> str:
    """Return that all settings go with all modes."""
    return ""


@dataclass(frozen=True, eq=False)
class Law:
    """A law, which is itself alone: another one of equal fields is another law.

    name: also the prefix of its parameters; variants: mode -> what it is; settings: a NamedTuple of
    `Setting`s, whose fields become parameters; memory: makes the record of its memory from `own`;
    foresee, ask, help: see the module's text; rest: called in place of them while no force acts, to
    forget the motion; own: makes what the functions get from the settings and the `Robot`; refusal:
    why settings do not go with a mode, empty if they do; shown: up to eight numbers of its memory,
    by their names, which are published and recorded.

    judged: LINEAR, if the linear model of the loop is the whole of the law about any handle that is
    held: then `stability` finds limits of its gains, to which the controller keeps; empty, if
    nothing is known of them. margins: on what these limits depend; of a gain without one, on the
    rate, on what the envelope filters and estimates with, and on all other settings of the law.

    heeds: its functions fade by `Sample.mode` and reduce themselves by `Sample.share`. The envelope
    does both for any other law; a law from outside this package cannot heed.
    """

    name: str
    variants: dict[int, Variant]
    settings: Any
    memory: Callable[[Any], Any] = no_memory
    foresee: Callable[[Any, Any, Sample], float] = nothing_foreseen
    ask: Callable[[Any, Any, Sample, Motion], Asked] = spring
    help: Callable[[Any, Any, Sample, Motion, float], Help] = no_help
    rest: Callable[[Any, Any], None] = forget_nothing
    own: Callable[[Any, Robot], Any] = settings_alone
    refusal: Callable[[Any, int], str] = no_objection
    shown: tuple[str, ...] = ()
    heeds: bool = False
    judged: str = ""
    margins: tuple[Margin, ...] = ()

    @property
    def functions(self) -> tuple[Callable[..., Any], ...]:
        """Those that a tick calls."""
        return self.foresee, self.ask, self.help, self.rest
