# SPDX-License-Identifier: Apache-2.0
"""Configures a CiA 402 drive for torque: rating, mode, process data, guards.

What a make of drive does otherwise, its profile says (`profiles.py`); the guards are those of
`drive_guards`.
"""

from __future__ import annotations

import contextlib
import struct
from functools import cache
from typing import NamedTuple

from ..can_io.load import Traffic
from ..can_io.port import Port
from ..profiles import COMMAND_DEADLINE, TORQUE_LIMIT, DriveProfile, key_of
from ..units import PER_MILLE
from . import pdo
from .drive_guards import (
    MissingGuard,
    Object,
    ReplacedGuard,
    limit_object,
    milliseconds,
    replaced,
    stop_objects,
    written,
)
from .drive_settings import DriveSettings
from .errors import NotConfigured, Refused, WrongDevice
from .sdo import Sdo

PROFILE = 402

CYCLIC_TORQUE_MODE, PROFILE_TORQUE_MODE = 10, 4
#: Bit of object 6502 that shows a mode.
_MODE_BITS = {CYCLIC_TORQUE_MODE: 9, PROFILE_TORQUE_MODE: 3}
#: Time that a drive may need to show a mode that was set.
_MODE_WITHIN_S = 0.25

_MILLI, _MICRO = 1e-3, 1e-6
#: Largest relative difference between object 6076 and the parameter for the same motor.
_RATING_TOLERANCE = 0.01

_STEEPEST_SLOPE = 0x7FFFFFFF
_SLOW_STATUS_MS = 100
_MOST_SYNCS = 240

#: RPDO1: controlword, target torque [per mille of the rated torque].
COMMAND = (pdo.Entry(0x6040, 0, 16), pdo.Entry(0x6071, 0, 16))
COMMAND_LAYOUT = struct.Struct("<Hh")
#: TPDO1: statusword, position [counts, wraps at 32 bit], torque [per mille of the rated torque].
STATUS = (pdo.Entry(0x6041, 0, 16), pdo.Entry(0x6064, 0, 32), pdo.Entry(0x6077, 0, 16))
STATUS_LAYOUT = struct.Struct("<HIh")
ERROR_CODE, MODE_DISPLAY, DIGITAL_INPUTS = 0x603F, 0x6061, 0x60FD
#: Of TPDO2, as far as a make can map them: object -> code of `struct`, size [bit].
SLOW_STATUS = {ERROR_CODE: ("H", 16), MODE_DISPLAY: ("b", 8), DIGITAL_INPUTS: ("I", 32)}


class DriveSetup(NamedTuple):
    """Result of the configuration.

    mode: object 6060 in use. rated_torque: torque of 1000 per mille [Nm]. unguarded: guards that
    the drive refused and nothing replaces. replaced: those that its profile replaces. warnings:
    harmless refusals. slow: objects that TPDO2 carries. open_ids: identifiers at which it takes
    commands besides ours, because it does not let these PDOs be disabled.
    """

    mode: int
    rated_torque: float
    unguarded: tuple[MissingGuard, ...] = ()
    replaced: tuple[ReplacedGuard, ...] = ()
    warnings: tuple[str, ...] = ()
    slow: tuple[int, ...] = tuple(SLOW_STATUS)
    open_ids: tuple[int, ...] = ()


# -- what the drive is told ----------------------------------------------------------------------


def command_pdo(settings: DriveSettings) -> pdo.Pdo:
    """Return RPDO1, effective at once, with the deadline that stops the drive."""
    deadline = milliseconds(settings.command_timeout)
    return pdo.Pdo(1, False, 0x200 + settings.node_id, pdo.ON_EVENT, COMMAND, deadline)


def status_pdo(settings: DriveSettings) -> pdo.Pdo:
    """Return TPDO1, at every SYNC or every n-th."""
    return pdo.Pdo(1, True, 0x180 + settings.node_id, settings.sync_divider, STATUS)


def slow_status_id(settings: DriveSettings) -> int:
    """Return the identifier of TPDO2."""
    return 0x280 + settings.node_id


def slow_status_pdo(settings: DriveSettings, slow: tuple[int, ...], timer: bool) -> pdo.Pdo:
    """Return TPDO2 with these objects, on change and every 100 ms; without a timer after SYNCs."""
    entries = tuple(pdo.Entry(index, 0, SLOW_STATUS[index][1]) for index in slow)
    cob_id = slow_status_id(settings)
    if timer:
        return pdo.Pdo(2, True, cob_id, pdo.ON_EVENT, entries, _SLOW_STATUS_MS)
    syncs = round(_SLOW_STATUS_MS * 1e-3 * settings.rate * settings.sync_divider)
    return pdo.Pdo(2, True, cob_id, max(1, min(_MOST_SYNCS, syncs)), entries)


@cache
def slow_status_layout(slow: tuple[int, ...]) -> struct.Struct:
    """Return the layout of TPDO2 with these objects."""
    return struct.Struct("<" + "".join(SLOW_STATUS[index][0] for index in slow))


#: Profile torque ramps towards its target; with the steepest ramp it acts like cyclic torque.
_SLOPE = Object(0x6087, 0, _STEEPEST_SLOPE, 4, "", "torque slope")


def drive_traffic(settings: DriveSettings, sync_producer: bool = True) -> list[Traffic]:
    """Return the frames of this device for the bus load, SYNC included where we send it."""
    name, rate = f"drive {settings.node_id}", settings.rate
    frames = [
        Traffic(f"{name} RPDO1", COMMAND_LAYOUT.size, rate),
        Traffic(f"{name} TPDO1", STATUS_LAYOUT.size, rate),
        Traffic(f"{name} TPDO2", slow_status_layout(tuple(SLOW_STATUS)).size,
                1e3 / _SLOW_STATUS_MS),
        Traffic(f"{name} heartbeat", 1, 1.0 / settings.drive_heartbeat),
        Traffic(f"heartbeat {settings.master_id}", 1, 1.0 / settings.heartbeat_period),
    ]
    sync = Traffic("SYNC", 0, rate * settings.sync_divider)
    return [sync, *frames] if sync_producer else frames


# -- the dialogue --------------------------------------------------------------------------------


def set_up(port: Port, sdo: Sdo, settings: DriveSettings, profile: DriveProfile) -> DriveSetup:
    """Configure an identified drive that is in PRE-OPERATIONAL as the settings describe.

    Raises NotAnswering, WrongDevice, Refused, NotConfigured.
    """
    for index in (0x6071, 0x6040):  # an earlier program may have left the drive enabled
        with contextlib.suppress(Refused):  # by PDO only; the first command sends the same
            sdo.write(index, 0, 0, 2)
    units = (profile.rated_torque_unit,) if profile.rated_torque_unit else (_MILLI, _MICRO)
    rated = rated_torque(sdo.unsigned(0x6076), settings.rated_torque, sdo.label, units)
    mode = _select_mode(port, sdo, profile.modes)
    warnings: list[str] = []
    if mode == PROFILE_TORQUE_MODE:
        _, warnings = written(sdo, (_SLOPE,))
    else:
        _clear_offset(sdo)
    command, status = command_pdo(settings), status_pdo(settings)
    slow = tuple(key_of(key)[0] for key in profile.slow_status)
    wanted = slow_status_pdo(settings, slow, profile.slow_status_timer)
    open_ids = pdo.disable_unused(sdo, (command, status, wanted))
    pdo.configure(sdo, status)
    slow = _configure_slow_status(sdo, settings, slow, profile.slow_status_timer)
    no_deadline = pdo.configure(sdo, command, timer_optional=True)
    missing, refused = written(sdo, stop_objects(settings, rated))
    if no_deadline:
        missing.insert(0, MissingGuard(COMMAND_DEADLINE, no_deadline))
    share = _share(settings, rated, profile)
    unguarded, stood_in = replaced(sdo, settings, profile, missing, share)
    warned = (*warnings, *refused)
    return DriveSetup(mode, rated, unguarded, stood_in, warned, slow, open_ids)


def _share(settings: DriveSettings, rated: float, profile: DriveProfile) -> float:
    return min(settings.max_torque / rated, profile.largest_target / PER_MILLE)


def limit_again(
    sdo: Sdo, settings: DriveSettings, profile: DriveProfile, found: DriveSetup
) -> DriveSetup:
    """Tell a configured drive, which must be off, another `max_torque` as its own limit.

    Raises NotAnswering. Where the operator has waived the limit, there is none to write.
    """
    if any(each.guard == TORQUE_LIMIT for each in found.unguarded):
        return found
    rated = found.rated_torque
    missing, _ = written(sdo, (limit_object(settings, rated),))
    lacking, _ = replaced(sdo, settings, profile, missing, _share(settings, rated, profile))
    return found._replace(unguarded=(*found.unguarded, *lacking))


def _configure_slow_status(
    sdo: Sdo, settings: DriveSettings, slow: tuple[int, ...], timer: bool
) -> tuple[int, ...]:
    """Configure TPDO2; return its objects. The digital inputs are optional (CiA 402)."""
    try:
        pdo.configure(sdo, slow_status_pdo(settings, slow, timer))
    except (Refused, NotConfigured):
        if len(slow) == 1 or slow[-1] != DIGITAL_INPUTS:
            raise
        slow = slow[:-1]
        pdo.configure(sdo, slow_status_pdo(settings, slow, timer))
    return slow


def rated_torque(
    raw: int, expected: float, label: str, units: tuple[float, ...] = (_MILLI, _MICRO)
) -> float:
    """Return object 6076 in Nm: mNm in the standard, micro-Nm on some drives.

    raw: value of the object. expected: the parameter [Nm]. units: that it may have [Nm]. Raises
    WrongDevice if none fits.
    """
    for unit in units:
        if abs(raw * unit - expected) <= _RATING_TOLERANCE * expected:
            return raw * unit
    raise WrongDevice(
        f"{label} says a rated torque (6076) of {raw}, which is {raw * units[0]:g} Nm if in "
        f"{'mNm' if units[0] == _MILLI else 'micro-Nm'}; the parameter rated_torque is "
        f"{expected:g} Nm: correct whichever is wrong, or every torque will be. Some programs "
        "leave the rated current [mA] there"
    )


def _select_mode(port: Port, sdo: Sdo, modes: tuple[int, ...]) -> int:
    supported = sdo.unsigned(0x6502)
    mode = next((mode for mode in modes if supported >> _MODE_BITS[mode] & 1), 0)
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
