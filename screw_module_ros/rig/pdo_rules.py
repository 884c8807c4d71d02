# SPDX-License-Identifier: Apache-2.0
"""Refusals of a device while a master configures its PDOs (CiA 301, sections 7.5.2.35 to 38).

A master has to disable a PDO before it changes its id or mapping, and to clear the mapping before
it writes entries. A simulated device without these checks would hide a wrong order.
"""

from __future__ import annotations

from canopen.sdo.exceptions import SdoAbortedError

from screw_module_ros.rig.object_dictionary import (
    INVALID_VALUE,
    NO_OBJECT,
    NOT_MAPPABLE,
    PDO_TOO_LONG,
    UNSUPPORTED_ACCESS,
    DeviceNode,
)

RPDO = range(0x1400, 0x1600)
RPDO_MAPPING = range(0x1600, 0x1800)
TPDO = range(0x1800, 0x1A00)
TPDO_MAPPING = range(0x1A00, 0x1C00)
MAPPING_OFFSET = 0x200

COB_ID, TRANSMISSION_TYPE, INHIBIT_TIME, EVENT_TIMER = 1, 2, 3, 5
INVALID_BIT = 1 << 31
ID_MASK = 0x7FF

_EXTENDED_BIT = 1 << 29
_ID_BITS = 0x3FFFFFFF
_RESERVED_TYPES = range(241, 254)
_MOST_ENTRIES = 8
_MOST_BITS = 64
_LAST_DUMMY = 7
_RESTRICTED_IDS = (
    range(0x080),
    range(0x101, 0x181),
    range(0x581, 0x600),
    range(0x601, 0x680),
    range(0x6E0, 0x700),
    range(0x701, 0x800),
)


def check_pdo_write(node: DeviceNode, index: int, subindex: int, value: int) -> None:
    """Raise SdoAbortedError when `node` would not accept this write to a PDO parameter."""
    if index in RPDO or index in TPDO:
        _check_communication(node, index, subindex, value)
    elif index in RPDO_MAPPING or index in TPDO_MAPPING:
        _check_mapping(node, index, subindex, value)


def _check_communication(node: DeviceNode, index: int, subindex: int, value: int) -> None:
    present = node.value(index, COB_ID)
    valid = not present & INVALID_BIT
    if subindex == COB_ID:
        renamed = (value ^ present) & _ID_BITS
        if value & _EXTENDED_BIT or (valid and not value & INVALID_BIT and renamed):
            raise SdoAbortedError(INVALID_VALUE)
        if not value & INVALID_BIT and any(value & ID_MASK in ids for ids in _RESTRICTED_IDS):
            raise SdoAbortedError(INVALID_VALUE)
    elif subindex == TRANSMISSION_TYPE and value in _RESERVED_TYPES:
        raise SdoAbortedError(INVALID_VALUE)
    elif subindex == INHIBIT_TIME and valid:
        raise SdoAbortedError(INVALID_VALUE)


def _check_mapping(node: DeviceNode, index: int, subindex: int, value: int) -> None:
    if not node.value(index - MAPPING_OFFSET, COB_ID) & INVALID_BIT:
        raise SdoAbortedError(UNSUPPORTED_ACCESS)
    received = index in RPDO_MAPPING
    if subindex == 0:
        _check_length(node, index, value, received)
    elif node.value(index, 0):
        raise SdoAbortedError(UNSUPPORTED_ACCESS)
    else:
        check_entry(node, value, received)


def _check_length(node: DeviceNode, index: int, count: int, received: bool) -> None:
    if count > _MOST_ENTRIES:
        raise SdoAbortedError(PDO_TOO_LONG)
    entries = [node.value(index, number) for number in range(1, count + 1)]
    for entry in entries:
        check_entry(node, entry, received)
    if sum(entry & 0xFF for entry in entries) > _MOST_BITS:
        raise SdoAbortedError(PDO_TOO_LONG)


def check_entry(node: DeviceNode, entry: int, received: bool) -> None:
    """Raise SdoAbortedError when a mapping entry (index, subindex, bits) cannot be mapped."""
    index, subindex, bits = entry >> 16, entry >> 8 & 0xFF, entry & 0xFF
    if index == 0:
        raise SdoAbortedError(NO_OBJECT)
    variable = node.variable(index, subindex)
    dummy = received and index <= _LAST_DUMMY
    reachable = variable.writable if received else variable.readable
    if bits != len(variable) or not (dummy or (variable.pdo_mappable and reachable)):
        raise SdoAbortedError(NOT_MAPPABLE)
