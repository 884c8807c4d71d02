# SPDX-License-Identifier: Apache-2.0
"""The simulated patient: an arm whose virtual hand follows a path, and its changes at run time.

The arm is the thesis's (6.4.3): mass, spring and damper between the handle and a virtual hand that
moves on a minimum-jerk path (flashhogan1985) to a target and there follows a sine. Kinds:

- active: the arm as set;
- relaxed: a tenth of the stiffness, no sine: it is moved, it does not move;
- tremor: active, with a 5 Hz sine of 8 mm on each axis of the virtual hand;
- weak: active, but spring and damper together cannot exceed 8 N.

The arm's mass moves with the handle. Of its `weight`, which is what it weighs at the hand, the
patient's own muscles carry the share `carried`; the rest hangs on the handle, whatever the kind:

    hanging = weight (1 - carried)

carried = 0 is a flaccid arm, of which the handle bears all; with carried = 1 the patient holds his
arm up himself, and nothing hangs on the handle.

A trait is a field of `HumanArm` that SetArm sets by its name (`TRAITS`); a patient is a name for
all of an arm (`PATIENTS`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

from ..settings import Field, Setting, fields, problem, shown

ACTIVE, RELAXED, TREMOR, WEAK = "active", "relaxed", "tremor", "weak"
KINDS = (ACTIVE, RELAXED, TREMOR, WEAK)
RELAXED_SHARE = 0.1  # share of the stiffness
TREMOR_AMPLITUDE = 0.008  # amplitude of the virtual hand [m]
TREMOR_OMEGA = 2.0 * math.pi * 5.0  # angular frequency in the 4-6 Hz of rest tremor [rad/s]
WEAK_FORCE = 8.0  # the most a weak arm pushes or pulls [N]

Triple = tuple[float, float, float]
_KEEP = (math.nan, math.nan, math.nan)


class HumanArm(NamedTuple):
    """The patient's arm at the start of the rig."""

    kind: Annotated[str, Setting("what the arm does", choices=KINDS)]
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


TRAITS: dict[str, Field] = {
    name: fields(HumanArm)[name] for name in ("weight", "carried", "follows", "reach_time")
}
"""What SetArm sets by name: a new trait is a field of `HumanArm` and its name here."""

# A hand of 3 kg moves some 9 kg with the arm. 500 N/m and 20 Ns/m, damped by 0.15, pass a target
# 0.14 m away by 30 mm in 0.9 s; a practised hand, damped by 0.5, by a few millimetres in 1.1 s.
# A weak arm of 500 N/m held the hand where it stopped: with 8 N against a wall that takes all of a
# trial's time to become that stiff, and the assistance brought it to no target. On the handle hangs
# only a flaccid arm, all of it, as heavy as thesis 2.1.1 found one; there a tenth of 300 N/m acts
# (ours).
PATIENTS = {
    "healthy": HumanArm(ACTIVE, 3.0, 800.0, 80.0, 20.0, 1.0, follows=1.0, reach_time=1.1),
    "tremor": HumanArm(TREMOR, 3.0, 500.0, 20.0, 20.0, 1.0, follows=1.0, reach_time=1.2),
    "weak": HumanArm(WEAK, 3.0, 200.0, 20.0, 20.0, 1.0, follows=0.8, reach_time=2.6),
    "flaccid": HumanArm(RELAXED, 3.0, 300.0, 10.0, 20.0, 0.0, follows=0.0, reach_time=1.1),
}
"""Whole arms by name."""


class ArmForce(NamedTuple):
    """The arm in the equations of motion, the same on every axis.

    mass [kg], stiffness [N/m], damping [N s/m], limit: of spring and damper together [N],
    weight: of what hangs on the handle [N].
    """

    mass: float
    stiffness: float
    damping: float
    limit: float
    weight: float


class HandPath(NamedTuple):
    """Path of the virtual hand on one axis.

    start, target [m]; begin: time it starts [s]; duration: of the minimum-jerk part [s];
    amplitude [m] and omega [rad/s]: of the sine about the target, from then on;
    tremor: amplitude of the tremor [m].
    """

    start: float
    target: float
    begin: float
    duration: float
    amplitude: float
    omega: float
    tremor: float


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
    return ArmForce(mass, stiffness, damping, math.inf, 0.0)


def arm_force(arm: HumanArm) -> ArmForce:
    """Return the arm for the equations of motion."""
    relaxed = RELAXED_SHARE if arm.kind == RELAXED else 1.0
    return ArmForce(
        mass=arm.mass,
        stiffness=arm.stiffness * relaxed,
        damping=arm.damping,
        limit=WEAK_FORCE if arm.kind == WEAK else math.inf,
        weight=arm.weight * (1.0 - arm.carried),
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
        position += path.tremor * math.sin(TREMOR_OMEGA * time)
        velocity += path.tremor * TREMOR_OMEGA * math.cos(TREMOR_OMEGA * time)
    return position, velocity


def spring_terms(
    arm: ArmForce, hand: float, hand_velocity: float, position: float, velocity: float
) -> tuple[float, float, float]:
    """Return (stiffness, damping, constant force) that act over one substep on one axis.

    A weak arm at its limit is a constant force. hand, position [m]; velocities [m/s].
    """
    force = arm.stiffness * (hand - position) + arm.damping * (hand_velocity - velocity)
    if force > arm.limit:
        return 0.0, 0.0, arm.limit
    if force < -arm.limit:
        return 0.0, 0.0, -arm.limit
    return arm.stiffness, arm.damping, 0.0


class ArmSettings(NamedTuple):
    """A change of the patient's arm, as in SetArm.srv; NaN and '' keep the present value.

    kind: active, relaxed, tremor or weak; mass [kg], stiffness [N/m], damping [N s/m];
    target: of the virtual hand, x, y from the centre, z from the bottom [m]; duration: of the
    minimum-jerk way there, 0 = at once [s]; amplitude [m], omega [rad/s]: of the sine about the
    target from then on; traits, values: names of `TRAITS` and what each becomes, as many of either.
    patient: a name of `PATIENTS`, whose arm it becomes, with these traits; the virtual hand goes on
    its way, and the other fields do not count.
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
    """The arm and the paths of its virtual hand on x, y, z."""

    arm: HumanArm
    paths: tuple[HandPath, HandPath, HandPath]


def resting_patient(arm: HumanArm, x: float, y: float, z: float) -> Patient:
    """Return a patient whose virtual hand stays at x, y, z [m]."""
    return _with_tremor(arm, [resting(x), resting(y), resting(z)])


def moved_patient(patient: Patient, z: float) -> Patient:
    """Return the patient with the virtual hand resting at another height [m]."""
    return _with_tremor(patient.arm, [*patient.paths[:2], resting(z)])


def changed_patient(patient: Patient, change: ArmSettings, now: float) -> Patient:
    """Return the patient after a change requested at time `now` [s].

    Raises ValueError naming the invalid field, trait or patient; then nothing has changed.
    """
    if change.patient:
        if change.patient not in PATIENTS:
            known = ", ".join(PATIENTS)
            raise ValueError(f"patient = {shown(change.patient)}: one of {known} is wanted")
        arm = with_traits(PATIENTS[change.patient], change.traits, change.values)
        return _with_tremor(arm, list(patient.paths))
    arm = with_traits(patient.arm, change.traits, change.values)
    if change.kind:
        arm = _replaced(arm, "kind", change.kind)
    for name in ("mass", "stiffness", "damping"):
        value = float(getattr(change, name))
        if not math.isnan(value):
            arm = _replaced(arm, name, value)
    if not 0.0 <= change.duration < math.inf:
        raise ValueError(f"duration = {change.duration!r} s: at least zero is wanted")
    for name in ("target", "amplitude", "omega"):
        if any(math.isinf(value) for value in getattr(change, name)):
            raise ValueError(f"{name} = {getattr(change, name)!r}: finite numbers or NaN, please")
    return _with_tremor(arm, [_path(old, arm, change, axis, now)
                              for axis, old in enumerate(patient.paths)])  # fmt: skip


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
    if all(map(math.isnan, asked)) and arm.kind != RELAXED:
        return old
    return HandPath(
        start=hand_point(old._replace(tremor=0.0), now)[0],
        target=_kept(change.target[axis], old.target),
        begin=now,
        duration=float(change.duration),
        amplitude=0.0 if arm.kind == RELAXED else _kept(change.amplitude[axis], old.amplitude),
        omega=_kept(change.omega[axis], old.omega),
        tremor=0.0,
    )


def _kept(value: float, old: float) -> float:
    return old if math.isnan(value) else float(value)


def _with_tremor(arm: HumanArm, paths: list[HandPath]) -> Patient:
    tremor = TREMOR_AMPLITUDE if arm.kind == TREMOR else 0.0
    x, y, z = (path._replace(tremor=tremor) for path in paths)
    return Patient(arm, (x, y, z))
