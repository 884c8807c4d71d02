# SPDX-License-Identifier: Apache-2.0
"""Sets back what an earlier master left in a device and the cyclic exchange depends on (CiA 301).

A device keeps its communication objects until it is reset, or for ever where somebody has stored
them. A SYNC identifier, a counter in SYNC, a window for it or the watch of a master that is gone
would each make it silent, or stop it, for no reason that its frames show.
"""

from __future__ import annotations

from collections.abc import Collection

from ..can_io.port import SYNC_ID
from .errors import DeviceError, NotConfigured, Refused
from .sdo import Sdo

_GENERATES, _DISABLED = 1 << 30, 1 << 31
_SYNC, _EMERGENCY, _WATCHED = 0x1005, 0x1014, 0x1016
_EMERGENCY_BASE = 0x080
_CYCLE, _COUNTER = 0x1006, 0x1019
#: Times and counters of others that are 0 where nobody uses them: index, size [byte], name.
_UNUSED = (
    (0x1007, 4, "window for synchronous PDOs"),
    (0x100C, 2, "guard time"),
    (0x100D, 1, "life time factor"),
    (0x1015, 2, "inhibit time of emergencies"),
)


def set_back(
    sdo: Sdo, node_id: int, sync_period_us: int, ours: Collection[tuple[int, int]]
) -> list[str]:
    """Set the objects back that differ from what our exchange needs; return what was altered.

    sync_period_us: between two SYNCs [us]. ours: objects that we write by ourselves afterwards.
    What the device refuses and we can do without is told, too. Raises NotConfigured, naming the
    object, where it would not answer our SYNC; NotAnswering.
    """
    told = [_identifier(sdo, _SYNC, SYNC_ID, "SYNC identifier", needed=True)]
    told += _timing(sdo, None if (_CYCLE, 0) in ours else sync_period_us)
    told += [_cleared(sdo, index, 0, size, name) for index, size, name in _UNUSED]
    told.append(
        _identifier(sdo, _EMERGENCY, _EMERGENCY_BASE + node_id, "identifier of emergencies")
    )
    for entry in range(1, (_present(sdo, _WATCHED) or 0) + 1):
        if (_WATCHED, entry) not in ours:
            told.append(_cleared(sdo, _WATCHED, entry, 4, "heartbeat that it watches"))
    return [each for each in told if each]


def _present(sdo: Sdo, index: int, subindex: int = 0) -> int | None:
    """Return an object, None if the device does not have it."""
    try:
        return sdo.unsigned(index, subindex)
    except Refused:
        return None


def _identifier(sdo: Sdo, index: int, wanted: int, name: str, needed: bool = False) -> str:
    """Set an identifier; it may only change while its service is switched off.

    Bit 31 of 1005 means nothing; in 1014 it switches emergencies off. Bit 30 of 1005 makes SYNC.
    """
    found = _present(sdo, index)
    means_nothing = _DISABLED if index == _SYNC else _GENERATES
    if found is None or found & ~means_nothing == wanted:
        return ""
    try:
        sdo.write(index, 0, found & ~_GENERATES if index == _SYNC else found | _DISABLED, 4)
        sdo.set(index, 0, wanted, 4)
    except (Refused, NotConfigured) as error:
        return _left(sdo, index, found, name, error, needed)
    return _altered(sdo, index, 0, found, name)


def _timing(sdo: Sdo, period_us: int | None) -> list[str]:
    """Set cycle period and counter of SYNC: our SYNC has no counter. 0 means that nobody uses it.

    period_us: None where we write it ourselves. The counter may only change while the period is 0
    (CiA 301, 7.5.2.22).
    """
    cycle, counter = _present(sdo, _CYCLE), _present(sdo, _COUNTER)
    told = []
    if counter:
        try:
            if cycle:
                sdo.write(_CYCLE, 0, 0, 4)
            sdo.set(_COUNTER, 0, 0, 1)
        except (Refused, NotConfigured) as error:
            _left(sdo, _COUNTER, counter, "counter in SYNC", error, needed=True)
        told.append(_altered(sdo, _COUNTER, 0, counter, "counter in SYNC"))
    if not cycle or period_us is None or (cycle == period_us and not counter):
        return told
    try:
        sdo.set(_CYCLE, 0, period_us, 4)
    except (Refused, NotConfigured) as error:
        return [*told, _left(sdo, _CYCLE, cycle, "SYNC period", error)]
    return told if cycle == period_us else [*told, _altered(sdo, _CYCLE, 0, cycle, "SYNC period")]


def _cleared(sdo: Sdo, index: int, subindex: int, size: int, name: str) -> str:
    found = _present(sdo, index, subindex)
    if not found:
        return ""
    try:
        sdo.set(index, subindex, 0, size)
    except (Refused, NotConfigured) as error:
        return _left(sdo, index, found, name, error)
    return _altered(sdo, index, subindex, found, name)


def _altered(sdo: Sdo, index: int, subindex: int, found: int, name: str) -> str:
    return (
        f"{sdo.label} had 0x{found:X} in object {index:04X}:{subindex:02X} ({name}), left there by "
        "another program: it is set back"
    )


def _left(
    sdo: Sdo, index: int, found: int, name: str, error: DeviceError, needed: bool = False
) -> str:
    text = (
        f"{sdo.label} has 0x{found:X} in object {index:04X} ({name}) and does not let it be set "
        f"back: {error}"
    )
    if needed:
        raise NotConfigured(
            f"{text}; it would not answer our SYNC: set it with the maker's program, or restore "
            "the defaults (1011)"
        )
    return text
