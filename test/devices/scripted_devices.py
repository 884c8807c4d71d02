# SPDX-License-Identifier: Apache-2.0
"""Scripted encoder, drive and force sensor; frames written by hand from CiA 406, 402 and ATI's."""

from __future__ import annotations

from collections import deque

from scripted import MILLISECOND, FarEnd, ScriptedNode, Wire, pdo_objects, unsigned, written


class ScriptedEncoder(ScriptedNode):
    """CiA 406 encoder, node 2: position on SYNC, possibly late, lost or malformed."""

    def __init__(self, wire: Wire):
        super().__init__(
            wire,
            2,
            {
                (0x1000, 0): bytes.fromhex("96 01 02 00"),
                (0x1018, 1): unsigned(0x1234, 4),
                (0x1018, 2): unsigned(0x77, 4),
                (0x6000, 0): unsigned(0, 2),
                (0x6001, 0): unsigned(4096, 4),
                (0x6002, 0): unsigned(0x01000000, 4),
                (0x6500, 0): unsigned(0, 2),
                (0x6501, 0): unsigned(8192, 4),
                (0x6502, 0): unsigned(4096, 2),
                (0x6503, 0): unsigned(0, 2),
                (0x6505, 0): unsigned(0, 2),
                **pdo_objects(0x1800, 1, 0x40000182, [0x60040020]),
                **pdo_objects(0x1800, 2, 0x40000282, [0x60040020], kind=1),
            },
        )
        self.position = self.speed = 0  # counts, counts per millisecond
        self._begun_ns = wire.now_ns
        self.answering = True

    def handle(self, can_id: int, data: bytes) -> None:
        super().handle(can_id, data)
        if can_id == 0x080 and self.operational and self.answering:
            self.answer()

    def answer(self) -> None:
        moved = self.speed * (self.wire.now_ns - self._begun_ns) // MILLISECOND
        self.wire.emit(0x182, unsigned(self.position + moved, 4))


#: Statuswords of the eight states with the voltage and remote bits set as drives do.
STATUSWORDS = {
    "not ready to switch on": 0x0200,
    "switch on disabled": 0x0250,
    "ready to switch on": 0x0231,
    "switched on": 0x0233,
    "operation enabled": 0x0237,
    "quick stop active": 0x0217,
    "fault reaction active": 0x021F,
    "fault": 0x0218,
}


class ScriptedDrive(ScriptedNode):
    """CiA 402 drive, node 1: the state machine of the standard, commands in, statusword on SYNC."""

    def __init__(self, wire: Wire, node_id: int = 1):
        super().__init__(
            wire,
            node_id,
            {
                (0x1000, 0): bytes.fromhex("92 01 42 00"),
                (0x1016, 1): unsigned(0, 4),
                (0x1017, 0): unsigned(0, 2),
                (0x1018, 1): unsigned(0x99, 4),
                (0x1018, 2): unsigned(0x1, 4),
                (0x6007, 0): unsigned(0, 2),
                (0x6040, 0): unsigned(0, 2),
                (0x605A, 0): unsigned(2, 2),
                (0x605C, 0): unsigned(1, 2),
                (0x605E, 0): unsigned(2, 2),
                (0x6060, 0): unsigned(0, 1),
                (0x6061, 0): unsigned(0, 1),
                (0x6071, 0): unsigned(0, 2),
                (0x6072, 0): unsigned(4000, 2),
                (0x6076, 0): unsigned(420, 4),
                (0x6502, 0): unsigned(0x0208, 4),
                **pdo_objects(0x1400, 1, 0x200 + node_id, [0x60400010], kind=255),
                **pdo_objects(0x1400, 2, 0x300 + node_id, [0x60400010], kind=255),
                **pdo_objects(0x1800, 1, 0x40000180 + node_id, [0x60410010]),
                **pdo_objects(0x1800, 2, 0xC0000280 + node_id, [0x60410010]),
                **pdo_objects(0x1800, 3, 0x40000380 + node_id, [0x60410010]),
            },
        )
        self.state = "switch on disabled"
        self.torque = self.given = 0
        self.position = 0
        self.cause_stands = False
        self.obeys = True
        self.delay = 0  # controlwords until one is obeyed
        self.beat = "05"  # its heartbeat, empty for none; each 50 ms, and at once when it changes
        self._beaten, self._beat_ns = "", 0
        self._words: deque[int] = deque()
        self._last_word = 0

    def written(self, key: tuple[int, int], data: bytes) -> None:
        if key == (0x6060, 0):
            self.objects[0x6061, 0] = data

    def handle(self, can_id: int, data: bytes) -> None:
        super().handle(can_id, data)
        if not self.operational:
            return
        if can_id == 0x200 + self.node_id:
            assert len(data) == 4
            self.torque = int.from_bytes(data[2:4], "little", signed=True)
            if self.obeys:
                self._words.append(int.from_bytes(data[0:2], "little"))
            if len(self._words) > self.delay:
                self.command(self._words.popleft())
        elif can_id == 0x080 and self.answering:
            self.report()

    def show_life(self) -> None:
        if self.beat and (
            self.beat != self._beaten or self.wire.now_ns - self._beat_ns >= 50 * MILLISECOND
        ):
            self.wire.emit(0x700 + self.node_id, self.beat)
            self._beat_ns = self.wire.now_ns
        self._beaten = self.beat

    def report(self) -> None:
        word = STATUSWORDS[self.state].to_bytes(2, "little")
        position = self.position.to_bytes(4, "little", signed=True)
        given = self.given.to_bytes(2, "little", signed=True)
        self.wire.emit(0x180 + self.node_id, word + position + given)

    def report_slowly(self, error_code: int = 0, mode: int = 10) -> None:
        payload = error_code.to_bytes(2, "little") + bytes([mode]) + b"\x00\x00\x00\x00"
        self.wire.emit(0x280 + self.node_id, payload)

    def fail(self, code_frame: str = "10 23 03 00 00 00 00 00") -> None:
        """Go into fault, with an emergency."""
        self.state = "fault"
        self.wire.emit(0x080 + self.node_id, code_frame)

    def command(self, word: int) -> None:
        """One controlword, after CiA 402-2 table 4 and figure 8."""
        rising = word & ~self._last_word
        self._last_word = word
        low = word & 0x8F
        if self.state == "fault":
            if rising & 0x80 and not self.cause_stands:
                self.state = "switch on disabled"
            return
        if not word & 0x02:
            wanted = "disable voltage"
        elif not word & 0x04:
            wanted = "quick stop"
        else:
            wanted = {0x06: "shutdown", 0x07: "switch on", 0x0F: "enable"}.get(low & 0x0F)
        moves = {
            ("switch on disabled", "shutdown"): "ready to switch on",
            ("ready to switch on", "switch on"): "switched on",
            ("ready to switch on", "disable voltage"): "switch on disabled",
            ("ready to switch on", "quick stop"): "switch on disabled",
            ("switched on", "enable"): "operation enabled",
            ("switched on", "shutdown"): "ready to switch on",
            ("switched on", "disable voltage"): "switch on disabled",
            ("switched on", "quick stop"): "switch on disabled",
            ("operation enabled", "switch on"): "switched on",
            ("operation enabled", "shutdown"): "ready to switch on",
            ("operation enabled", "disable voltage"): "switch on disabled",
            ("operation enabled", "quick stop"): "quick stop active",
            ("quick stop active", "disable voltage"): "switch on disabled",
        }
        self.state = moves.get((self.state, wanted), self.state)


class ScriptedSensor(FarEnd):
    """ATI NETCANOEM board at base 0x12, gauges scaled so that 1000 counts of gauge 0 are 1 N."""

    #: Row 0 of the matrix as float32 big-endian: 2.0 -0.5 0 0 0 0; the others 1.0 on the diagonal.
    ROWS = (
        ("{}", "00 00 00 00 00 00 00 00", "00 00 00 00 00 00 00 00"),
        ("00 00 00 00 3F 80 00 00", "00 00 00 00 00 00 00 00", "00 00 00 00 00 00 00 00"),
        ("00 00 00 00 00 00 00 00", "3F 80 00 00 00 00 00 00", "00 00 00 00 00 00 00 00"),
        ("00 00 00 00 00 00 00 00", "00 00 00 00 3F 80 00 00", "00 00 00 00 00 00 00 00"),
        ("00 00 00 00 00 00 00 00", "00 00 00 00 00 00 00 00", "3F 80 00 00 00 00 00 00"),
        ("00 00 00 00 00 00 00 00", "00 00 00 00 00 00 00 00", "00 00 00 00 3F 80 00 00"),
    )

    def __init__(self, wire: Wire):
        super().__init__(wire)
        self.first = "00 00 00 00 00 00 00 00"
        self.second = "00 00 00 00 00 00"
        self.units = "02 03"
        self.counts = "00 00 03 E8 00 00 27 10"  # 1000 per N, 10000 per Nm
        self.serial = b"FT012345".hex()
        self.answering = True
        self.mute = False
        self.forgets: list[str] = []  # requests that get no answer, the first one next
        self.gains = "40 00 00 00 BF 00 00 00"  # of gauges 0 and 1 in the first row

    def handle(self, can_id: int, data: bytes) -> None:
        if can_id >> 4 != 0x12 or self.mute:
            return
        opcode, emit, one_byte = can_id & 0xF, self.wire.emit, len(data) == 1
        told = {0x5: self.serial, 0x7: self.counts, 0x8: self.units, 0xC: "", 0xF: "02 05 01 2C"}
        if [written(can_id, data)] == self.forgets[:1]:
            self.forgets.pop(0)
        elif (opcode, data) == (0x0, b"") and self.answering:
            self.answer()
        elif opcode in told and not data:
            emit(can_id, told[opcode])
        elif opcode == 0x2 and one_byte:
            for part in range(3):
                emit(0x122 + part, self.ROWS[data[0]][part].format(self.gains))
        elif opcode == 0x6 and one_byte:
            emit(0x126, data)
        elif opcode == 0x9 and one_byte:
            emit(0x129, bytes([data[0], 0x10]))

    def answer(self) -> None:
        self.wire.emit(0x120, self.first)
        self.wire.emit(0x121, self.second)


class ScriptedBox(FarEnd):
    """Net F/T box: answers 02 at 0x120 with 0x125 and 0x126; its number counts requests by 7."""

    def __init__(self, wire: Wire):
        super().__init__(wire)
        self.xy = "E8 03 0C FE 38 FF 32 00"  # Fx 1000, Tx -500, Fy -200, Ty 50
        self.z = "A0 0F 00 00"  # Fz 4000, Tz 0
        self.status = "00 00"
        self.number, self.step = 0xFFFA, 7
        self.answering, self.no_second = True, False

    def handle(self, can_id: int, data: bytes) -> None:
        if (can_id, bytes(data)) == (0x120, b"\x02") and self.answering:
            self.answer()

    def answer(self) -> None:
        self.number = self.number + self.step & 0xFFFF
        self.wire.emit(0x125, self.xy)
        if not self.no_second:
            number = self.number.to_bytes(2, "little").hex(" ")
            self.wire.emit(0x126, f"{self.z} {self.status} {number}")
