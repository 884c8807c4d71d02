# SPDX-License-Identifier: Apache-2.0
"""The guards with which a CiA 402 drive drops its torque by itself, and what stands in for one.

The objects are written and read back. A guard that the drive refuses is missing; the profile of its
make may name what replaces it. `Drive` does not enable a drive while one is missing and not waived.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..profiles import (
    DEADLINE_PERIODS,
    DRIVE_HEARTBEAT,
    FAULT_REACTION,
    GUARDS,
    LIMIT,
    LIMIT_BELOW,
    LIMIT_COMMAND,
    LOST_CONNECTION,
    MASTER_HEARTBEAT,
    PERIOD_US,
    QUICK_STOP_REACTION,
    TORQUE_LIMIT,
    DriveProfile,
    Substitute,
    WrittenObject,
    key_of,
)
from ..units import LARGEST_PER_MILLE, PER_MILLE
from .drive_settings import COAST, DriveSettings
from .errors import NotConfigured, Refused, cure
from .sdo import Sdo

_ROUNDING = 1e-6
_FAULT_ON_LOST_CONNECTION = 1
_DISABLE_AND_COAST, _RAMP_DOWN, _QUICK_STOP_RAMP = 0, 1, 2
#: What a clean exit switches off, in order: the command deadline, then our heartbeat.
_DISARMED = ((0x1400, 5, 2), (0x1016, 1, 4))


class Object(NamedTuple):
    """One object that is written and read back; size: [byte].

    guard: the drive is not enabled without it; empty: a refusal is a warning, and a drive need not
    have the object. name: for messages. parameter: ROS parameter that the value comes from.
    """

    index: int  # type: ignore[assignment]  # hides the tuple's method
    subindex: int
    value: int
    size: int
    guard: str
    name: str = ""
    parameter: str = ""


class MissingGuard(NamedTuple):
    """A guard that the drive refused.

    guard: of `profiles.GUARDS`; why: its answer. cure: what to do, where it has the object and only
    does not take our value.
    """

    guard: str
    why: str
    cure: str = ""

    def __str__(self) -> str:
        return f"{GUARDS[self.guard]} ({self.why})"


class ReplacedGuard(NamedTuple):
    """A guard that the drive refused and its profile replaces.

    guard: of `profiles.GUARDS`. text: what stands in its place. by_word: no object of the drive was
    written for it; other guards that are in force have to do.
    """

    guard: str
    text: str
    by_word: bool

    def __str__(self) -> str:
        return f"{GUARDS[self.guard]} is missing, in its place: {self.text}"


def stop_objects(settings: DriveSettings, rated: float) -> tuple[Object, ...]:
    """Return the objects that decide how the drive stops, in order; rated: its torque [Nm]."""
    coast = settings.stop_reaction == COAST
    stop = _DISABLE_AND_COAST if coast else _QUICK_STOP_RAMP
    period = milliseconds(settings.drive_heartbeat)
    consumer = settings.master_id << 16 | milliseconds(settings.heartbeat_timeout)
    return (
        Object(0x1017, 0, period, 2, DRIVE_HEARTBEAT, parameter="drive_heartbeat"),
        Object(0x1016, 1, consumer, 4, MASTER_HEARTBEAT, parameter="heartbeat_timeout"),
        Object(0x6007, 0, _FAULT_ON_LOST_CONNECTION, 2, LOST_CONNECTION),
        Object(0x605A, 0, stop, 2, QUICK_STOP_REACTION, parameter="stop_reaction"),
        Object(0x605E, 0, stop, 2, FAULT_REACTION, parameter="stop_reaction"),
        limit_object(settings, rated),
        # Who coasts leaves operation enabled by voltage off, on which no option code acts.
        *(() if coast else (Object(0x605C, 0, _RAMP_DOWN, 2, "", "disable reaction"),)),
    )


def limit_object(settings: DriveSettings, rated: float) -> Object:
    """Return the drive's own limit of its torque; rated: its torque [Nm]."""
    value = own_limit(settings.max_torque, rated)
    return Object(0x6072, 0, value, 2, TORQUE_LIMIT, parameter="max_torque")


def own_limit(max_torque: float, rated_torque: float) -> int:
    """Return object 6072 for max_torque and rated_torque [Nm]: whole per mille, rounded up.

    The object limits both directions, so it needs no `direction`.
    """
    per_mille = math.ceil(max_torque / rated_torque * PER_MILLE - _ROUNDING)
    return max(0, min(LARGEST_PER_MILLE, per_mille))


def milliseconds(seconds: float) -> int:
    """Return a time [s] in the object dictionary's unit [ms], at least 1."""
    return max(1, round(seconds * 1e3))


def written(sdo: Sdo, objects: tuple[Object, ...]) -> tuple[list[MissingGuard], list[str]]:
    """Write the objects and read them back; return the guards refused and the warnings."""
    missing, warnings = [], []
    for each in objects:
        try:
            sdo.set(each.index, each.subindex, each.value, each.size)
        except (Refused, NotConfigured) as error:
            if each.guard:
                missing.append(MissingGuard(each.guard, str(error), cure(error, each.parameter)))
            elif not (isinstance(error, Refused) and error.absent):
                warnings.append(f"{each.name} not set: {error}")
    return missing, warnings


class Largest(NamedTuple):
    """Largest torque: as a share of the rated one, and in the unit of the command."""

    share: float
    command: int


def replaced(
    sdo: Sdo, settings: DriveSettings, profile: DriveProfile, missing: list[MissingGuard],
    largest: Largest,
) -> tuple[tuple[MissingGuard, ...], tuple[ReplacedGuard, ...]]:  # fmt: skip
    """Put the profile's substitutes in place of the missing guards.

    Returns the guards that nothing replaces, and those
    that are replaced. A substitute relies on guards that the drive itself took: one that is missing
    too does not count, whatever replaces it.
    """
    substitutes = {each.guard: each for each in profile.substitutes}
    lacking = {each.guard for each in missing}
    left, stood_in = [], []
    for each in missing:
        substitute = substitutes.get(each.guard)
        if substitute is None or substitute.flaw() or lacking & set(substitute.relies_on):
            left.append(each)
        elif why := _substituted(sdo, settings, substitute, largest):
            told = f"{each.why}; {substitute.text}: {why}"
            left.append(MissingGuard(each.guard, told, each.cure))
        else:
            word = not substitute.objects
            stood_in.append(ReplacedGuard(each.guard, substitute.text, word))
    return tuple(left), tuple(stood_in)


def _substituted(
    sdo: Sdo, settings: DriveSettings, substitute: Substitute, largest: Largest
) -> str:
    """Write a substitute's objects and read them back; return why not, empty if done."""
    try:
        write(sdo, settings, substitute.objects, largest)
    except (Refused, NotConfigured) as error:
        return str(error)
    return ""


def write(
    sdo: Sdo, settings: DriveSettings, objects: tuple[WrittenObject, ...], largest: Largest
) -> None:
    """Write a profile's objects and read them back; raises as `Sdo.set`."""
    for each in objects:
        index, subindex = key_of(each.object)
        sdo.set(index, subindex, _quantity(sdo, settings, each, largest), each.size)


def _quantity(
    sdo: Sdo, settings: DriveSettings, wanted: WrittenObject, largest: Largest
) -> int:
    if wanted.quantity == PERIOD_US:
        return round(1e6 / settings.rate)
    if wanted.quantity == DEADLINE_PERIODS:
        return round(settings.command_timeout * settings.rate)
    if wanted.quantity == LIMIT:
        return math.ceil(largest.share * sdo.unsigned(*key_of(wanted.base)) - _ROUNDING)
    if wanted.quantity == LIMIT_COMMAND:
        return largest.command
    if wanted.quantity == LIMIT_BELOW:
        return wanted.value - largest.command
    return wanted.value


def disarm(sdo: Sdo) -> None:
    """Switch the guards off for a clean exit; raises NotAnswering, Refused, NotConfigured."""
    for index, subindex, size in _DISARMED:
        try:
            sdo.set(index, subindex, 0, size)
        except Refused as error:
            if not error.absent:
                raise
