# SPDX-License-Identifier: Apache-2.0
"""TPDO2 of a CiA 402 drive: error code, mode and digital inputs, as far as the drive can map them.

It is best effort. What it does not bring is read by SDO (`reported.py`), so that a drive with other
transmission types, without an event timer, or with no TPDO2 at all is no obstacle.
"""

from __future__ import annotations

import contextlib
import struct
from functools import cache

from ..profiles import DriveProfile, key_of
from . import pdo
from .drive_settings import DriveSettings
from .errors import DeviceError, NotConfigured, Refused
from .sdo import Sdo

ERROR_CODE, MODE_DISPLAY, DIGITAL_INPUTS = 0x603F, 0x6061, 0x60FD
#: Of TPDO2, as far as a make can map them: object -> code of `struct`, size [bit].
SLOW_STATUS = {ERROR_CODE: ("H", 16), MODE_DISPLAY: ("b", 8), DIGITAL_INPUTS: ("I", 32)}

PERIOD_MS = 100
_MOST_SYNCS = 240


def identifier(settings: DriveSettings) -> int:
    """Return the identifier of TPDO2."""
    return 0x280 + settings.node_id


@cache
def layout(objects: tuple[int, ...]) -> struct.Struct:
    """Return the layout of TPDO2 with these objects."""
    return struct.Struct("<" + "".join(SLOW_STATUS[index][0] for index in objects))


def wanted_objects(profile: DriveProfile) -> tuple[int, ...]:
    """Return the objects that this make is asked to put into TPDO2."""
    return tuple(key_of(key)[0] for key in profile.slow_status)


def wanted_pdos(
    settings: DriveSettings, objects: tuple[int, ...], timer: bool = True
) -> list[pdo.Pdo]:
    """Return TPDO2 with these objects, best way first.

    On change and every 100 ms, if it has a timer; after as many SYNCs; at each SYNC.
    """
    syncs = round(PERIOD_MS * 1e-3 * settings.rate * settings.sync_divider)
    kinds = [(pdo.ON_EVENT, PERIOD_MS)] if timer else []
    kinds += [(max(1, min(_MOST_SYNCS, syncs)), 0), (pdo.ON_EVERY_SYNC, 0)]
    entries = tuple(pdo.Entry(index, 0, SLOW_STATUS[index][1]) for index in objects)
    return [
        pdo.Pdo(2, True, identifier(settings), kind, entries, timer_ms)
        for kind, timer_ms in dict.fromkeys(kinds)
    ]


def frame_rate(settings: DriveSettings, chosen: pdo.Pdo) -> float:
    """Return the frames per second of TPDO2, those on change not counted [Hz]."""
    if chosen.timer_ms:
        return 1e3 / chosen.timer_ms
    return settings.rate * settings.sync_divider / chosen.kind


def configure(
    sdo: Sdo, settings: DriveSettings, profile: DriveProfile
) -> tuple[tuple[int, ...], float, list[str]]:
    """Configure TPDO2 as well as the drive lets us; TPDO2 is off where it does not.

    Returns its objects, its frames per second [Hz], and a warning for what it was to bring and does
    not: the digital inputs alone are none, a drive need not have them. Raises NotAnswering.
    """
    wanted = wanted_objects(profile)
    objects, why = wanted, ""
    for look in (False, True):
        if look and objects:
            objects = _mappable(sdo, wanted_pdos(settings, wanted)[0])
        for tried in wanted_pdos(settings, objects, profile.slow_status_timer) if objects else ():
            try:
                pdo.configure(sdo, tried)
            except (Refused, NotConfigured) as error:
                why = why or str(error)
            else:
                warned = _warned(sdo, wanted, objects, tried, why)
                return objects, frame_rate(settings, tried), warned
    with contextlib.suppress(Refused, NotConfigured):
        pdo.switch_off(sdo, wanted_pdos(settings, wanted)[0])
    return (), 0.0, _warned(sdo, wanted, (), None, why)


def _mappable(sdo: Sdo, tried: pdo.Pdo) -> tuple[int, ...]:
    try:
        return tuple(entry.index for entry in pdo.mappable(sdo, tried))
    except DeviceError as error:
        if isinstance(error, (Refused, NotConfigured)):
            return ()
        raise


def _warned(
    sdo: Sdo, wanted: tuple[int, ...], found: tuple[int, ...], chosen: pdo.Pdo | None, why: str
) -> list[str]:
    lacking = [f"{index:04X}" for index in wanted if index not in found]
    if lacking and set(lacking) != {f"{DIGITAL_INPUTS:04X}"}:
        return [f"{sdo.label}: TPDO2 does not bring {', '.join(lacking)}, asked for by SDO ({why})"]
    if chosen and chosen.kind == pdo.ON_EVERY_SYNC and why:
        return [f"{sdo.label}: TPDO2 comes at each SYNC, no other way was taken ({why})"]
    return []
