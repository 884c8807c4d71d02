# SPDX-License-Identifier: Apache-2.0
"""Configures a CiA 402 drive for torque: rating, mode, process data, guards.

What a make of drive does otherwise, its profile says (`profiles.py`); the guards are those of
`drive_guards`, TPDO2 that of `drive_slow_status`.
"""

from __future__ import annotations

import contextlib
import math
import struct
from typing import NamedTuple

from ..can_io.load import Traffic
from ..can_io.port import Port
from ..profiles import (
    ALWAYS,
    ANY_DRIVE,
    COMMAND_DEADLINE,
    TORQUE_LIMIT,
    DriveProfile,
    key_of,
)
from ..units import LARGEST_PER_MILLE, PER_MILLE
from . import drive_slow_status, pdo
from .drive_guards import (
    Largest,
    MissingGuard,
    Object,
    ReplacedGuard,
    limit_object,
    milliseconds,
    replaced,
    stop_objects,
    write,
    written,
)
from .drive_settings import DriveSettings
from .errors import NotConfigured, Refused, WrongDevice, cure
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
_ROUNDING = 1e-6

#: TPDO1: statusword, position [counts, wraps at 32 bit], torque [unit of the command].
STATUS_LAYOUT = struct.Struct("<HIh")
_COMMAND_LAYOUTS = {2: struct.Struct("<Hh"), 4: struct.Struct("<H2xh")}


class DriveSetup(NamedTuple):
    """Result of the configuration.

    mode: object 6060 in use. rated_torque: of the motor [Nm]. thousand: torque of 1000 in command
    and actual torque, the rated one where they are per mille of it [Nm]. unguarded: guards that the
    drive refused and nothing replaces. replaced: those that its profile replaces. warnings:
    harmless refusals. slow: objects that TPDO2 carries; slow_rate: its frames per second [Hz].
    open_ids: identifiers at which it takes commands besides ours, because it does not let these
    PDOs be disabled.
    """

    mode: int
    rated_torque: float
    thousand: float
    unguarded: tuple[MissingGuard, ...] = ()
    replaced: tuple[ReplacedGuard, ...] = ()
    warnings: tuple[str, ...] = ()
    slow: tuple[int, ...] = tuple(drive_slow_status.SLOW_STATUS)
    slow_rate: float = 1e3 / drive_slow_status.PERIOD_MS
    open_ids: tuple[int, ...] = ()


def unconfigured(settings: DriveSettings) -> DriveSetup:
    """Return what is taken for granted before a drive is configured."""
    return DriveSetup(0, settings.rated_torque, settings.rated_torque)


# -- what the drive is told ----------------------------------------------------------------------


def command_pdo(settings: DriveSettings, profile: DriveProfile) -> pdo.Pdo:
    """Return RPDO1, effective at once, with the deadline that stops the drive."""
    deadline = milliseconds(settings.command_timeout)
    torque = pdo.Entry(*key_of(profile.command), 8 * profile.command_size)
    entries = (pdo.Entry(0x6040, 0, 16), torque)
    return pdo.Pdo(1, False, 0x200 + settings.node_id, pdo.ON_EVENT, entries, deadline)


def command_layout(profile: DriveProfile) -> struct.Struct:
    """Return the layout of RPDO1: controlword, torque command."""
    return _COMMAND_LAYOUTS[profile.command_size]


def status_pdo(settings: DriveSettings, profile: DriveProfile) -> pdo.Pdo:
    """Return TPDO1, at every SYNC or every n-th."""
    torque = pdo.Entry(*key_of(profile.actual), 16)
    entries = (pdo.Entry(0x6041, 0, 16), pdo.Entry(0x6064, 0, 32), torque)
    return pdo.Pdo(1, True, 0x180 + settings.node_id, settings.sync_divider, entries)


#: Profile torque ramps towards its target; with the steepest ramp it acts like cyclic torque.
_SLOPE = Object(0x6087, 0, _STEEPEST_SLOPE, 4, "", "torque slope")


def drive_traffic(
    settings: DriveSettings,
    sync_producer: bool = True,
    profile: DriveProfile = ANY_DRIVE.drive,
    found: DriveSetup | None = None,
) -> list[Traffic]:
    """Return the frames of this device for the bus load, SYNC included where we send it.

    found: its configuration, which says what TPDO2 came to; None before that.
    """
    name, rate = f"drive {settings.node_id}", settings.rate
    found = found or unconfigured(settings)
    frames = [
        Traffic(f"{name} RPDO1", command_layout(profile).size, rate),
        Traffic(f"{name} TPDO1", STATUS_LAYOUT.size, rate),
        Traffic(f"{name} heartbeat", 1, 1.0 / settings.drive_heartbeat),
        Traffic(f"heartbeat {settings.master_id}", 1, 1.0 / settings.heartbeat_period),
    ]
    if found.slow:
        slow = drive_slow_status.layout(found.slow)
        frames.insert(2, Traffic(f"{name} TPDO2", slow.size, found.slow_rate))
    sync = Traffic("SYNC", 0, rate * settings.sync_divider)
    return [sync, *frames] if sync_producer else frames


# -- the dialogue --------------------------------------------------------------------------------


def without_torque(sdo: Sdo, profile: DriveProfile) -> None:
    """Write zero to the command and to the controlword. Raises NotAnswering, BusError."""
    for key, size in ((key_of(profile.command), profile.command_size), ((0x6040, 0), 2)):
        with contextlib.suppress(Refused):  # by PDO only; the first command sends the same
            sdo.write(*key, 0, size)


def set_up(port: Port, sdo: Sdo, settings: DriveSettings, profile: DriveProfile) -> DriveSetup:
    """Configure an identified drive that is in PRE-OPERATIONAL as the settings describe.

    Raises NotAnswering, WrongDevice, Refused, NotConfigured.
    """
    rated, thousand = _rating(sdo, settings, profile)
    largest = _largest(settings, rated, thousand, profile)
    write(sdo, settings, profile.mode_objects, largest)
    mode = _select_mode(port, sdo, profile)
    warnings: list[str] = [] if profile.rating else [_unchecked_rating(sdo, settings)]
    if mode == PROFILE_TORQUE_MODE:
        warnings += written(sdo, (_SLOPE,))[1]
    else:
        _clear_offset(sdo)
    command, status = command_pdo(settings, profile), status_pdo(settings, profile)
    slow = drive_slow_status.wanted_objects(profile)
    used = (command, status, *drive_slow_status.wanted_pdos(settings, slow)[:1 if slow else 0])
    open_ids = pdo.disable_unused(sdo, used)
    pdo.configure(sdo, status)
    slow, slow_rate, told = drive_slow_status.configure(sdo, settings, profile)
    no_deadline = pdo.configure(sdo, command, timer_optional=True)
    missing, refused = written(sdo, stop_objects(settings, rated))
    if no_deadline:
        way_out = cure(no_deadline, "command_timeout")
        missing.insert(0, MissingGuard(COMMAND_DEADLINE, str(no_deadline), way_out))
    unguarded, stood_in = replaced(sdo, settings, profile, missing, largest)
    warned = (*warnings, *told, *refused)
    return DriveSetup(
        mode, rated, thousand, unguarded, stood_in, warned, slow, slow_rate, open_ids
    )


def _largest(
    settings: DriveSettings, rated: float, thousand: float, profile: DriveProfile
) -> Largest:
    wanted = math.ceil(settings.max_torque / thousand * PER_MILLE - _ROUNDING)
    command = min(wanted, profile.largest_target, LARGEST_PER_MILLE)
    share = min(settings.max_torque, profile.largest_target / PER_MILLE * thousand) / rated
    return Largest(share, command)


def limit_again(
    sdo: Sdo, settings: DriveSettings, profile: DriveProfile, found: DriveSetup
) -> DriveSetup:
    """Tell a configured drive, which must be off, another `max_torque` as its own limit.

    Raises NotAnswering. Where the operator has waived the limit, there is none to write.
    """
    if any(each.guard == TORQUE_LIMIT for each in found.unguarded):
        return found
    missing, _ = written(sdo, (limit_object(settings, found.rated_torque),))
    largest = _largest(settings, found.rated_torque, found.thousand, profile)
    lacking, _ = replaced(sdo, settings, profile, missing, largest)
    return found._replace(unguarded=(*found.unguarded, *lacking))


def _rating(sdo: Sdo, settings: DriveSettings, profile: DriveProfile) -> tuple[float, float]:
    """Return the rated torque and the torque of a command of 1000 [Nm].

    Raises NotConfigured where the drive does not tell the rated torque, and its profile or our
    parameters do not say what the command means; WrongDevice where drive and parameter differ.
    """
    if profile.rating:
        units = (profile.rated_torque_unit,) if profile.rated_torque_unit else (_MILLI, _MICRO)
        try:
            raw = sdo.unsigned(key_of(profile.rating)[0])
        except Refused as error:
            if not error.absent:
                raise
            raise NotConfigured(
                f"{sdo.label} does not tell its rated torque (6076 is absent), so nobody knows "
                "what a command of 1000 is: only a `profile` of its make can say it (`rating`, "
                "`rated_command`)"
            ) from error
        rated = rated_torque(raw, settings.rated_torque, sdo.label, units)
        return rated, rated
    command = settings.rated_command or profile.rated_command
    if not command:
        raise NotConfigured(
            f"{sdo.label} is commanded in a unit of its own (object {profile.command}) and does "
            "not tell its rated torque: set `rated_command` to what its command is at "
            f"`rated_torque`, {settings.rated_torque:g} Nm; the notes of its profile say how"
        )
    return settings.rated_torque, settings.rated_torque * PER_MILLE / command


def _unchecked_rating(sdo: Sdo, settings: DriveSettings) -> str:
    return (
        f"{sdo.label} does not tell its rated torque: {settings.rated_torque:g} Nm is the "
        "parameter's word alone, and a wrong one makes each force wrong; measure one"
    )


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


def _select_mode(port: Port, sdo: Sdo, profile: DriveProfile) -> int:
    """Set the best of the modes that the drive has. A maker's own show in no bit of 6502."""
    own = [mode for mode in profile.modes if mode < 0]
    supported = 0 if own == list(profile.modes) else sdo.unsigned(0x6502)
    has = {mode: supported >> bit & 1 for mode, bit in _MODE_BITS.items()} | dict.fromkeys(own, 1)
    mode = next((mode for mode in profile.modes if has[mode]), 0)
    if not mode:
        raise WrongDevice(
            f"{sdo.label} has neither cyclic synchronous torque nor profile torque mode "
            f"(6502 = 0x{supported:X})"
        )
    sdo.write(0x6060, 0, mode, 1)
    if profile.mode_shown != ALWAYS:
        return mode  # it shows the mode later, before torque may pass
    if not port.wait_for(lambda: sdo.signed(0x6061) == mode, _MODE_WITHIN_S):
        shown = sdo.signed(0x6061)
        raise NotConfigured(
            f"{sdo.label}: mode {mode} was asked for (6060), 6061 shows {shown}; if it shows the "
            "mode in some states only, `mode_shown` of its profile says so"
        )
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
