# SPDX-License-Identifier: Apache-2.0
"""Reads and writes the object dictionary of one device (CiA 301, 7.2.4), with readable errors.

canopen's client implements the protocol; this module adds the time limit, a second try, the
read-back, and the device's name in every message. Calls block: never call them from a realtime
loop. The thread that pumps the port delivers the answers.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable
from typing import Any

from canopen.objectdictionary import ObjectDictionary
from canopen.sdo import SdoAbortedError, SdoClient, SdoCommunicationError

from ..can_io.port import Port
from .errors import NotAnswering, NotConfigured, Refused

_FRAME_BYTES = 8
_ABORT = struct.Struct("<BHBL")
_ABORT_COMMAND = 0x80
_GENERAL_ERROR = 0x08000000
_NO_OBJECT = b"\0\0"
#: Abort codes of the transfer, in their high half; they say nothing of the object.
_OF_THE_TRANSFER = (0x0503, 0x0504)
_FEWEST_DOUBLED = 5
_TRIES = 2
_REQUEST_BASE = 0x600
_RESPONSE_BASE = 0x580


class Sdo:
    """SDO client of one node, and the only one in the whole graph.

    label: name of the device in messages. timeout_s: time limit of one try [s]; there are two.
    on_foreign(): called by the thread that pumps the port, for each request of another client to
    the node.
    """

    def __init__(
        self,
        port: Port,
        node_id: int,
        label: str,
        timeout_s: float,
        on_foreign: Callable[[], None],
    ):
        self.label = label
        self._port = port
        self._node_id = node_id
        self._lock = threading.Lock()
        self._object = _NO_OBJECT
        self._client = _Client(port, node_id, timeout_s)
        self.count_anew()
        port.subscribe(_RESPONSE_BASE + node_id, self._on_response)
        # Our own frames do not arrive here.
        port.subscribe(_REQUEST_BASE + node_id, lambda _data, _arrival_ns: on_foreign())

    def count_anew(self) -> None:
        """Forget which answers were too many."""
        self._asked = self._client.asked
        self._surplus = self._client.missed

    @property
    def doubled(self) -> bool:
        """Whether most requests since the last `count_anew` had two answers: two devices."""
        surplus = self._surplus - self._client.missed  # those may have come late
        return surplus >= _FEWEST_DOUBLED and 2 * surplus > self._client.asked - self._asked

    @property
    def foreign_client(self) -> str:
        """Description of a second client, for messages."""
        return (
            f"another SDO client (frames 0x{_REQUEST_BASE + self._node_id:X} on "
            f"{self._port.name})"
        )

    def _on_response(self, data: bytes, _arrival_ns: int) -> None:
        # An abort of another object answers a request that was repeated. canopen would take it for
        # ours, and an existing object would pass for absent.
        stale = data[:1] == bytes([_ABORT_COMMAND]) and data[1:3] not in (self._object, _NO_OBJECT)
        if len(data) != _FRAME_BYTES or stale:
            return
        if self._client.awaits:
            self._client.on_response(_RESPONSE_BASE + self._node_id, data, 0.0)
        else:
            self._surplus += 1

    def read(self, index: int, subindex: int = 0) -> bytes:
        """Upload one object.

        Raises NotAnswering after two tries, Refused with the device's abort code, BusError.
        """
        return self._transfer(index, subindex, lambda: self._client.upload(index, subindex))

    def unsigned(self, index: int, subindex: int = 0) -> int:
        """Upload an unsigned integer of any size; raises as `read`."""
        return int.from_bytes(self.read(index, subindex), "little")

    def has(self, index: int, subindex: int = 0) -> bool:
        """Return whether the device has an object; raises NotAnswering, BusError."""
        try:
            self.read(index, subindex)
        except Refused as error:
            return not error.absent
        return True

    def signed(self, index: int) -> int:
        """Upload a signed integer of any size; raises as `read`."""
        return int.from_bytes(self.read(index), "little", signed=True)

    def write(self, index: int, subindex: int, value: int, size: int) -> None:
        """Download an integer of `size` bytes, negative ones in two's complement.

        Raises as `read`.
        """
        data = (value & ((1 << (8 * size)) - 1)).to_bytes(size, "little")
        self._transfer(index, subindex, lambda: self._client.download(index, subindex, data))

    def set(self, index: int, subindex: int, value: int, size: int) -> None:
        """Download an integer and read it back.

        A constant of the device, which refuses the write, is taken if it has the value.
        Raises NotConfigured when another value comes back, otherwise as `read`.
        """
        mask = (1 << (8 * size)) - 1
        try:
            self.write(index, subindex, value, size)
        except Refused as error:
            if error.absent or self.unsigned(index, subindex) & mask != value & mask:
                raise
        found = self.unsigned(index, subindex) & mask
        if found != value & mask:
            raise NotConfigured(
                f"{self.label}: wrote 0x{value & mask:X} to {_name(index, subindex)} but read back "
                f"0x{found:X}; the device does not take this setting"
            )

    def _transfer(self, index: int, subindex: int, action: Callable[[], Any]) -> Any:
        with self._lock:
            self._object = index.to_bytes(2, "little")
            for left in reversed(range(_TRIES)):
                try:
                    return action()
                except SdoAbortedError as error:
                    if left and error.code >> 16 in _OF_THE_TRANSFER:
                        continue  # an earlier client may have left the device amid a transfer
                    raise Refused(
                        f"{self.label} refused {_name(index, subindex)}: {error}", error.code
                    ) from error
                except (SdoCommunicationError, struct.error) as error:
                    failure = error
            raise NotAnswering(self._silent(index, subindex, failure)) from failure

    def _silent(self, index: int, subindex: int, error: Exception) -> str:
        return (
            f"{self.label} (node id {self._node_id}) does not answer on {self._port.name} when "
            f"asked for {_name(index, subindex)} ({error}); check its power, cable, node id and "
            "bit rate, or start the simulated rig"
        )


class _Client(SdoClient):
    """canopen's client with its frames sent and received through the port.

    awaits: a request has no answer yet. asked, missed: requests sent, and those without an answer.
    """

    def __init__(self, port: Port, node_id: int, timeout_s: float):
        super().__init__(_REQUEST_BASE + node_id, _RESPONSE_BASE + node_id, ObjectDictionary())
        self.RESPONSE_TIMEOUT = timeout_s
        self._port = port
        self.awaits = False
        self.asked = self.missed = 0

    def send_request(self, request: bytes) -> None:
        self.awaits = True
        self.asked += 1
        self._port.send(self.rx_cobid, bytes(request))

    def on_response(self, can_id: int, data: bytes, timestamp: float) -> None:
        self.awaits = False
        super().on_response(can_id, data, timestamp)

    def read_response(self) -> bytes:
        if not self._port.wait_for(lambda: not self.responses.empty(), self.RESPONSE_TIMEOUT):
            self.awaits = False
            self.missed += 1
            raise SdoCommunicationError("no response")
        return super().read_response()

    def abort(self, abort_code: int = _GENERAL_ERROR) -> None:
        """Abort the transfer at the server; the caller gets an exception, so nothing is logged."""
        self._port.send(self.rx_cobid, _ABORT.pack(_ABORT_COMMAND, 0, 0, abort_code))


def _name(index: int, subindex: int) -> str:
    return f"object {index:04X}:{subindex:02X}"
