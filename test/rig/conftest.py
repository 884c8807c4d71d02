# SPDX-License-Identifier: Apache-2.0
"""A bench for the far end: raw frames in, raw frames out, time by hand.

Everything on the wire is written as hex here, from the standards' layouts, so that no codec of the
rig checks itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import can
import pytest

from screw_module_ros.rig.rig import Rig

MS = 1_000_000
Frame = tuple[int, str]


class FakeWorld:
    """A plant that does what the test says and remembers what it was told."""

    def __init__(self):
        self.vertical_command = 0.0
        self.planar_command = (0.0, 0.0)
        self.vertical_powered = self.vertical_braked = False
        self.planar_powered = self.planar_braked = (False, False)
        self.encoder_count = 0
        self.planar_counts = (0, 0)
        self.vertical_torque = 0.0
        self.planar_torque = (0.0, 0.0)
        self.load = (0.0,) * 6
        self.steps: list[float] = []
        self.counts_per_second = 0.0
        self.watch = lambda: None

    @property
    def time(self) -> float:
        return sum(self.steps)

    def advance(self, dt: float) -> None:
        self.watch()
        self.steps.append(dt)
        self.encoder_count += round(dt * self.counts_per_second)

    def wrench(self) -> tuple[float, ...]:
        return self.load


class Bench:
    """The near end of a bus with the rig behind it."""

    def __init__(self, rig: Rig, bus: can.BusABC, world: FakeWorld):
        self.rig, self.bus, self.world = rig, bus, world
        self.now_ns = 1_000 * MS

    def send(self, can_id: int, payload: str = "") -> None:
        data = bytes.fromhex(payload)
        self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def ask(self, can_id: int, payload: str = "") -> list[Frame]:
        """Send a frame and return what comes back at the same instant."""
        self.send(can_id, payload)
        return self.run(0)

    def run(self, milliseconds: int) -> list[Frame]:
        """Let time pass, a millisecond at a time, and return the frames that came."""
        self.rig.process(self.now_ns)
        for _ in range(milliseconds):
            self.now_ns += MS
            self.rig.process(self.now_ns)
        return self.drain()

    def drain(self) -> list[Frame]:
        frames = []
        while (message := self.bus.recv(0)) is not None:
            frames.append((message.arbitration_id, bytes(message.data).hex(" ").upper()))
        return frames

    def write(self, node: int, key: str, value: str) -> str:
        """Write `value` (hex, little endian) to "index:subindex"; return "ok" or the abort code."""
        index, subindex = key.split(":")
        data = bytes.fromhex(value)
        head = {1: "2F", 2: "2B", 4: "23"}[len(data)] + index[2:] + index[:2] + subindex
        replies = self.ask(0x600 + node, head + data.ljust(4, b"\0").hex())
        answer = bytes.fromhex(next(p for i, p in replies if i == 0x580 + node))
        return "ok" if answer[0] == 0x60 else answer[4:][::-1].hex()

    def read(self, node: int, key: str) -> str:
        """Return an object of up to four bytes as hex, little endian, or its abort code."""
        index, subindex = key.split(":")
        request = "40" + index[2:] + index[:2] + subindex + "00000000"
        replies = self.ask(0x600 + node, request)
        answer = bytes.fromhex(next(p for i, p in replies if i == 0x580 + node))
        if answer[0] == 0x80:
            return answer[4:][::-1].hex()
        return answer[4 : 8 - (answer[0] >> 2 & 3)].hex()

    def statusword(self) -> str:
        """Return the vertical drive's statusword as hex, little endian."""
        return self.read(1, "6041:00")

    def enable(self, target: str = "00 00") -> None:
        """Enable the vertical drive by RPDO and command a target torque (hex, little endian)."""
        for controlword in ("06 00 00 00", "07 00 00 00", "0F 00 00 00", "0F 00" + target):
            self.send(0x201, controlword)
        self.run(0)

    def start(self, node: int) -> None:
        self.ask(0x000, f"01{node:02X}")

    def map_pdo(self, node: int, number: int, entries: list[str], kind: str, cob_id: str) -> None:
        """Configure TPDO `number` as a careful master would; ids and entries little endian."""
        self.write(node, f"18{number:02X}:01", cob_id[:6] + "80")
        self.write(node, f"1A{number:02X}:00", "00")
        for position, entry in enumerate(entries, 1):
            assert self.write(node, f"1A{number:02X}:{position:02X}", entry) == "ok"
        assert self.write(node, f"1A{number:02X}:00", f"{len(entries):02X}") == "ok"
        assert self.write(node, f"18{number:02X}:02", kind) == "ok"
        assert self.write(node, f"18{number:02X}:01", cob_id) == "ok"

    def silence(self, node: int) -> None:
        """Switch off the PDOs that a drive or encoder has at power-on."""
        for number in (0, 1):
            cob_id = f"{(0x180 + 0x100 * number + node).to_bytes(2, 'little').hex()}0080"
            self.write(node, f"18{number:02X}:01", cob_id)


@pytest.fixture(scope="session")
def make_fake_world() -> type[FakeWorld]:
    return FakeWorld


@pytest.fixture
def world() -> FakeWorld:
    return FakeWorld()


@pytest.fixture
def make_bench(world: FakeWorld, request) -> Iterator[Callable[..., Bench]]:
    """Return a function that builds a rig with the named buses on one virtual channel."""
    opened: list[can.BusABC] = []

    def make(*keys: str, booted: bool = True, **options) -> Bench:
        channel = f"{request.node.nodeid}/{len(opened)}"
        near, far = (can.Bus(interface="virtual", channel=channel) for _ in range(2))
        opened.extend((near, far))
        rig = Rig(dict.fromkeys(keys, far), world, **options)
        bench = Bench(rig, near, world)
        if booted:
            bench.run(0)
        return bench

    yield make
    for bus in opened:
        bus.shutdown()


@pytest.fixture
def encoder(make_bench) -> Bench:
    return make_bench("encoder")


@pytest.fixture
def drive(make_bench) -> Bench:
    return make_bench("drive")


@pytest.fixture
def streaming(encoder: Bench) -> Bench:
    """Return an encoder that answers each SYNC with its position."""
    encoder.silence(2)
    encoder.map_pdo(2, 0, ["20000460"], "01", "82010000")
    encoder.start(2)
    encoder.drain()
    return encoder


@pytest.fixture
def planar(make_bench) -> Bench:
    return make_bench("planar")


@pytest.fixture
def sensor(make_bench) -> Bench:
    """Return a force sensor whose converter has no noise, so that its words are exact."""
    bench = make_bench("force_sensor")
    bench.rig.devices["force_sensor"].converter_noise = 0.0
    return bench


@pytest.fixture
def torque_drive(drive: Bench) -> Bench:
    """Return a drive set up as this project's nodes do it: guards, CST, coasting, OPERATIONAL."""
    drive.silence(1)
    drive.write(1, "1400:01", "01020080")
    drive.write(1, "1401:01", "01030080")
    drive.write(1, "1600:00", "00")
    drive.write(1, "1600:01", "10004060")
    drive.write(1, "1600:02", "10007160")
    drive.write(1, "1600:00", "02")
    drive.write(1, "1400:02", "FF")
    drive.write(1, "1400:05", "1400")
    drive.write(1, "1400:01", "01020000")
    drive.map_pdo(1, 0, ["10004160", "20006460", "10007760"], "01", "81010000")
    for key, value in (
        ("1017:00", "0000"),
        ("1016:01", "64007000"),
        ("6007:00", "0100"),
        ("605A:00", "0000"),
        ("605E:00", "0000"),
        ("605C:00", "0000"),
        ("6060:00", "0A"),
    ):
        assert drive.write(1, key, value) == "ok"
    drive.start(1)
    return drive
