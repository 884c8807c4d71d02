# SPDX-License-Identifier: Apache-2.0
"""A device on `canopen.LocalNode`, on a bus of python-can.

`LocalNode` has the dictionary of an EDS file, the SDO server, the heartbeat and an EMCY producer.
It ignores SYNC and RPDOs, sends no boot-up after an NMT reset and maps whatever it is told: that
much is added here, by CiA 301.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import canopen
from application import INITIALISING, OPERATIONAL, PRE_OPERATIONAL, STOPPED, Application
from canopen.objectdictionary import ODVariable
from canopen.sdo import SdoAbortedError

_RESET_NODE, _RESET_COMMUNICATION, _ENTER_PRE_OPERATIONAL = 0x81, 0x82, 0x80
_STATES = {
    "INITIALISING": INITIALISING, "PRE-OPERATIONAL": PRE_OPERATIONAL, "STOPPED": STOPPED,
    "OPERATIONAL": OPERATIONAL,
}  # fmt: skip
_MAPPINGS = (*range(0x1600, 0x1800), *range(0x1A00, 0x1C00))
_LAST_SYNCHRONOUS = 240
_LOOKS_EVERY_S = 0.05  # whether it is to end
_NOT_MAPPABLE, _WRONG_PDO_LENGTH = 0x06040041, 0x8210


class Alarms(threading.Thread):
    """Calls after delays, by name; holds `lock` in each call."""

    def __init__(self, lock: threading.RLock):
        super().__init__(daemon=True)
        self._changed = threading.Condition(lock)
        self._due: dict[str, tuple[float, Callable[[], None]]] = {}
        self._ended = False

    def set(self, name: str, delay_s: float, call: Callable[[], None]) -> None:
        with self._changed:
            self._due[name] = time.monotonic() + delay_s, call
            self._changed.notify()

    def drop(self, name: str) -> None:
        with self._changed:
            self._due.pop(name, None)

    def run(self) -> None:
        with self._changed:
            while not self._ended:
                now = time.monotonic()
                for name in [each for each, (due, _) in self._due.items() if due <= now]:
                    _, call = self._due.pop(name, (0.0, None))  # one call may drop another
                    if call:
                        call()
                first = min((due for due, _ in self._due.values()), default=None)
                self._changed.wait(None if first is None else max(0.0, first - time.monotonic()))

    def end(self) -> None:
        with self._changed:
            self._ended = True
            self._changed.notify()
        self.join()


class LocalDevice:
    """One device; its application is called with `lock` held.

    dictionary: its objects. application: makes what the device does, with this as its stack.
    unmappable: objects that no PDO takes.
    """

    name = "canopen.LocalNode"

    def __init__(
        self,
        channel: str,
        node_id: int,
        dictionary: canopen.ObjectDictionary,
        application: Callable[[LocalDevice], Application],
        unmappable: frozenset[int] = frozenset(),
    ):
        self.lock = threading.RLock()
        self._unmappable = unmappable
        self._alarms = Alarms(self.lock)
        self._network = canopen.Network()
        self._network.NOTIFIER_CYCLE = _LOOKS_EVERY_S
        self.node = canopen.LocalNode(node_id, dictionary)
        self._network.add_node(self.node)
        self._state = self.node.nmt.state
        self._synced: dict[int, int] = {}
        self._held: list[canopen.pdo.base.PdoMap] = []
        for number in self.node.rpdo:
            self.node.rpdo[number].add_callback(self._on_rpdo)
        self.node.add_write_callback(self._on_write)
        self._network.subscribe(0x000, self._on_nmt)
        self._network.subscribe(0x080, self._on_sync)
        self.application = application(self)
        self._network.connect(interface="virtual", channel=channel, ignore_config=True)
        self._alarms.start()
        with self.lock:
            self._boot()

    def close(self) -> None:
        self._alarms.end()
        self.node.nmt.stop_heartbeat()
        self._network.disconnect()

    # For the application.

    def get(self, index: int, subindex: int = 0) -> int:
        entry = self.node.object_dictionary[index]
        variable = entry if isinstance(entry, ODVariable) else entry[subindex]
        return variable.decode_raw(self.node.get_data(index, subindex))

    def optional(self, index: int, subindex: int = 0) -> int | None:
        try:
            return self.get(index, subindex)
        except (KeyError, SdoAbortedError):
            return None

    def put(self, index: int, subindex: int, value: int) -> None:
        if index in self.node.object_dictionary:
            entry = self.node.object_dictionary[index]
            variable = entry if isinstance(entry, ODVariable) else entry[subindex]
            stored = self.node.data_store.setdefault(index, {})
            stored[subindex] = variable.encode_raw(value)

    def emergency(self, code: int, register: int) -> None:
        self.put(0x1001, 0, register)
        self.node.emcy.send(code, register)

    def listen(self, can_id: int, call: Callable[[], None]) -> None:
        def on_frame(_can_id: int, _data: bytearray, _time: float) -> None:
            with self.lock:
                call()

        self._network.subscribe(can_id, on_frame)

    def alarm(self, name: str, delay_s: float, call: Callable[[], None]) -> None:
        self._alarms.set(name, delay_s, call)

    def disarm(self, name: str) -> None:
        self._alarms.drop(name)

    # For a test, from its own thread.

    def do(self, action: Callable[[], None]) -> None:
        """Let something happen in the device."""
        with self.lock:
            action()

    def restart(self) -> None:
        """Switch the device off and on: all objects have their defaults again."""
        with self.lock:
            self._reset()

    def silence_heartbeat(self) -> None:
        self.node.nmt.stop_heartbeat()

    # NMT.

    def _reset(self) -> None:
        self.node.nmt.stop_heartbeat()
        self.node.data_store.clear()
        for pdo in (*self.node.tpdo.values(), *self.node.rpdo.values()):
            pdo.enabled = False
        self._boot()

    def _boot(self) -> None:
        self.node.nmt.send_command(_RESET_NODE)  # the library's word for: send the boot-up
        self.node.nmt.send_command(_ENTER_PRE_OPERATIONAL)
        self.application.restart()
        self._entered()

    def _on_nmt(self, _can_id: int, data: bytearray, _time: float) -> None:
        with self.lock:
            command, node_id = data
            if command in (_RESET_NODE, _RESET_COMMUNICATION) and node_id in (0, self.node.id):
                self._reset()
            self._entered()

    def _entered(self) -> None:
        before, self._state = self._state, self.node.nmt.state
        if self._state != before:
            if self._state == "OPERATIONAL":
                self._begin()
            self.application.entered(_STATES[self._state])

    # Process data.

    def _begin(self) -> None:
        self.node.rpdo.read()
        self.node.tpdo.read()
        self._synced.clear()
        self._held.clear()
        for number, pdo in self.node.tpdo.items():
            if pdo.enabled and pdo.trans_type > _LAST_SYNCHRONOUS:
                self._send(pdo)
                if pdo.event_timer:
                    self._repeat(number, pdo)

    def _repeat(self, number: int, pdo: canopen.pdo.base.PdoMap) -> None:
        def again() -> None:
            if self._state == "OPERATIONAL":
                self._send(pdo)
                self._repeat(number, pdo)

        self._alarms.set(f"TPDO {number}", pdo.event_timer * 1e-3, again)

    def _send(self, pdo: canopen.pdo.base.PdoMap) -> None:
        for variable in pdo.map:
            variable.set_data(self.node.get_data(variable.index, variable.subindex))
        pdo.transmit()

    def _on_sync(self, _can_id: int, _data: bytearray, _time: float) -> None:
        with self.lock:
            if self._state != "OPERATIONAL":
                return
            for pdo in self._held:
                self._take(pdo)
            self._held.clear()
            self.application.sampled()
            for number, pdo in self.node.tpdo.items():
                if pdo.enabled and 1 <= pdo.trans_type <= _LAST_SYNCHRONOUS:
                    count = self._synced[number] = self._synced.get(number, 0) + 1
                    if count % pdo.trans_type == 0:
                        self._send(pdo)

    def _on_rpdo(self, pdo: canopen.pdo.base.PdoMap) -> None:
        with self.lock:
            if self._state != "OPERATIONAL" or not pdo.enabled:
                return
            if len(pdo.data) < pdo.length // 8:
                self.emergency(_WRONG_PDO_LENGTH, 0x11)
            elif pdo.trans_type <= _LAST_SYNCHRONOUS:
                self._held.append(pdo)
            else:
                self._take(pdo)

    def _take(self, pdo: canopen.pdo.base.PdoMap) -> None:
        for variable in pdo.map:
            self.node.set_data(variable.index, variable.subindex, bytes(variable.get_data()))
        self.application.commanded()

    def _on_write(self, index: int, subindex: int, od: ODVariable, data: bytes) -> None:
        value = od.decode_raw(bytes(data))
        if index in _MAPPINGS and subindex and value:
            self._check_mappable(value >> 16, value >> 8 & 0xFF)
        with self.lock:
            self.node.data_store.setdefault(index, {})[subindex] = bytes(data)
            self.application.written(index, subindex, value)

    def _check_mappable(self, index: int, subindex: int) -> None:
        try:
            self.node.get_data(index, subindex)
        except SdoAbortedError as error:
            raise SdoAbortedError(_NOT_MAPPABLE) from error
        if index in self._unmappable:
            raise SdoAbortedError(_NOT_MAPPABLE)
