# SPDX-License-Identifier: Apache-2.0
"""A device on `durand`, a library of CANopen responder nodes, on a bus of python-can.

durand has its own communication objects, SDO server, PDOs, NMT, heartbeat and EMCY; it lacks 1016
and the event timers of PDOs. It works in one asyncio loop, which has a thread of its own here.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import can
import canopen
import durand
from application import Application
from can.interfaces.virtual import VirtualBus
from canopen.objectdictionary import ODVariable
from durand.datatypes import DatatypeEnum
from durand.node import MinimalNode
from durand.object_dictionary import ObjectDictionary, Record, Variable
from durand.services.nmt import StateEnum

_BOUND_S, _LOOKS_EVERY_S = 10.0, 0.05
_OWN = (
    *range(0x1000, 0x1002), 0x1005, *range(0x1008, 0x100B), *range(0x1014, 0x1016), 0x1017, 0x1018,
    *range(0x1021, 0x1023), *range(0x1200, 0x1280), *range(0x1400, 0x1C00),
)  # fmt: skip
"""Objects of durand's own; of the file they have no values but the device type and identity."""


class ShortWaits(VirtualBus):
    """A bus whose reader, which durand lets wait for a second, may soon see that it is to end."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        return super().recv(_LOOKS_EVERY_S if timeout is None else min(timeout, _LOOKS_EVERY_S))


class DurandDevice:
    """One device; `dictionary`, `application`: as of `LocalDevice`."""

    name = "durand"

    def __init__(
        self,
        channel: str,
        node_id: int,
        dictionary: canopen.ObjectDictionary,
        application: Callable[[DurandDevice], Application],
    ):
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._bus = ShortWaits(channel=channel)
        self._alarms: dict[str, Any] = {}
        self._file = dictionary
        self._make = application
        self._node_id = node_id
        self.do(self._switch_on)

    def _switch_on(self) -> None:
        self.network = durand.CANBusNetwork(self._bus, self._loop)
        objects = ObjectDictionary()
        for index, entry in self._file.items():
            if index not in _OWN:
                objects[index] = _entry(entry)
        self.node = MinimalNode(self.network, self._node_id, objects)
        self.node.object_dictionary.write(0x1000, 0, self._file[0x1000].default)
        for subindex, variable in self._file[0x1018].items():
            if subindex:
                self.node.object_dictionary.write(0x1018, subindex, variable.default)
        self.application = self._make(self)
        for index, subindex in _written(self._file):
            hear = partial(self.application.written, index, subindex)
            self.node.object_dictionary.download_callbacks[index, subindex].add(hear)
        self.node.sync.callbacks.add(self.application.sampled)
        self.node.nmt.state_callbacks.add(self._entered)

    def _entered(self, state: StateEnum) -> None:
        if state == StateEnum.INITIALISATION:
            self.application.restart()
        self.application.entered(int(state))

    def close(self) -> None:
        self.do(self._switch_off)
        self._bus.shutdown()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _switch_off(self) -> None:
        self.network.stop()
        for handle in self._alarms.values():
            handle.cancel()
        self._alarms.clear()
        self.silence_heartbeat()

    # For the application.

    def get(self, index: int, subindex: int = 0) -> int:
        return self.node.object_dictionary.read(index, subindex)

    def optional(self, index: int, subindex: int = 0) -> int | None:
        try:
            self.node.object_dictionary.lookup(index, subindex)
        except KeyError:
            return None
        return self.get(index, subindex)

    def put(self, index: int, subindex: int, value: int) -> None:
        # durand sends a TPDO of type 255 at each write, so an equal value is none.
        if self.optional(index, subindex) not in (None, value):
            self.node.object_dictionary.write(index, subindex, value)

    def emergency(self, code: int, register: int) -> None:
        self.node.emcy.set(code, register)

    def listen(self, can_id: int, call: Callable[[], None]) -> None:
        self.network.add_subscription(can_id, lambda _can_id, _data: call())

    def alarm(self, name: str, delay_s: float, call: Callable[[], None]) -> None:
        self.disarm(name)
        self._alarms[name] = self._loop.call_later(delay_s, call)

    def disarm(self, name: str) -> None:
        handle = self._alarms.pop(name, None)
        if handle:
            handle.cancel()

    # For a test, from its own thread.

    def do(self, action: Callable[[], None]) -> None:
        """Let something happen in the device."""

        async def act() -> None:
            action()

        asyncio.run_coroutine_threadsafe(act(), self._loop).result(_BOUND_S)

    def restart(self) -> None:
        """Switch the device off and on: all objects have their defaults again."""

        def act() -> None:
            self._switch_off()
            self._switch_on()

        self.do(act)

    def silence_heartbeat(self) -> None:
        self.node.object_dictionary.write(0x1017, 0, 0)


def _entry(entry: Any) -> Variable | Record:
    if isinstance(entry, ODVariable):
        return _variable(entry)
    record = Record(entry.name)
    for subindex, variable in entry.items():
        if subindex:
            record[subindex] = _variable(variable)
    return record


def _variable(entry: ODVariable) -> Variable:
    access = "rw" if entry.access_type in ("rw", "rww", "rwr") else entry.access_type
    limits = {"minimum": entry.min, "maximum": entry.max}
    value = entry.default
    if isinstance(value, str):
        value, limits = value.encode(), {}
    return Variable(DatatypeEnum(entry.data_type), access, value, name=entry.name, **limits)


def _written(dictionary: canopen.ObjectDictionary) -> list[tuple[int, int]]:
    return [
        (index, subindex)
        for index, entry in dictionary.items()
        if index not in _OWN
        for subindex in ([0] if isinstance(entry, ODVariable) else entry)
    ]
