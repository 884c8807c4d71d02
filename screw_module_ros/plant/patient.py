# SPDX-License-Identifier: Apache-2.0
"""Changes of the simulated patient at run time: its arm, and the path of its virtual hand."""

from __future__ import annotations

import math
from typing import NamedTuple

from ..settings import fields, problem
from .arm import RELAXED, TREMOR, TREMOR_AMPLITUDE, HandPath, HumanArm, hand_point, resting

Triple = tuple[float, float, float]
_KEEP = (math.nan, math.nan, math.nan)


class ArmSettings(NamedTuple):
    """A change of the patient's arm, as in SetArm.srv; NaN and '' keep the present value.

    kind: active, relaxed, tremor or weak; mass [kg], stiffness [N/m], damping [N s/m];
    target: of the virtual hand, x, y from the centre, z from the bottom [m]; duration: of the
    minimum-jerk way there, 0 = at once [s]; amplitude [m], omega [rad/s]: of the sine about the
    target from then on.
    """

    kind: str = ""
    mass: float = math.nan
    stiffness: float = math.nan
    damping: float = math.nan
    target: Triple = _KEEP
    duration: float = 0.0
    amplitude: Triple = (0.0, 0.0, 0.0)
    omega: Triple = (0.0, 0.0, 0.0)


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

    Raises ValueError naming the invalid field.
    """
    arm = patient.arm
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


def _replaced(arm: HumanArm, name: str, value) -> HumanArm:
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
