# SPDX-License-Identifier: Apache-2.0
"""Every frame of the simulated devices: their objects, odd requests, and each fault in operation.

The golden frames elsewhere say what is right; here is kept what is sent, as digests. A change on
purpose is renewed with `make test ARGS="test/rig/test_kept_frames.py --write"`; the commit says
what changed.
"""

from __future__ import annotations

import hashlib
import random

import pytest

from screw_module_ros.profiles import DRIVE as A_DRIVE
from screw_module_ros.profiles import ENCODER as AN_ENCODER
from screw_module_ros.profiles import NAMES, load
from screw_module_ros.rig.build import RigSettings
from screw_module_ros.rig.faults import CABLE, CANOPEN, DRIVE, ENCODER, FORCE_SENSOR

INDICES = (
    *range(0x1000, 0x1020), *range(0x1400, 0x1405), *range(0x1600, 0x1605),
    *range(0x1800, 0x1805), *range(0x1A00, 0x1A05), *range(0x6000, 0x60FF), *range(0x6500, 0x6512),
)  # fmt: skip
NODES = {"drive": 1, "encoder": 2}
TABLES = {"drive": DRIVE, "encoder": ENCODER, "force_sensor": FORCE_SENSOR}
# A drive and an encoder have the faults of CANopen in common, all three those of the cable.
FAULTS = [
    (device, fault)
    for device, table in TABLES.items()
    for fault in table
    if device == "encoder" or fault not in CANOPEN or (device != "drive" and fault in CABLE)
]


def digest(lines: list) -> str:
    return hashlib.sha256(repr(lines).encode()).hexdigest()[:16]


def made(make_bench, device: str, **makes: str):
    """Return a bench whose device is at work, with a load and a motion to report.

    makes: profiles, by the names of `RigSettings`.
    """
    bench = make_bench(device, settings=RigSettings(**makes))
    bench.world.counts_per_second, bench.world.load = 1234.5, (1.0, -2.0, 30.0, 0.1, 0.2, -0.3)
    if device in NODES:
        bench.start(NODES[device])
    if device == "drive":
        bench.write(1, "6060:00", "0A")
        bench.write(1, "1016:01", "64007000")
        bench.write(1, "6007:00", "0100")
        bench.enable("64 00")
    return bench


def at_work(bench, device: str, ticks: int, chance: random.Random) -> list:
    """Return the frames of some ticks of a master, and what reached the plant."""
    lines = []
    for _ in range(ticks):
        bench.send(0x080)
        if device == "force_sensor":
            bench.send(0x120)
            bench.send(0x120 | chance.randrange(16), f"0{chance.randrange(8)}")
        if device == "drive":
            bench.world.vertical_torque = 0.05 * chance.randrange(-3, 4)
            bench.send(0x770, "05")
            word = chance.choice(("06 00", "07 00", *["0F 00"] * 9, "80 00"))
            bench.send(0x201, f"{word} {chance.randrange(256):02X} 0{chance.randrange(2)}")
        lines.append(bench.run(1))
        lines.append((bench.world.vertical_command, bench.world.vertical_powered))
        lines.append((bench.world.vertical_braked, len(bench.world.steps)))
    return lines


@pytest.mark.parametrize("device", NODES)
def test_every_object_and_what_a_write_does_to_it(make_bench, device, kept):
    bench, chance, node, found = make_bench(device), random.Random(device), NODES[device], {}
    for index in INDICES:
        lines = []
        for subindex in range(9):
            key = f"{index:04X}:{subindex:02X}"
            lines.append(before := bench.read(node, key))
            if subindex == 0 and before == "06020000":
                break
            for size in (1, 2, 4):
                value = bytes(chance.choice((0, 1, 5, 0x60, 255)) for _ in range(size)).hex()
                lines += [bench.write(node, key, value), bench.read(node, key)]
        if len(lines) > 1:
            found[f"{index:04X}"] = digest(lines)
    kept(found)


@pytest.mark.parametrize(("device", "fault"), FAULTS)
def test_every_frame_while_a_fault_lasts_and_after_it(make_bench, device, fault, kept):
    bench, chance = made(make_bench, device), random.Random(f"{device} {fault}")
    lines = at_work(bench, device, 20, chance)
    bench.rig.inject(device, fault, 0.0, 0.0, bench.now_ns)
    lines += at_work(bench, device, 40, chance)
    bench.rig.inject(device, "clear", 0.0, 0.0, bench.now_ns)
    lines += at_work(bench, device, 150, chance)
    kept(digest(lines))


@pytest.mark.parametrize("device", ["drive", "encoder", "force_sensor"])
def test_what_any_frame_is_answered_with(make_bench, device, kept):
    bench, chance, lines = made(make_bench, device), random.Random(device), []
    ids = (0x000, 0x080, 0x081, 0x082, 0x181, 0x201, 0x301, 0x601, 0x602, 0x701, 0x770)
    for _ in range(1500):
        can_id = chance.choice((*ids, 0x120 | chance.randrange(16)))
        data = bytes(chance.choice((0, 1, 2, 5, 0x22, 0x40, 0x60, 0x80, 0x81, 255))
                     for _ in range(chance.choice((0, 1, 2, 4, 8, 8, 8))))  # fmt: skip
        bench.send(can_id, data.hex())
        lines.append(bench.run(chance.choice((0, 0, 1))))
    kept(digest(lines))


@pytest.mark.parametrize("make", NAMES)
def test_every_make_at_work_and_what_its_objects_say(make_bench, make, kept):
    device, setting = {
        A_DRIVE: ("drive", "drive_profile"), AN_ENCODER: ("encoder", "encoder_profile"),
    }.get(load(make).kind, ("force_sensor", "sensor_profile"))  # fmt: skip
    bench, chance = made(make_bench, device, **{setting: make}), random.Random(make)
    frames = at_work(bench, device, 60, chance)
    if make == "ati_net":  # it has another request
        frames = [bench.ask(0x120, "02") + bench.run(1) for _ in range(60)]
    assert any(lines for lines in frames if isinstance(lines, list))
    found = {"at work": digest(frames)}
    if device in NODES:
        found["objects"] = digest([
            bench.read(NODES[device], f"{index:04X}:{subindex:02X}")
            for index in INDICES
            for subindex in range(2)
        ])  # fmt: skip
    kept(found)
