# SPDX-License-Identifier: Apache-2.0
"""Object dictionary and SDO server of a simulated device (CiA 301, sections 7.2.4 and 7.4).

`canopen.LocalNode` implements the EDS file and the SDO protocol. This module adds values, access
and effects: `sources` return live values, `checks` may refuse a value with an abort code before it
is stored, `sinks` act on it afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import canopen
from canopen.objectdictionary import ODRecord, ODVariable, datatypes
from canopen.sdo.exceptions import SdoAbortedError

from screw_module_ros.profiles import ObjectTrait, key_of

NO_OBJECT = 0x06020000
WRITE_ONLY = 0x06010001
READ_ONLY = 0x06010002
UNSUPPORTED_ACCESS = 0x06010000
NOT_MAPPABLE = 0x06040041
PDO_TOO_LONG = 0x06040042
INCOMPATIBLE_PARAMETER = 0x06040043
WRONG_LENGTH = 0x06070010
NO_SUBINDEX = 0x06090011
INVALID_VALUE = 0x06090030
VALUE_TOO_HIGH = 0x06090031
VALUE_TOO_LOW = 0x06090032
NO_RESOURCE = 0x060A0023
GENERAL_ERROR = 0x08000000
NO_DATA = 0x08000024

_EDS_FOLDER = Path(__file__).with_name("eds")
_MAPPINGS = (*range(0x1600, 0x1604), *range(0x1A00, 0x1A04))
_SDO_LENGTH = 8
_COMMAND, _DOWNLOAD_OF_ANY_SIZE = 0xE3, 0x22

_UNSIGNED = {1: datatypes.UNSIGNED8, 2: datatypes.UNSIGNED16, 4: datatypes.UNSIGNED32}
_SIGNED = {1: datatypes.INTEGER8, 2: datatypes.INTEGER16, 4: datatypes.INTEGER32}

Key = tuple[int, int]
Send = Callable[[int, bytes], None]


def require(allowed: object, code: int) -> None:
    """Raise SdoAbortedError with an abort code unless something is allowed."""
    if not allowed:
        raise SdoAbortedError(code)


class ObjectDictionary(canopen.LocalNode):
    """The objects of one device.

    node_id: CANopen node id; eds: file name below rig/eds; traits: how those of its make differ
    from the file; send: takes the SDO server's frames;
    changed: called with the index after a write.
    sources: (index, subindex) -> function returning the present value.
    sinks: (index, subindex) -> function called with a value after it was stored.
    checks: called with (index, subindex, value) before a write; raise SdoAbortedError to refuse.
    """

    def __init__(
        self,
        node_id: int,
        eds: str,
        traits: Mapping[str, ObjectTrait],
        send: Send,
        changed: Callable[[int], None],
    ):
        dictionary = canopen.import_od(str(_EDS_FOLDER / eds), node_id)
        for key, trait in traits.items():
            _give(dictionary, *key_of(key), trait, node_id)
        for index in _MAPPINGS:
            _unmap_absent(dictionary, index)
        super().__init__(node_id, dictionary)
        self.sdo.send_response = lambda response: send(  # type: ignore[method-assign]  # its hook
            self.sdo.tx_cobid, bytes(response)
        )
        self.sources: dict[Key, Callable[[], int]] = {}
        self.sinks: dict[Key, Callable[[int], None]] = {}
        self.checks: list[Callable[[int, int, int], None]] = []
        self.malformed = 0
        self._changed = changed
        self._stored: dict[Key, bytes] = {}

    def on_sdo(self, data: bytes) -> None:
        """Serve one request; a frame that is not eight bytes long is no SDO and is dropped."""
        if len(data) != _SDO_LENGTH:
            self.malformed += 1
            return
        try:
            self.sdo.on_request(self.sdo.rx_cobid, self._sized(data), 0.0)
        except Exception:
            # The library cannot abort a segment without a begun transfer: it has no index to name.
            self.malformed += 1

    def _sized(self, data: bytes) -> bytearray:
        """Return a request with its size: an expedited download may leave that open (s = 0)."""
        request = bytearray(data)
        if request[0] & _COMMAND == _DOWNLOAD_OF_ANY_SIZE:
            try:
                size = len(self.variable(request[1] | request[2] << 8, request[3])) // 8
            except SdoAbortedError:
                return request  # the server aborts it
            if 1 <= size <= 4:
                request[0] |= 4 - size << 2 | 1
        return request

    def variable(self, index: int, subindex: int) -> ODVariable:
        """Return the entry of the dictionary; SdoAbortedError when there is none."""
        entry: Any = self.object_dictionary.indices.get(index)
        require(entry is not None, NO_OBJECT)
        if isinstance(entry, ODVariable):
            entry = entry if subindex == 0 else None
        else:
            entry = entry.subindices.get(subindex)
        require(entry is not None, NO_SUBINDEX)
        return entry

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        """Return the bytes of an object; SdoAbortedError when there are none."""
        variable = self.variable(index, subindex)
        require(variable.readable or not check_readable, WRITE_ONLY)
        source = self.sources.get((index, subindex))
        if source is not None:
            return variable.encode_raw(source())
        stored = self._stored.get((index, subindex))
        if stored is not None:
            return stored
        default: Any = variable.default
        require(default is not None, NO_RESOURCE)
        return variable.encode_raw(default)

    def set_data(
        self, index: int, subindex: int, data: bytes, check_writable: bool = False
    ) -> None:
        """Write an object as a master would; SdoAbortedError when the device refuses."""
        variable = self.variable(index, subindex)
        require(variable.writable or not check_writable, READ_ONLY)
        require(8 * len(data) == len(variable), WRONG_LENGTH)
        value = _number(variable, bytes(data))
        require(variable.max is None or value <= variable.max, VALUE_TOO_HIGH)
        require(variable.min is None or value >= variable.min, VALUE_TOO_LOW)
        for check in self.checks:
            check(index, subindex, value)
        self._stored[index, subindex] = bytes(data)
        sink = self.sinks.get((index, subindex))
        if sink is not None:
            sink(value)
        self._changed(index)

    def value(self, index: int, subindex: int = 0) -> int:
        """Return an object's present number."""
        return _number(self.variable(index, subindex), self.get_data(index, subindex))

    def has(self, index: int, subindex: int = 0) -> bool:
        """Return whether the device has an object."""
        try:
            self.variable(index, subindex)
        except SdoAbortedError:
            return False
        return True

    def optional(self, index: int, subindex: int, default: int) -> int:
        """Return an object's present number, `default` if the device does not have it."""
        return self.value(index, subindex) if self.has(index, subindex) else default

    def put(self, index: int, subindex: int, value: int) -> None:
        """Set an object from inside the device, if it has it: no access rights, checks, sinks."""
        if not self.has(index, subindex):
            return
        self._stored[index, subindex] = self.variable(index, subindex).encode_raw(value)

    def restore(self, indices: range) -> None:
        """Restore the defaults of the EDS file for some objects."""
        self._stored = {k: v for k, v in self._stored.items() if k[0] not in indices}


def _unmap_absent(dictionary: canopen.ObjectDictionary, index: int) -> None:
    """Let a mapping that the file gives a device begin empty where its make lacks an object."""
    mapping: Any = dictionary.indices.get(index)
    if mapping is None:
        return
    entries = [mapping.subindices[n].default for n in range(1, mapping.subindices[0].default + 1)]
    if any(entry >> 16 not in dictionary.indices for entry in entries):
        mapping.subindices[0].default = 0


def _number(variable: ODVariable, data: bytes) -> int:
    """Return what the bytes of a whole number stand for."""
    value = variable.decode_raw(data)
    assert isinstance(value, int)
    return value


def _give(
    dictionary: canopen.ObjectDictionary, index: int, subindex: int, trait: ObjectTrait, node: int
) -> None:
    """Make one object of a dictionary what it is at a maker's device. node: its node id."""
    entry: Any = dictionary.indices.get(index)
    if trait.absent:
        if subindex:
            entry.subindices.pop(subindex)
        else:
            dictionary.indices.pop(index)
        return
    if trait.size:
        entry = entry or dictionary
        if subindex and entry is dictionary:
            entry = ODRecord(f"{index:04X}", index)
            dictionary.add_object(entry)
        variable = ODVariable(f"{index:04X}:{subindex:02X}", index, subindex)
        kinds = _SIGNED if trait.signed else _UNSIGNED
        variable.data_type, variable.access_type = kinds[trait.size], "rw"
        variable.pdo_mappable = True
        if entry is dictionary:
            dictionary.add_object(variable)
        else:
            entry.add_member(variable)
    else:
        variable = entry if isinstance(entry, ODVariable) else entry.subindices[subindex]
    if trait.read_only:
        variable.access_type = "ro"
    variable.pdo_mappable = variable.pdo_mappable and trait.mappable
    if trait.value is not None:
        variable.default = trait.value + (node if trait.per_node else 0)
