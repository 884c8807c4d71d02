# SPDX-License-Identifier: Apache-2.0
"""Frames into the simulated devices: they survive, and give no torque unless enabled."""

from __future__ import annotations

import itertools
import logging
import random
import struct
from collections import Counter

import can

from screw_module_ros.plant.world import World, load_world
from screw_module_ros.rig import cia402
from screw_module_ros.rig.rig import Rig

_MS = 1_000_000
_NODES = (1, 2, 3, 4)
_IDS = (
    [0x000, 0x080, 0x770, 0x771]
    + [base + node for base in (0x200, 0x300, 0x400, 0x600) for node in _NODES]
    + [0x120 | opcode for opcode in range(16)]
)
_OBJECTS = (
    0x1005, 0x1014, 0x1016, 0x1017, 0x1400, 0x1401, 0x1600, 0x1601, 0x1800, 0x1801, 0x1A00, 0x1A01,
    0x6000, 0x6001, 0x6002, 0x6003, 0x6007, 0x6040, 0x605A, 0x605E, 0x6060, 0x6071, 0x6072, 0x6076,
)  # fmt: skip
_HEADS = (0x2F, 0x2B, 0x27, 0x23, 0x40, 0x60, 0x70, 0x00, 0x01, 0x21, 0xA0, 0xC2, 0x80)
_WORDS = (0x00, 0x06, 0x07, 0x0F, 0x02, 0x80, 0x10F)
_buses = itertools.count()


class RigFrames:
    """One case: a new rig, and a hundred frames."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._settings = load_world()
        logging.getLogger("canopen").setLevel(logging.CRITICAL)  # as in `sim_rig`

    def case(self, rng: random.Random) -> None:
        """Send frames to all devices, and let time go on between them."""
        channel = f"fuzz rig {next(_buses)}"
        near, far = (can.Bus(interface="virtual", channel=channel) for _ in range(2))
        try:
            world = World(self._settings, 1)
            rig = Rig(dict.fromkeys(("encoder", "drive", "force_sensor", "planar"), far), world)
            now_ns = 1000 * _MS
            rig.process(now_ns)
            for _ in range(100):
                near.send(_frame(rng))
                self.counts["frames"] += 1
                now_ns += rng.choice((0, 0, 1, 1, 2, 30)) * _MS
                rig.process(now_ns)
                while near.recv(0) is not None:
                    self.counts["answers"] += 1
                driving = rig.devices["drive"].machine.state == cia402.ENABLED
                self.counts["enabled"] += driving
                assert driving or not world.vertical_powered
        finally:
            near.shutdown()
            far.shutdown()

    def close(self) -> None:
        """Nothing is held."""


def _frame(rng: random.Random) -> can.Message:
    can_id, data = rng.choice((_sdo, _command, _anything))(rng)
    way = rng.random()
    return can.Message(
        arbitration_id=can_id, data=b"" if way < 0.02 else data, is_remote_frame=way < 0.02,
        is_extended_id=0.02 < way < 0.04, is_error_frame=0.04 < way < 0.06,
    )  # fmt: skip


def _sdo(rng: random.Random) -> tuple[int, bytes]:
    head = struct.pack("<BHB", rng.choice(_HEADS), rng.choice(_OBJECTS), rng.randrange(7))
    data = rng.choice((rng.randbytes(4), bytes(4), b"\x01\0\0\0", b"\xff\xff\xff\xff"))
    return 0x600 + rng.choice(_NODES), (head + data)[: rng.choice((8, 8, 8, rng.randrange(9)))]


def _command(rng: random.Random) -> tuple[int, bytes]:
    if rng.random() < 0.3:
        return 0x000, bytes([rng.choice((1, 2, 0x80, 0x81, 0x82)), rng.choice((0, *_NODES))])
    word = struct.pack("<Hh", rng.choice(_WORDS), rng.randrange(-32768, 32768))
    return rng.choice((0x201, 0x203, 0x204, 0x301)), word


def _anything(rng: random.Random) -> tuple[int, bytes]:
    can_id = rng.choice(_IDS) if rng.random() < 0.8 else rng.randrange(0x800)
    return can_id, rng.randbytes(rng.randrange(9))
