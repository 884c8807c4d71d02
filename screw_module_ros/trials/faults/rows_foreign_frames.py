# SPDX-License-Identifier: Apache-2.0
"""Rows about a foreign master on a CAN bus."""

from __future__ import annotations

import struct
from collections.abc import Iterator

from .acts import switched
from .intruder_row import intruder_row as _row
from .limits import AT_ONCE, COMMAND, DYING, STALE
from .row import MISSED, Act, Alarm, Row

_FOREIGN_TORQUE = 300  # per mille of the rated torque; any torque would act, for up to a period
_NO_LIMIT = 10_000  # per mille


def rows() -> Iterator[Row]:
    """Return the rows of SDO, controlwords, NMT and SYNC from another node of the bus."""
    torque = struct.pack("<BHBi", 0x2B, 0x6071, 0, _FOREIGN_TORQUE)
    limit = struct.pack("<BHBi", 0x2B, 0x6072, 0, _NO_LIMIT)
    for name, text, data in (
        ("torque", "writes 6071 by SDO, 100 a second", torque),
        ("limit", "removes the drive's torque limit 6072 by SDO", limit),
    ):
        yield _row(f"foreign-sdo-{name}", f"a foreign master {text}",
                   _frames_on("amplifier", 0x601, data, 0.01),
                   "amplifier: another SDO client; it stops the node",
                   Alarm("amplifier", "another SDO client", "amplifier"),
                   "stop it; amplifier/clear_fault, which configures the drive anew, reset, "
                   "enable", within=AT_ONCE + 11)  # fmt: skip
    turned = struct.pack("<BHBi", 0x2B, 0x6000, 0, 5)
    yield _row("foreign-sdo-encoder", "a foreign master turns the encoder's direction by SDO",
               _frames_on("encoder", 0x602, turned, 0.01), "encoder: another SDO client",
               Alarm("encoder", "another SDO client", "encoder"),
               f"stop it; encoder/home, {MISSED}, reset, enable",
               within=STALE + 10 + DYING, apart=True)  # fmt: skip
    wrong = struct.pack(">Hh", 0x000F, 0)
    yield _row("foreign-controlword-wrong-endian", "a foreign master sends controlwords with bytes "
               "swapped", _frames_on("amplifier", 0x201, wrong, 0.01), "amplifier: the drive left",
               Alarm("amplifier", "drive", "amplifier"),
               "stop it; amplifier/clear_fault, reset, enable", within=AT_ONCE + 11)  # fmt: skip
    yield _row("foreign-walk-up", "a foreign master enables the disabled drive, step by step",
               _walk_up,
               "amplifier: somebody else commands the drive; it stops the node",
               Alarm("amplifier", "somebody else commands the vertical drive", "amplifier"),
               "stop it; amplifier/clear_fault, reset, enable")  # fmt: skip
    nmt = struct.pack("<BB", 0x80, 0)
    yield _row("foreign-nmt-preoperational", "a foreign master sends all devices of the drive's "
               "bus to PRE-OPERATIONAL", _frames_on("amplifier", 0x000, nmt, 0.05), "amplifier",
               Alarm("amplifier", "drive", "amplifier"),
               "stop it; amplifier/clear_fault, reset, enable",
               within=51 + COMMAND + 4 + DYING)  # fmt: skip
    yield _row("foreign-sync", "a foreign master sends SYNC on the encoder's bus",
               _frames_on("encoder", 0x080, b"", 0.005), "encoder",
               Alarm("encoder", "somebody else sends SYNC", "encoder"),
               f"stop it; encoder/home, {MISSED}, reset, enable",
               within=STALE + 10 + DYING, apart=True)  # fmt: skip


def _frames_on(node: str, can_id: int, data: bytes, period: float) -> Act:
    def act(testbed) -> None:
        port = testbed.intruders.port(node)
        testbed.intruders.repeat(lambda: port.send(can_id, data), period)

    return act


def _walk_up(testbed) -> float:
    """Command operation enabled with torque between our commands, 1000 times a second."""
    for node in ("amplifier", "manus"):
        switched(f"{node}/enable", False)(testbed)
    port = testbed.intruders.port("amplifier")
    words = [struct.pack("<Hh", word, _FOREIGN_TORQUE) for word in (0x06, 0x07, 0x0F)]

    def walk() -> None:
        for word in words:
            port.send(0x201, word)

    testbed.robot.pause(0.1)
    begin = testbed.listener.time
    testbed.intruders.repeat(walk, 0.001)
    return begin
