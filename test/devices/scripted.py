# SPDX-License-Identifier: Apache-2.0
"""A far end in raw frames, written from the standards and apart from the drivers' own codecs."""

from __future__ import annotations

import threading

import can
from can.interfaces.virtual import VirtualBus

from screw_module_ros.can_io.port import Port
from screw_module_ros.clock import ManualClock

MILLISECOND = 1_000_000
_SIZES = {0x2F: 1, 0x2B: 2, 0x27: 3, 0x23: 4}  # bytes, of an expedited download


def written(can_id: int, data: bytes) -> str:
    """Return a frame as text, as in the files of conversations."""
    return f"{can_id:03X} {data.hex(' ').upper()}".strip()


class SharedClock(ManualClock):
    """A manual clock for several threads: a wait advances it when all who use it wait.

    Else a drive's answer, in one thread, would be late whenever another commands zero meanwhile and
    the machine is busy.
    """

    _LOOK_S = 0.002  # wall clock; others may set the time without a wait
    _LOOKS = 500  # then a thread that waits for something else holds time no longer

    def __init__(self, now_ns: int = 0):
        super().__init__(now_ns)
        self._turn = threading.Condition()
        self._users: set[threading.Thread] = set()
        self._due: dict[threading.Thread, int] = {}

    def now_ns(self) -> int:
        self._users.add(threading.current_thread())
        return self.time_ns

    stamp_ns = now_ns

    def sleep_until(self, due_ns: int) -> None:
        own, looks = threading.current_thread(), 0
        with self._turn:
            self._users.add(own)
            self._due[own] = due_ns
            while self.time_ns < due_ns:
                if looks < self._LOOKS and self._somebody_works():
                    self._turn.wait(self._LOOK_S)
                    looks += 1
                else:
                    self._advance()
            del self._due[own]

    def _somebody_works(self) -> bool:
        return any(
            self._due.get(user, 0) <= self.time_ns for user in tuple(self._users) if user.is_alive()
        )

    def _advance(self) -> None:
        now_ns = self.time_ns
        self.time_ns = min((due for due in self._due.values() if due > now_ns), default=now_ns)
        self._turn.notify_all()

    def leave(self) -> None:
        with self._turn:
            self._users.discard(threading.current_thread())
            self._turn.notify_all()


class TiedBus(VirtualBus):
    """A virtual bus whose far end gets its turn inside each send."""

    def __init__(self, channel: str, wire: Wire):
        super().__init__(channel=channel)
        self._wire = wire

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._check()
        super().send(msg, timeout)
        self._wire.step()

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._check()
        return super()._recv_internal(timeout)

    def _check(self) -> None:
        if self._wire.broken:
            raise can.CanOperationError("Transmit buffer full")


class Wire:
    """One virtual bus: our port on one end, scripted devices on the other, a clock by hand."""

    def __init__(self, channel: str, sync_producer: bool = True):
        self.clock = SharedClock(1_000_000_000_000)
        self.frames: list[tuple[int, bytes]] = []
        self.broken = False  # our end fails
        self.held: list[can.Message] | None = None  # a list: frames from the far side are kept back
        self._devices: list[FarEnd] = []
        self._turn = threading.RLock()
        self._far = VirtualBus(channel=channel)
        self.bus = TiedBus(channel, self)
        self.port = Port(self.bus, sync_producer, clock=self.clock)

    def attach(self, device: FarEnd) -> FarEnd:
        self._devices.append(device)
        return device

    def step(self) -> None:
        with self._turn:
            while (message := self._far.recv(0.0)) is not None:
                frame = (message.arbitration_id, bytes(message.data))
                self.frames.append(frame)
                for device in self._devices:
                    device.handle(*frame)

    def emit(self, can_id: int, data: bytes | str) -> None:
        """Put one frame on the bus from the far side; text is hex."""
        payload = bytes.fromhex(data) if isinstance(data, str) else data
        self.emit_message(can.Message(arbitration_id=can_id, data=payload, is_extended_id=False))

    def emit_message(self, message: can.Message) -> None:
        if self.held is None:
            self._far.send(message)
        else:
            self.held.append(message)

    def release(self) -> None:
        """Send all that was kept back, and keep nothing back any more."""
        held, self.held = self.held or [], None
        for message in held:
            self._far.send(message)

    @property
    def now_ns(self) -> int:
        return self.clock.time_ns

    @now_ns.setter
    def now_ns(self, now_ns: int) -> None:
        self.clock.time_ns = now_ns

    def advance(self, milliseconds: float = 1.0) -> int:
        self.now_ns += round(milliseconds * MILLISECOND)
        return self.now_ns

    def sent(self, can_id: int) -> list[bytes]:
        """What we have sent under one identifier so far."""
        return [data for identifier, data in self.frames if identifier == can_id]

    def close(self) -> None:
        self.bus.shutdown()
        self._far.shutdown()


class FarEnd:
    """Something that sees each frame we send."""

    def __init__(self, wire: Wire):
        self.wire = wire

    def handle(self, can_id: int, data: bytes) -> None:
        raise NotImplementedError

    def break_bus(self) -> None:
        self.wire.broken = True

    def mend_bus(self) -> None:
        self.wire.broken = False


class ScriptedNode(FarEnd):
    """SDO server (expedited, CiA 301) and NMT slave over a table of raw objects."""

    def __init__(self, wire: Wire, node_id: int, objects: dict[tuple[int, int], bytes]):
        super().__init__(wire)
        self.node_id = node_id
        self.objects = dict(objects)
        self.refused: dict[tuple[int, int], int] = {}  # on writing: abort code
        self.deaf: set[tuple[int, int]] = set()  # accepts a write, keeps the old value
        self.at_start = self.at_write = ""  # what it does at its next start, and after each write
        self.writes: list[tuple[int, int, int]] = []
        self.operational = False
        self.mute, self.answering = False, True
        self.cures = ""  # reset: NMT reset communication ends that it is mute
        self.answers = 1  # to each question
        self.nmt: list[int] = []

    def handle(self, can_id: int, data: bytes) -> None:
        if can_id == 0x000 and data[1] in (0, self.node_id):
            self.nmt.append(data[0])
            self.operational = data[0] == 0x01
            if data[0] == 0x82 and self.cures == "reset":
                self.mute, self.answering = False, True
            if data[0] == 0x82 and not self.mute:
                self.boot_up()
            if self.operational and self.at_start:
                happens, self.at_start = self.at_start, ""
                getattr(self, happens)()
                self.wire.port.pump()  # by the loop's thread
        elif can_id == 0x600 + self.node_id and not self.mute:
            self._sdo(data)

    def boot_up(self) -> None:
        self.operational = False
        self.wire.emit(0x700 + self.node_id, "00")

    def complain(self) -> None:
        """Send the emergency of an unexpected length of SYNC (CiA 301 table 26)."""
        self.wire.emit(0x080 + self.node_id, "40 82 11 00 00 00 00 00")

    def be_asked(self) -> None:
        """Hear a request of another client, for an object that it may not even have."""
        self.wire.emit(0x600 + self.node_id, "40 61 60 00 00 00 00 00")

    def _reply(self, data: bytes) -> None:
        for _ in range(self.answers):
            self.wire.emit(0x580 + self.node_id, data)

    def _sdo(self, data: bytes) -> None:
        command, key = data[0], (data[1] | data[2] << 8, data[3])
        address = data[1:4]
        if command == 0x80:
            return
        if command == 0x40:
            self._upload(key, address)
        elif command in _SIZES:
            self._download(command, key, address, data[4:])
        else:  # no segments and no blocks here: command specifier unknown
            self._reply(b"\x80" + address + b"\x01\x00\x04\x05")

    def _upload(self, key: tuple[int, int], address: bytes) -> None:
        if key not in self.objects:
            self._reply(b"\x80" + address + b"\x00\x00\x02\x06")
            return
        value = self.objects[key]
        command = {1: 0x4F, 2: 0x4B, 3: 0x47, 4: 0x43}[len(value)]
        self._reply(bytes([command]) + address + value.ljust(4, b"\0"))

    def _download(self, command: int, key: tuple[int, int], address: bytes, data: bytes) -> None:
        size = _SIZES[command]
        if key in self.refused:
            self._reply(b"\x80" + address + self.refused[key].to_bytes(4, "little"))
            return
        if key not in self.objects:
            self._reply(b"\x80" + address + b"\x00\x00\x02\x06")
            return
        if len(self.objects[key]) != size:
            self._reply(b"\x80" + address + b"\x10\x00\x07\x06")
            return
        self.writes.append((*key, int.from_bytes(data[:size], "little")))
        if key not in self.deaf:
            self.objects[key] = data[:size]
            self.written(key, data[:size])
        if self.at_write:
            getattr(self, self.at_write)()
        self._reply(b"\x60" + address + b"\0\0\0\0")

    def written(self, key: tuple[int, int], data: bytes) -> None:
        """For a device whose other objects follow a write."""


def unsigned(value: int, size: int) -> bytes:
    return value.to_bytes(size, "little")


def pdo_objects(base: int, number: int, cob_id: int, entries: list[int], kind: int = 254) -> dict:
    """Raw parameters and mapping of one PDO, as a device might have it from the factory."""
    parameters, mapping = base + number - 1, base + 0x200 + number - 1
    objects = {
        (parameters, 0): b"\x05",
        (parameters, 1): unsigned(cob_id, 4),
        (parameters, 2): bytes([kind]),
        (parameters, 3): b"\0\0",
        (parameters, 5): b"\0\0",
        (mapping, 0): bytes([len(entries)]),
    }
    for subindex in range(1, 5):
        value = entries[subindex - 1] if subindex <= len(entries) else 0
        objects[mapping, subindex] = unsigned(value, 4)
    return objects
