# SPDX-License-Identifier: Apache-2.0
"""The simulated patient: an arm whose virtual hand follows a path, and its changes at run time.

The arm is the thesis's (6.4.3): mass, spring and damper between the handle and a virtual hand that
moves on a minimum-jerk path (flashhogan1985) to a target and there follows a sine. What else a
patient is, are traits: fields of `HumanArm` that SetArm sets by name (`TRAITS`). Those that change
from substep to substep, tone, synergy and fatigue, are in `muscles.py`. A patient is a name for
all of an arm (`params/patients.yaml`), a kind one for some of its traits (`KINDS`).

The arm's mass moves with the handle. Of its `weight`, which is what it weighs at the hand, the
patient's own muscles carry the share `carried`; the rest hangs on the handle:

    hanging = weight (1 - carried)

carried = 0 is a flaccid arm, of which the handle bears all; with carried = 1 the patient holds his
arm up himself, and nothing hangs on the handle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

from ..settings import Field, Setting, fields, problem, shown

STRONGEST = 2000.0  # [N] more than spring and damper of an arm pull: it has no limit

Triple = tuple[float, float, float]
_KEEP = (math.nan, math.nan, math.nan)
_STEP_S = 1e-3  # duration of a step that has not begun yet
CIRCLE_STEP_SHARE = 0.5
"""Time of one of the steps in which a patient draws a circle, as a share of a reach's time."""
_CIRCLE_STEPS = 12  # number of steps once round


class HumanArm(NamedTuple):
    """The patient's arm at the start of the rig."""

    mass: Annotated[float, Setting("moved with the handle", "kg", 0.0, 60.0)]
    stiffness: Annotated[float, Setting("towards the virtual hand", "N/m", 0.0, 5000.0)]
    damping: Annotated[float, Setting("towards the virtual hand", "N s/m", 0.0, 500.0)]
    weight: Annotated[
        float, Setting("of all of the arm at the hand, before he carries any of it", "N", 0.0, 60.0)
    ]
    carried: Annotated[
        float, Setting("share of the weight that the patient carries himself: with 0 all hangs on "
                       "the handle, with 1 nothing", "", 0.0, 1.0)
    ]
    follows: Annotated[
        float, Setting("share of the way to where the robot is asked to go that the patient moves "
                       "his hand by himself, 0: he follows nothing", "", 0.0, 1.0)
    ]
    reach_time: Annotated[
        float, Setting("of a reach where he follows", "s", 0.1, 10.0)
    ]
    tension: Annotated[float, Setting("share of stiffness that acts", "", 0.0, 1.0)] = 1.0  # ours
    strength: Annotated[
        float, Setting("the most that spring and damper push or pull", "N", 0.0, STRONGEST)
    ] = STRONGEST  # ours
    extension: Annotated[
        float, Setting("share of the strength away from the body and up", "", 0.0, 1.0)
    ] = 1.0  # ours
    tone: Annotated[
        float, Setting("pull of stretched flexors, away from the body and faster than tone_speed",
                       "N s/m", 0.0, 300.0)
    ] = 0.0  # ours
    tone_speed: Annotated[float, Setting("where tone begins", "m/s", 0.0, 2.0)] = 0.1  # ours
    tone_delay: Annotated[float, Setting("of tone, first order", "s", 0.001, 1.0)] = 0.05  # ours
    synergy: Annotated[
        float, Setting("pull towards the body for each newton that he lifts himself, far out", "",
                       0.0, 3.0)
    ] = 0.0  # ours
    relies: Annotated[
        float, Setting("share of what the handle bears of his arm that he lifts less", "", 0.0, 1.0)
    ] = 0.0  # ours
    fatigue: Annotated[float, Setting("of active muscle", "1/s", 0.0, 1.0)] = 0.0  # ours
    recovery: Annotated[float, Setting("of tired muscle at work", "1/s", 0.0, 1.0)] = 0.0  # ours
    slack: Annotated[
        float, Setting("share of his effort that he forgets with each movement", "", 0.0, 1.0)
    ] = 0.0  # ours
    regret: Annotated[
        float, Setting("effort that he adds for each metre by which a movement missed", "1/m",
                       0.0, 100.0)
    ] = 0.0  # ours
    reaction: Annotated[
        float, Setting("until a hand at rest sets out for a new target", "s", 0.0, 10.0)
    ] = 0.0  # ours
    tremor: Annotated[
        float, Setting("amplitude of the virtual hand, on each axis", "m", 0.0, 0.05)
    ] = 0.0  # ours
    tremor_rate: Annotated[float, Setting("of the tremor", "Hz", 0.5, 20.0)] = 5.0  # ours


TRAITS: dict[str, Field] = {
    name: field for name, field in fields(HumanArm).items()
    if name not in ("mass", "stiffness", "damping")
}
"""What SetArm sets by name: a new trait is a field of `HumanArm`."""

ACTIVE, RELAXED, TREMOR, WEAK = "active", "relaxed", "tremor", "weak"
_ABLE = {"tension": 1.0, "strength": STRONGEST, "tremor": 0.0}
KINDS = {
    ACTIVE: _ABLE,
    RELAXED: {**_ABLE, "tension": 0.1},
    TREMOR: {**_ABLE, "tremor": 0.008},
    WEAK: {**_ABLE, "strength": 8.0},
}
"""Traits by the names of SetArm's `kind`; a relaxed hand also ends its sine."""


class ArmForce(NamedTuple):
    """The arm in the equations of motion, the same on every axis.

    mass [kg], stiffness [N/m], damping [N s/m], limit: of spring and damper together [N],
    weight: of what hangs on the handle [N], extension: share of the limit away and up.
    """

    mass: float
    stiffness: float
    damping: float
    limit: float
    weight: float
    extension: float = 1.0  # ours


class HandPath(NamedTuple):
    """Path of the virtual hand on one axis.

    start, target [m]; begin: time it starts [s]; duration: of the minimum-jerk part [s];
    amplitude [m] and omega [rad/s]: of the sine about the target, from then on;
    tremor: amplitude of the tremor [m], tremor_omega [rad/s].
    """

    start: float
    target: float
    begin: float
    duration: float
    amplitude: float
    omega: float
    tremor: float
    tremor_omega: float = 2.0 * math.pi * 5.0  # ours


RIGID = ArmForce(0.0, 0.0, 0.0, math.inf, 0.0)
"""The grip of a rigid hand: there is none between handle and arm."""


def soft_grip(stiffness: float, damping: float, mass: float) -> ArmForce:
    """Return the soft tissue of a hand between handle and arm, which does not slip.

    stiffness [N/m], damping [Ns/m]; mass: of what moves with the handle [kg].
    """
    return RIGID._replace(mass=mass, stiffness=stiffness, damping=damping)


def held_up(mass: float, stiffness: float, damping: float) -> ArmForce:
    """Return the arm of a patient who holds it up himself, as strong as it takes.

    mass [kg], stiffness [N/m] and damping [Ns/m]: towards the virtual hand.
    """
    return ArmForce(mass, stiffness, damping, STRONGEST, 0.0)


def arm_force(arm: HumanArm, effort: float = 1.0) -> ArmForce:
    """Return the arm for the equations of motion; effort: share of its stiffness that he makes."""
    return ArmForce(
        mass=arm.mass,
        stiffness=arm.stiffness * arm.tension * effort,
        damping=arm.damping,
        limit=arm.strength,
        weight=arm.weight * (1.0 - arm.carried),
        extension=arm.extension,
    )


def resting(position: float) -> HandPath:
    """Return the path of a virtual hand that stays at a position [m]."""
    return HandPath(position, position, 0.0, 0.0, 0.0, 0.0, 0.0)


def hand_point(path: HandPath, time: float) -> tuple[float, float]:
    """Return position [m] and velocity [m/s] of the virtual hand at a time [s]."""
    position = path.target
    velocity = 0.0
    since = time - path.begin - path.duration
    if since < 0.0:
        share = min(max((time - path.begin) / path.duration, 0.0), 1.0)
        way = path.target - path.start
        cubed = share * share * share
        position = path.start + way * cubed * (10.0 + share * (6.0 * share - 15.0))
        rest = share * (1.0 - share)
        velocity = way / path.duration * 30.0 * rest * rest
    else:
        position += path.amplitude * math.sin(path.omega * since)
        velocity += path.amplitude * path.omega * math.cos(path.omega * since)
    if path.tremor != 0.0:
        position += path.tremor * math.sin(path.tremor_omega * time)
        velocity += path.tremor * path.tremor_omega * math.cos(path.tremor_omega * time)
    return position, velocity


def spring_terms(
    arm: ArmForce,
    hand: float,
    hand_velocity: float,
    position: float,
    velocity: float,
    vigour: float = 1.0,
    extension: float = 1.0,
) -> tuple[float, float, float]:
    """Return (stiffness, damping, constant force) that act over one substep on one axis.

    An arm at its limit is a constant force. hand, position [m]; velocities [m/s]; vigour: share of
    the strength that is not tired; extension: share of it in the positive direction.
    """
    force = arm.stiffness * (hand - position) + arm.damping * (hand_velocity - velocity)
    limit = arm.limit * vigour
    if force > limit * extension:
        return 0.0, 0.0, limit * extension
    if force < -limit:
        return 0.0, 0.0, -limit
    return arm.stiffness, arm.damping, 0.0


class ArmSettings(NamedTuple):
    """A change of the patient's arm, as in SetArm.srv; NaN and '' keep the present value.

    kind: a name of `KINDS`; mass [kg], stiffness [N/m], damping [N s/m];
    target: of the virtual hand, x, y from the centre, z from the bottom [m]; duration: of the
    minimum-jerk way there, 0 = at once [s]; amplitude [m], omega [rad/s]: of the sine about the
    target from then on; traits, values: names of `TRAITS` and what each becomes, as many of either.
    patient: a name of `settings.patients`, whose arm it becomes (`another_patient`).
    """

    kind: str = ""
    mass: float = math.nan
    stiffness: float = math.nan
    damping: float = math.nan
    target: Triple = _KEEP
    duration: float = 0.0
    amplitude: Triple = (0.0, 0.0, 0.0)
    omega: Triple = (0.0, 0.0, 0.0)
    traits: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    patient: str = ""


class Patient(NamedTuple):
    """The arm, the paths of its virtual hand on x, y, z, and the effort he makes, 1 at first."""

    arm: HumanArm
    paths: tuple[HandPath, HandPath, HandPath]
    effort: float = 1.0  # ours


def resting_patient(arm: HumanArm, x: float, y: float, z: float) -> Patient:
    """Return a patient whose virtual hand stays at x, y, z [m]."""
    return _with_tremor(arm, [resting(x), resting(y), resting(z)])


def moved_patient(patient: Patient, z: float) -> Patient:
    """Return the patient with the virtual hand resting at another height [m]."""
    return _with_tremor(patient.arm, [*patient.paths[:2], resting(z)], patient.effort)


def changed_patient(
    patient: Patient, change: ArmSettings, now: float, hand: Sequence[float] = ()
) -> Patient:
    """Return the patient after a change requested at time `now` [s].

    hand: where his hand is [m], by which he judges the movement that a new target ends; empty: he
    does not. Raises ValueError naming the invalid field or trait; then nothing has changed.
    """
    arm = patient.arm
    if change.kind:
        if change.kind not in KINDS:
            known = ", ".join(map(repr, KINDS))
            raise ValueError(f"kind = {shown(change.kind)}: one of {known} is wanted")
        arm = arm._replace(**KINDS[change.kind])
    arm = with_traits(arm, change.traits, change.values)
    for name in ("mass", "stiffness", "damping"):
        value = float(getattr(change, name))
        if not math.isnan(value):
            arm = _replaced(arm, name, value)
    if not 0.0 <= change.duration < math.inf:
        raise ValueError(f"duration = {change.duration!r} s: at least zero is wanted")
    for name in ("target", "amplitude", "omega"):
        if any(math.isinf(value) for value in getattr(change, name)):
            raise ValueError(f"{name} = {getattr(change, name)!r}: finite numbers or NaN, please")
    paths = [_path(old, arm, change, axis, now) for axis, old in enumerate(patient.paths)]
    return _with_tremor(arm, paths, _effort(patient, paths, hand, now))


def another_patient(patient: Patient, arm: HumanArm, change: ArmSettings) -> Patient:
    """Return who has this arm, with the traits of a change, and makes all his effort.

    The virtual hand goes on its way, and the other fields of the change do not count. Raises
    ValueError as `with_traits`.
    """
    arm = with_traits(arm, change.traits, change.values)
    return _with_tremor(arm, list(patient.paths))


def _effort(
    patient: Patient, paths: Sequence[HandPath], hand: Sequence[float], now: float
) -> float:
    """Return his effort for the next movement (the form of emken2007 and wolbrecht2008).

    Where the hand is on its way, or goes nowhere else, no movement has ended.
    """
    arm, old = patient.arm, [path.target for path in patient.paths]
    under_way = any(now < path.begin + path.duration for path in patient.paths)
    if not hand or under_way or old == [path.target for path in paths]:
        return patient.effort
    kept = (1.0 - arm.slack) * patient.effort
    return min(max(kept + arm.regret * math.dist(hand, old), 0.0), 1.0)


def with_traits(arm: HumanArm, traits: Sequence[str], values: Sequence[float]) -> HumanArm:
    """Return the arm with other values of the named `TRAITS`.

    Raises ValueError for what `trait_flaw` finds, a name that comes twice, and lists that differ
    in length.
    """
    if len(traits) != len(values):
        raise ValueError(
            f"traits: {len(traits)} names, values: {len(values)} numbers: one for each is wanted"
        )
    if len(set(traits)) < len(traits):
        raise ValueError(f"traits = {shown(list(traits))}: name each once")
    for name, value in zip(traits, values, strict=True):
        if wrong := trait_flaw(name, value):
            raise ValueError(wrong)
        arm = _replaced(arm, name, float(value))
    return arm


def trait_flaw(name: str, value: float) -> str:
    """Return what is wrong with a value of the trait `name`, empty if nothing."""
    if name in TRAITS:
        return problem(TRAITS[name], value)
    known = (f"{one} from {s.low:g} to {s.high:g} {s.unit}" for one, (_, _, s) in TRAITS.items())
    return f"trait {shown(name)} is unknown; there are {', '.join(map(str.strip, known))}"


def _replaced(arm: HumanArm, name: str, value: Any) -> HumanArm:
    wrong = problem(fields(HumanArm)[name], value)
    if wrong:
        raise ValueError(wrong)
    return arm._replace(**{name: value})


def _path(old: HandPath, arm: HumanArm, change: ArmSettings, axis: int, now: float) -> HandPath:
    """Return the new path on one axis; it starts at the present point of the virtual hand.

    With NaN as target, amplitude and omega of an axis its path continues unchanged, sine included.
    """
    asked = (change.target[axis], change.amplitude[axis], change.omega[axis])
    if all(map(math.isnan, asked)) and change.kind != RELAXED:
        return old
    begin = now
    if now < old.begin:  # he has seen a target and not set out yet: he sets out for this one
        begin = old.begin
    elif now >= old.begin + old.duration:
        begin = now + arm.reaction
    return HandPath(
        start=hand_point(old._replace(tremor=0.0), now)[0],
        target=_kept(change.target[axis], old.target),
        begin=begin,
        duration=max(float(change.duration), _STEP_S if begin > now else 0.0),
        amplitude=0.0 if change.kind == RELAXED else _kept(change.amplitude[axis], old.amplitude),
        omega=_kept(change.omega[axis], old.omega),
        tremor=0.0,
    )


def _kept(value: float, old: float) -> float:
    return old if math.isnan(value) else float(value)


def _with_tremor(arm: HumanArm, paths: list[HandPath], effort: float = 1.0) -> Patient:
    omega = 2.0 * math.pi * arm.tremor_rate
    x, y, z = (path._replace(tremor=arm.tremor, tremor_omega=omega) for path in paths)
    return Patient(arm, (x, y, z), effort)


def on_circle(centre: Triple, begin: Triple, step: int) -> Triple:
    """Return where a patient goes for a step of a circle [m]: clockwise from where it begins."""
    angle = math.tau * step / _CIRCLE_STEPS
    x, y = begin[0] - centre[0], begin[1] - centre[1]
    turned_x = x * math.cos(angle) + y * math.sin(angle)
    turned_y = y * math.cos(angle) - x * math.sin(angle)
    return centre[0] + turned_x, centre[1] + turned_y, begin[2]
