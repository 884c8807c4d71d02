# SPDX-License-Identifier: Apache-2.0
"""Configures process data objects (CiA 301, 7.5.2.35 to 38) in the order that devices require.

Per PDO: disable (bit 31), count 0, entries, count, type, timers, enable; each value is read back.
Identifiers are compared under the mask 0x7FF, since the device may set bit 30 and others itself.
"""

from __future__ import annotations

from typing import NamedTuple

from .errors import NotConfigured, Refused
from .sdo import Sdo

_ID_MASK = 0x7FF
_DISABLED, _NO_REMOTE, _EXTENDED = 1 << 31, 1 << 30, 1 << 29
_RECEIVE_PARAMETERS, _TRANSMIT_PARAMETERS = 0x1400, 0x1800
_MAPPING = 0x200  # distance from the parameters of a PDO to its mapping
#: PDOs beyond these may exist but are disabled by default in CiA 301.
_PDOS_LOOKED_AT = 8

ON_EVERY_SYNC = 1
ON_EVENT = 255


class Entry(NamedTuple):
    """One mapped object: index, sub-index and its size [bit]."""

    index: int  # type: ignore[assignment]  # hides the tuple's method
    subindex: int
    bits: int

    @property
    def value(self) -> int:
        """Value of the entry in the mapping object."""
        return self.index << 16 | self.subindex << 8 | self.bits


class Pdo(NamedTuple):
    """Desired configuration of one PDO.

    number: 1 for the first. transmit: sent by the device. cob_id: its identifier. kind:
    transmission type, 1..240 = at every n-th SYNC, 255 = on event. entries: mapped objects.
    timer_ms: event timer of a TPDO, deadline of an RPDO [ms], 0 = off.
    """

    number: int
    transmit: bool
    cob_id: int
    kind: int
    entries: tuple[Entry, ...]
    timer_ms: int = 0

    @property
    def parameters(self) -> int:
        """Index of the communication parameters."""
        base = _TRANSMIT_PARAMETERS if self.transmit else _RECEIVE_PARAMETERS
        return base + self.number - 1

    @property
    def mapping(self) -> int:
        """Index of the mapping."""
        return self.parameters + _MAPPING

    @property
    def size(self) -> int:
        """Length of the frame [byte]."""
        return sum(entry.bits for entry in self.entries) // 8


def disable_unused(sdo: Sdo, used: tuple[Pdo, ...]) -> tuple[int, ...]:
    """Disable every PDO of the device that is not in `used`; raises as `Sdo.set`.

    A PDO whose identifier is read-only loses its entries instead. Returns the identifiers at which
    the device still takes commands all the same: RPDOs with a read-only mapping too.
    """
    keep = {pdo.parameters for pdo in used}
    left = []
    for base in (_RECEIVE_PARAMETERS, _TRANSMIT_PARAMETERS):
        for index in range(base, base + _PDOS_LOOKED_AT):
            if index in keep:
                continue
            try:
                before = sdo.unsigned(index, 1)
            except Refused:
                continue  # no such PDO
            off = _disabled(sdo, index, before) or _emptied(sdo, index)
            if not off and base == _RECEIVE_PARAMETERS:
                left.append(before & _ID_MASK)
    return tuple(left)


def switch_off(sdo: Sdo, pdo: Pdo) -> None:
    """Switch a PDO off, or take its entries away; raises as `Sdo.set`."""
    if not _disabled(sdo, pdo.parameters, sdo.unsigned(pdo.parameters, 1)):
        _emptied(sdo, pdo.parameters)


def mappable(sdo: Sdo, pdo: Pdo) -> tuple[Entry, ...]:
    """Switch a PDO off; return those of its entries that the device can map into it.

    Those of a fixed mapping count if all of them are among ours, in our order. Raises as `Sdo.set`.
    """
    _disabled(sdo, pdo.parameters, sdo.unsigned(pdo.parameters, 1))
    try:
        sdo.set(pdo.mapping, 0, 0, 1)
    except Refused:
        count = sdo.unsigned(pdo.mapping, 0)
        there = [sdo.unsigned(pdo.mapping, subindex + 1) for subindex in range(count)]
        kept = tuple(entry for entry in pdo.entries if entry.value in there)
        return kept if [entry.value for entry in kept] == there else ()
    found: list[Entry] = []
    for entry in pdo.entries:
        try:
            sdo.set(pdo.mapping, len(found) + 1, entry.value, 4)
        except (Refused, NotConfigured):
            continue
        found.append(entry)
    return tuple(found)


def configure(
    sdo: Sdo, pdo: Pdo, timer_optional: bool = False
) -> Refused | NotConfigured | None:
    """Configure one PDO and read everything back.

    With `timer_optional`, returns why the device refused the timer, else None. Raises
    NotConfigured, Refused, NotAnswering.
    """
    before = sdo.unsigned(pdo.parameters, 1)
    disabled = _disabled(sdo, pdo.parameters, before)
    _map(sdo, pdo)
    sdo.set(pdo.parameters, 2, pdo.kind, 1)
    if pdo.transmit:
        _clear_if_there(sdo, pdo.parameters, 3)
        _clear_if_there(sdo, pdo.parameters, 6, size=1)  # which SYNC by its counter: ours has none
    refused = _set_timer(sdo, pdo, timer_optional)
    if disabled:
        keep = before & _NO_REMOTE if pdo.transmit else 0
        sdo.write(pdo.parameters, 1, keep | pdo.cob_id, 4)
    found = sdo.unsigned(pdo.parameters, 1)
    if found & _ID_MASK != pdo.cob_id or found & (_DISABLED | _EXTENDED):
        raise NotConfigured(
            f"{sdo.label}: PDO {pdo.parameters:04X} should be enabled with identifier "
            f"0x{pdo.cob_id:X}, read back 0x{found:08X}"
        )
    return refused


def _disabled(sdo: Sdo, parameters: int, before: int) -> bool:
    """Disable the PDO; return whether it is off: a read-only identifier stays as it is.

    before: its identifier object.
    """
    if before & _DISABLED:
        return True
    try:
        sdo.write(parameters, 1, before | _DISABLED, 4)
    except Refused as error:
        if not error.read_only:
            raise
        return False
    if not sdo.unsigned(parameters, 1) & _DISABLED:
        raise NotConfigured(f"{sdo.label}: PDO {parameters:04X} cannot be disabled")
    return True


def _emptied(sdo: Sdo, parameters: int) -> bool:
    """Return whether the PDO has no entries any more."""
    try:
        sdo.set(parameters + _MAPPING, 0, 0, 1)
    except (Refused, NotConfigured):
        return False
    return True


def _map(sdo: Sdo, pdo: Pdo) -> None:
    wanted = [entry.value for entry in pdo.entries]
    try:
        sdo.set(pdo.mapping, 0, 0, 1)
    except Refused as error:
        count = sdo.unsigned(pdo.mapping, 0)
        if [sdo.unsigned(pdo.mapping, subindex + 1) for subindex in range(count)] != wanted:
            raise NotConfigured(
                f"{sdo.label}: the mapping {pdo.mapping:04X} is fixed and not the one needed "
                f"({error})"
            ) from error
        return  # fixed, and as desired
    for subindex, value in enumerate(wanted, start=1):
        sdo.set(pdo.mapping, subindex, value, 4)
    sdo.set(pdo.mapping, 0, len(wanted), 1)


def _set_timer(sdo: Sdo, pdo: Pdo, optional: bool) -> Refused | NotConfigured | None:
    if pdo.timer_ms == 0:
        _clear_if_there(sdo, pdo.parameters, 5)
        return None
    try:
        sdo.set(pdo.parameters, 5, pdo.timer_ms, 2)
    except (Refused, NotConfigured) as error:
        if not optional:
            raise
        return error
    return None


def _clear_if_there(sdo: Sdo, parameters: int, subindex: int, size: int = 2) -> None:
    """Set an entry to 0 unless it is 0 already or the device does not implement it."""
    try:
        if sdo.unsigned(parameters, subindex) == 0:
            return
    except Refused:
        return
    sdo.set(parameters, subindex, 0, size)
