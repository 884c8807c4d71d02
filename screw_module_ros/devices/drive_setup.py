# SPDX-License-Identifier: Apache-2.0
"""Configures a CiA 402 drive for torque and sets the guards with which it stops on its own.

The drive is the last guard. It must drop the torque when our heartbeat (1016) or our commands
(1400:05) stop, with the configured reaction (6007, 605A, 605E). It must never give more torque than
our largest command (6072), even if another master writes a target. The driver reads each of these
objects back. It returns the guards that a drive refuses; such a drive is not enabled.
"""

from __future__ import annotations

import contextlib
import math
import struct
from typing import NamedTuple

from ..can_io.load import Traffic
from ..can_io.port import Port
from ..units import LARGEST_PER_MILLE, PER_MILLE
from . import pdo
from .drive_settings import COAST, DriveSettings
from .errors import NotConfigured, Refused, WrongDevice
from .sdo import Sdo

PROFILE = 402

CYCLIC_TORQUE_MODE, PROFILE_TORQUE_MODE = 10, 4
#: Mode of operation and its bit in object 6502, best mode first.
_TORQUE_MODES = ((9, CYCLIC_TORQUE_MODE), (3, PROFILE_TORQUE_MODE))
#: Time that a drive may need to show a mode that was set.
_MODE_WITHIN_S = 0.25

_MILLI, _MICRO = 1e-3, 1e-6
#: Largest relative difference between object 6076 and the parameter for the same motor.
_RATING_TOLERANCE = 0.01
_ROUNDING = 1e-6

_FAULT_ON_LOST_CONNECTION = 1
_DISABLE_AND_COAST, _RAMP_DOWN, _QUICK_STOP_RAMP = 0, 1, 2
_STEEPEST_SLOPE = 0x7FFFFFFF
_SLOW_STATUS_MS = 100

#: RPDO1: controlword, target torque [per mille of the rated torque].
COMMAND = (pdo.Entry(0x6040, 0, 16), pdo.Entry(0x6071, 0, 16))
COMMAND_LAYOUT = struct.Struct("<Hh")
#: TPDO1: statusword, position [counts, wraps at 32 bit], torque [per mille of the rated torque].
STATUS = (pdo.Entry(0x6041, 0, 16), pdo.Entry(0x6064, 0, 32), pdo.Entry(0x6077, 0, 16))
STATUS_LAYOUT = struct.Struct("<HIh")
#: TPDO2: error code, mode display, digital inputs; the last is optional.
SLOW_STATUS = (pdo.Entry(0x603F, 0, 16), pdo.Entry(0x6061, 0, 8), pdo.Entry(0x60FD, 0, 32))
SLOW_STATUS_LAYOUT = struct.Struct("<HbI")

# The guards, as messages name them.
DRIVE_HEARTBEAT = "its own heartbeat 1017"
MASTER_HEARTBEAT = "watching our heartbeat 1016"
COMMAND_DEADLINE = "command deadline 1400:05"
LOST_CONNECTION = "fault on lost connection 6007"
QUICK_STOP_REACTION = "quick stop reaction 605A"
FAULT_REACTION = "fault reaction 605E"
TORQUE_LIMIT = "torque limit 6072"
_GUARD, _OPTIONAL = True, False


class Object(NamedTuple):
    """One object that is written and read back; size: [byte].

    guard: a drive that refuses it is not enabled; else a refusal is a warning, and a drive need not
    have the object. name: for messages.
    """

    index: int
    subindex: int
    value: int
    size: int
    guard: bool
    name: str


class MissingGuard(NamedTuple):
    """A guard that the drive refused. guard: one of the constants above; why: its answer."""

    guard: str
    why: str

    def __str__(self) -> str:
        return f"{self.guard} ({self.why})"


class DriveSetup(NamedTuple):
    """Result of the configuration.

    mode: object 6060 in use. rated_torque: torque of 1000 per mille [Nm]. unguarded: guards that
    the drive refused, empty without any. warnings: harmless refusals. slow_size: of TPDO2 [byte].
    """

    mode: int
    rated_torque: float
    unguarded: tuple[MissingGuard, ...] = ()
    warnings: tuple[str, ...] = ()
    slow_size: int = SLOW_STATUS_LAYOUT.size


# -- what the drive is told ----------------------------------------------------------------------


def command_pdo(settings: DriveSettings) -> pdo.Pdo:
    """Return RPDO1, effective at once, with the deadline that stops the drive."""
    deadline = _milliseconds(settings.command_timeout)
    return pdo.Pdo(1, False, 0x200 + settings.node_id, pdo.ON_EVENT, COMMAND, deadline)


def status_pdo(settings: DriveSettings) -> pdo.Pdo:
    """Return TPDO1, at every SYNC or every n-th."""
    return pdo.Pdo(1, True, 0x180 + settings.node_id, settings.sync_divider, STATUS)


def slow_status_pdo(settings: DriveSettings) -> pdo.Pdo:
    """Return TPDO2, on change and every 100 ms."""
    cob_id = 0x280 + settings.node_id
    return pdo.Pdo(2, True, cob_id, pdo.ON_EVENT, SLOW_STATUS, _SLOW_STATUS_MS)


def stop_objects(settings: DriveSettings, rated: float) -> tuple[Object, ...]:
    """Return the objects that decide how the drive stops, in order; rated: its torque [Nm]."""
    coast = settings.stop_reaction == COAST
    stop = _DISABLE_AND_COAST if coast else _QUICK_STOP_RAMP
    disable = _DISABLE_AND_COAST if coast else _RAMP_DOWN
    period = _milliseconds(settings.drive_heartbeat)
    consumer = settings.master_id << 16 | _milliseconds(settings.heartbeat_timeout)
    limit = own_limit(settings.max_torque, rated)
    return (
        Object(0x1017, 0, period, 2, _GUARD, DRIVE_HEARTBEAT),
        Object(0x1016, 1, consumer, 4, _GUARD, MASTER_HEARTBEAT),
        Object(0x6007, 0, _FAULT_ON_LOST_CONNECTION, 2, _GUARD, LOST_CONNECTION),
        Object(0x605A, 0, stop, 2, _GUARD, QUICK_STOP_REACTION),
        Object(0x605E, 0, stop, 2, _GUARD, FAULT_REACTION),
        Object(0x6072, 0, limit, 2, _GUARD, TORQUE_LIMIT),
        Object(0x605B, 0, disable, 2, _OPTIONAL, "shutdown reaction"),
        Object(0x605C, 0, disable, 2, _OPTIONAL, "disable reaction"),
    )


#: Profile torque ramps towards its target; with the steepest ramp it acts like cyclic torque.
_SLOPE = Object(0x6087, 0, _STEEPEST_SLOPE, 4, _OPTIONAL, "torque slope")
#: What a clean exit switches off, in order: the command deadline, then our heartbeat.
_DISARMED = ((0x1400, 5, 2), (0x1016, 1, 4))


def drive_traffic(settings: DriveSettings, sync_producer: bool = True) -> list[Traffic]:
    """Return the frames of this device for the bus load, SYNC included where we send it."""
    name, rate = f"drive {settings.node_id}", settings.rate
    frames = [
        Traffic(f"{name} RPDO1", COMMAND_LAYOUT.size, rate),
        Traffic(f"{name} TPDO1", STATUS_LAYOUT.size, rate),
        Traffic(f"{name} TPDO2", SLOW_STATUS_LAYOUT.size, 1e3 / _SLOW_STATUS_MS),
        Traffic(f"{name} heartbeat", 1, 1.0 / settings.drive_heartbeat),
        Traffic(f"heartbeat {settings.master_id}", 1, 1.0 / settings.heartbeat_period),
    ]
    sync = Traffic("SYNC", 0, rate * settings.sync_divider)
    return [sync, *frames] if sync_producer else frames


def own_limit(max_torque: float, rated_torque: float) -> int:
    """Return object 6072 for max_torque and rated_torque [Nm]: whole per mille, rounded up.

    The object limits both directions, so it needs no `direction`.
    """
    per_mille = math.ceil(max_torque / rated_torque * PER_MILLE - _ROUNDING)
    return max(0, min(LARGEST_PER_MILLE, per_mille))


def _milliseconds(seconds: float) -> int:
    """Return a time [s] in the object dictionary's unit [ms], at least 1."""
    return max(1, round(seconds * 1e3))


# -- the dialogue --------------------------------------------------------------------------------


def set_up(port: Port, sdo: Sdo, settings: DriveSettings) -> DriveSetup:
    """Configure an identified drive that is in PRE-OPERATIONAL as the settings describe.

    Raises NotAnswering, WrongDevice, Refused, NotConfigured.
    """
    for index in (0x6071, 0x6040):  # an earlier program may have left the drive enabled
        with contextlib.suppress(Refused):  # by PDO only; the first command sends the same
            sdo.write(index, 0, 0, 2)
    rated = rated_torque(sdo.unsigned(0x6076), settings.rated_torque, sdo.label)
    mode = _select_mode(port, sdo)
    warnings = _written(sdo, (_SLOPE,))[1] if mode == PROFILE_TORQUE_MODE else []
    if mode == CYCLIC_TORQUE_MODE:
        _clear_offset(sdo)
    command, status, slow = command_pdo(settings), status_pdo(settings), slow_status_pdo(settings)
    pdo.disable_unused(sdo, (command, status, slow))
    pdo.configure(sdo, status)
    try:
        pdo.configure(sdo, slow)
    except (Refused, NotConfigured):
        slow = slow._replace(entries=SLOW_STATUS[:-1])
        pdo.configure(sdo, slow)
    no_deadline = pdo.configure(sdo, command, timer_optional=True)
    unguarded, refused = _written(sdo, stop_objects(settings, rated))
    if no_deadline:
        unguarded.insert(0, MissingGuard(COMMAND_DEADLINE, no_deadline))
    return DriveSetup(mode, rated, tuple(unguarded), (*warnings, *refused), slow.size)


def disarm(sdo: Sdo) -> None:
    """Switch the guards off for a clean exit; raises NotAnswering, Refused, NotConfigured."""
    for index, subindex, size in _DISARMED:
        try:
            sdo.set(index, subindex, 0, size)
        except Refused as error:
            if not error.absent:
                raise


def rated_torque(raw: int, expected: float, label: str) -> float:
    """Return object 6076 in Nm: mNm in the standard, micro-Nm on some drives.

    raw: value of the object. expected: the parameter [Nm]. Raises WrongDevice if neither fits.
    """
    for unit in (_MILLI, _MICRO):
        if abs(raw * unit - expected) <= _RATING_TOLERANCE * expected:
            return raw * unit
    raise WrongDevice(
        f"{label} says a rated torque (6076) of {raw}, which is {raw * _MILLI:g} Nm if in mNm; the "
        f"parameter rated_torque is {expected:g} Nm: correct whichever is wrong, or every torque "
        "will be"
    )


def _written(sdo: Sdo, objects: tuple[Object, ...]) -> tuple[list[MissingGuard], list[str]]:
    """Write the objects and read them back; return the guards refused and the warnings."""
    unguarded, warnings = [], []
    for each in objects:
        try:
            sdo.set(each.index, each.subindex, each.value, each.size)
        except (Refused, NotConfigured) as error:
            if each.guard:
                unguarded.append(MissingGuard(each.name, str(error)))
            elif not (isinstance(error, Refused) and error.absent):
                warnings.append(f"{each.name} not set: {error}")
    return unguarded, warnings


def _select_mode(port: Port, sdo: Sdo) -> int:
    supported = sdo.unsigned(0x6502)
    mode = next((mode for bit, mode in _TORQUE_MODES if supported >> bit & 1), 0)
    if not mode:
        raise WrongDevice(
            f"{sdo.label} has neither cyclic synchronous torque nor profile torque mode "
            f"(6502 = 0x{supported:X})"
        )
    sdo.write(0x6060, 0, mode, 1)
    if not port.wait_for(lambda: sdo.signed(0x6061) == mode, _MODE_WITHIN_S):
        shown = sdo.signed(0x6061)
        raise NotConfigured(f"{sdo.label}: mode {mode} was asked for (6060), 6061 shows {shown}")
    return mode


def _clear_offset(sdo: Sdo) -> None:
    """Clear the torque offset, which cyclic torque mode adds to each target: a target of zero from
    us would be no zero torque if an earlier program has left one. Drives need not have it.
    """
    try:
        sdo.set(0x60B2, 0, 0, 2)
    except Refused:
        with contextlib.suppress(Refused):
            if offset := sdo.signed(0x60B2):
                raise NotConfigured(
                    f"{sdo.label} adds {offset} per mille to each torque (object 60B2) and does "
                    "not let it be cleared"
                ) from None
