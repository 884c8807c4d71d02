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


def said(bench, device: str) -> list:
    """Return what all objects of a device say, if it answers."""
    requests = [f"40{index & 0xFF:02X}{index >> 8:02X}0000000000" for index in INDICES]
    node = NODES.get(device)
    return [bench.ask(0x600 + node, request) for request in requests] if node else []


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
    lines += at_work(bench, device, 40, chance) + said(bench, device)
    bench.rig.inject(device, "clear", 0.0, 0.0, bench.now_ns)
    lines += at_work(bench, device, 150, chance) + said(bench, device)
    kept(digest(lines))


@pytest.mark.parametrize("seed", range(4))
def test_every_way_to_move_and_to_stop(make_bench, seed, kept):
    """A drive with any reaction, mode and limit, commanded, disturbed and left alone."""
    bench, chance, lines = made(make_bench, "drive"), random.Random(seed), []
    bench.write(1, "6087:00", "10270000")
    words = ("06 00", "07 00", "0B 00", "00 00", "80 00", "0F 01", *["0F 00"] * 6)
    for _ in range(60):
        for key, values in {
            f"{chance.choice(('605A', '605B', '605C', '605D', '605E', '6007'))}:00":
                ("FFFF", "0000", "0100", "0200", "0300", "0500", "0600", "0700", "0800"),
            "6060:00": ("04", "0A", "0A", "00", "03"),
            "6072:00": ("E803", "0A00", "FF7F"),
        }.items():  # fmt: skip
            lines.append(bench.write(1, key, chance.choice(values)))
        bench.world.counts_per_second = chance.choice((0.0, 0.0, 5e4))
        if fault := chance.choice(("", "", "over_current", "torque_off", "disable", "clear")):
            bench.rig.inject("drive", fault, 0.0, chance.choice((0.0, 0.01)), bench.now_ns)
        for _ in range(12):
            bench.send(0x770, "05")
            target = f"{chance.randrange(256):02X} 0{chance.randrange(4)}"
            bench.send(0x201, f"{chance.choice(words)} {target}")
            lines.append((bench.run(1), bench.statusword(), bench.read(1, "6074:00")))
            world = bench.world
            lines.append((world.vertical_command, world.vertical_powered, world.vertical_braked))
        if chance.random() < 0.3:  # a silent master, or one that changes the state
            lines.append(bench.run(chance.choice((30, 130, 1200))))
            lines.append(bench.ask(0x000, chance.choice(("0201", "8001", "8101", "8201"))))
            bench.run(30)
            bench.start(1)
    kept(digest(lines))


@pytest.mark.parametrize("device", NODES)
def test_every_way_to_map_a_pdo(make_bench, device, kept):
    """Right and wrong orders of writes to the first two PDOs, and what is sent and heard then."""
    bench, chance, node, lines = make_bench(device), random.Random(device), NODES[device], []
    ids = [*(0x180 + node | number << 8 for number in range(4)), 0x701, 0x080, 0x601]
    entries = (
        "20000460", "10000365", "20006460", "10004160", "10007160", "08006060", "10000600",
        "20000160", "00000000", "08000460", "20010460", "20000768",
    )  # fmt: skip
    for _ in range(400):
        can_id = chance.choice(ids) | chance.choice((0, 0, 1 << 31, 1 << 29))
        first, number = chance.choice((0x1400, 0x1800)), chance.randrange(2)
        offset, subindex, values = chance.choice((
            (0, 1, [can_id.to_bytes(4, "little").hex()]),
            (0, 2, ("00", "01", "02", "F1", "FE", "FF")),
            (0, chance.choice((3, 5)), ("0000", "3200")),
            *[(0x200, 0, ("00", "00", "01", "02", "03", "09"))] * 2,
            *[(0x200, chance.randrange(1, 4), entries)] * 3,
        ))  # fmt: skip
        key = f"{first + offset + number:04X}:{subindex:02X}"
        lines.append(bench.write(node, key, chance.choice(values)))
        if chance.random() < 0.3:
            bench.world.encoder_count += chance.randrange(-5, 100_000)
            lines.append(bench.ask(0x000, f"{chance.choice(('01', '80'))}{node:02X}"))
            for _ in range(4):
                payload = bytes(chance.randrange(256) for _ in range(chance.randrange(9)))
                bench.send(chance.choice(ids), payload.hex())
                lines.append(bench.ask(0x080) + bench.run(chance.choice((1, 1, 60))))
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


@pytest.mark.parametrize("fault", [fault for fault in FORCE_SENSOR if fault not in CABLE])
def test_the_net_sensor_while_a_fault_lasts_and_after_it(make_bench, fault, kept):
    bench = made(make_bench, "force_sensor", sensor_profile="ati_net")

    def frames() -> list:
        return [bench.ask(0x120, "02") + bench.run(1) for _ in range(40)]

    lines = frames()
    bench.rig.inject("force_sensor", fault, 0.0, 0.0, bench.now_ns)
    lines += frames()
    bench.rig.inject("force_sensor", "clear", 0.0, 0.0, bench.now_ns)
    kept(digest(lines + frames()))


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
