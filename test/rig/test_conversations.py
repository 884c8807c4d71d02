# SPDX-License-Identifier: Apache-2.0
"""Conversations with the simulated devices, written from the standards: conversations.txt."""

from __future__ import annotations

from pathlib import Path

import pytest
from conversation import carry_out, conversations, value_of, values_of

from screw_module_ros.rig.build import RigSettings

NODES = {"drive": 1, "torque_drive": 1, "encoder": 2, "streaming": 2, "planar": 3}
NAMES = {"torque_drive": "drive", "sensor": "force_sensor", "streaming": "encoder"}


def told(frames: list[tuple[int, str]]) -> str:
    return " | ".join(f"{can_id:03X} {data}".strip() for can_id, data in frames) or "nothing"


class Talk:
    """Each method is a step; what it returns is compared with what the step wants."""

    def __init__(self, bench, device: str):
        self._bench, self._node = bench, NODES.get(device, 0)
        self._device = NAMES.get(device, device)

    def _at(self, text: str) -> tuple[int, str]:
        node, _, rest = text.rpartition("/")
        return int(node or self._node), rest

    def ask(self, can_id: str, *data: str) -> str:
        return told(self._bench.ask(int(can_id, 16), " ".join(data)))

    def send(self, can_id: str, *data: str) -> None:
        self._bench.send(int(can_id, 16), " ".join(data))

    def run(self, milliseconds: str) -> str:
        return told(self._bench.run(int(milliseconds)))

    def stall(self, milliseconds: str) -> None:
        self._bench.now_ns += int(milliseconds) * 1_000_000

    def drain(self) -> None:
        self._bench.drain()

    def write(self, key: str, value: str) -> str:
        return self._bench.write(*self._at(key), value)

    def read(self, key: str) -> str:
        return self._bench.read(*self._at(key))

    def start(self, node: str = "") -> None:
        self._bench.start(int(node or self._node))

    def silence(self, node: str = "") -> None:
        self._bench.silence(int(node or self._node))

    def map(self, number: str, kind: str, cob_id: str, *entries: str) -> None:
        node, number = self._at(number)
        self._bench.map_pdo(node, int(number), list(entries), kind, cob_id)

    def enable(self, *target: str) -> None:
        self._bench.enable(" ".join(target) or "00 00")

    def inject(self, fault: str, value: str = "0", duration: str = "0") -> str:
        device, _, name = fault.rpartition("/")
        given = (device or self._device, name, float(value_of(value)), float(duration))
        return self._bench.rig.inject(*given, self._bench.now_ns)

    def let(self, name: str, *value: str) -> None:
        setattr(self._bench.world, name, value_of(" ".join(value)))

    def see(self, name: str) -> str:
        value = getattr(self._bench.world, name)
        return f"{value:g}" if isinstance(value, float) else str(value)

    def state(self) -> str:
        """Return the NMT state of a device."""
        return f"{self._bench.rig.devices[self._device].state:02X}"


ALL = [
    pytest.param(given, steps, id=sentence)
    for given, sentence, steps in conversations(Path(__file__).with_name("conversations.txt"))
]


@pytest.mark.parametrize(("given", "steps"), ALL)
def test_conversation(request, given, steps):
    devices, *settings = given
    if settings or "," in devices:
        make = request.getfixturevalue("make_bench")
        bench = make(*devices.split(","), settings=RigSettings(**values_of(settings)))
    else:
        bench = request.getfixturevalue(devices)
    talk = Talk(bench, devices.partition(",")[0])
    for line in steps:
        carry_out(talk, line)
