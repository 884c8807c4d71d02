# SPDX-License-Identifier: Apache-2.0
"""Rows about a foreign master on a CAN bus."""

from __future__ import annotations

import struct

from acts import both, switched
from row import (
    AT_ONCE,
    CLEAR,
    COMMAND,
    DYING,
    ENABLE,
    HOME,
    MISSED,
    SILENT,
    STOPPED,
    VIA_SUPERVISOR,
    Act,
    Report,
    Row,
)

_TORQUE = 300  # per mille of the rated torque; any torque would act, for up to a period
_NO_LIMIT = 10_000  # per mille
_LATER = SILENT + 8  # samples: the foreign frame comes each 5 to 10 ms


def _row(
    name: str, text: str, act: Act, who: str, said: str, within: int, node: str = "amplifier"
) -> Row:  # fmt: skip
    services = (CLEAR, *STOPPED) if node == "amplifier" else (HOME, *MISSED)
    return Row(
        f"foreign-{name}", "intruders", f"a foreign master {text}", act, Report(node, said, node),
        services, who, within, within + VIA_SUPERVISOR, watch=0.3,
    )  # fmt: skip


def _frames(node: str, can_id: int, data: bytes, period: float) -> Act:
    """Send a frame on a driver's bus each `period` [s]."""

    def act(robot) -> None:
        port = robot.intruders.port(node)
        robot.intruders.repeat(lambda: port.send(can_id, data), period)

    return act


def _walk_up(robot) -> float:
    """Command operation enabled with torque between our commands, 1000 times a second."""
    both(*[switched(service, False) for service in ENABLE])(robot)
    port = robot.intruders.port("amplifier")
    words = [struct.pack("<Hh", word, _TORQUE) for word in (0x06, 0x07, 0x0F)]

    def walk() -> None:
        for word in words:
            port.send(0x201, word)

    robot.pause(0.1)
    begin = robot.time
    robot.intruders.repeat(walk, 0.001)
    return begin


def _sdo(index: int, size: int, value: int) -> bytes:
    """Return the request that writes subindex 0 of an object. size: command byte (CiA 301)."""
    return struct.pack("<BHBi", size, index, 0, value)


_CLIENT = "another SDO client"
_STOPS = "amplifier: another SDO client; it stops the node"
ROWS = [
    _row("sdo-torque", "writes 6071 by SDO, 100 a second",
         _frames("amplifier", 0x601, _sdo(0x6071, 0x2B, _TORQUE), 0.01), _STOPS, _CLIENT,
         AT_ONCE + 11),
    _row("sdo-limit", "removes the drive's torque limit 6072 by SDO",
         _frames("amplifier", 0x601, _sdo(0x6072, 0x2B, _NO_LIMIT), 0.01), _STOPS, _CLIENT,
         AT_ONCE + 11),
    _row("sdo-encoder", "turns the encoder's direction by SDO",
         _frames("encoder", 0x602, _sdo(0x6000, 0x2B, 5), 0.01), "encoder: another SDO client",
         _CLIENT, _LATER, "encoder"),
    _row("controlword-wrong-endian", "sends controlwords with bytes swapped",
         _frames("amplifier", 0x201, struct.pack(">Hh", 0x000F, 0), 0.01),
         "amplifier: the drive left", "drive", AT_ONCE + 11),
    _row("walk-up", "enables the disabled drive, step by step", _walk_up,
         "amplifier: somebody else commands the drive; it stops the node",
         "somebody else commands the vertical drive", AT_ONCE),
    _row("heartbeat", "sends our heartbeat, 50 a second",
         _frames("amplifier", 0x770, b"\x05", 0.02), "amplifier: it sends its own",
         "somebody else sends the heartbeat", AT_ONCE + 21),
    _row("nmt-preoperational", "sends all devices of the drive's bus to PRE-OPERATIONAL",
         _frames("amplifier", 0x000, struct.pack("<BB", 0x80, 0), 0.05), "amplifier", "drive",
         51 + COMMAND + 4 + DYING),
    _row("sync", "sends SYNC on the encoder's bus", _frames("encoder", 0x080, b"", 0.005),
         "encoder", "somebody else sends SYNC", _LATER, "encoder"),
]  # fmt: skip
