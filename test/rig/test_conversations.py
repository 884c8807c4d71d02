# SPDX-License-Identifier: Apache-2.0
"""Conversations with the simulated devices, written from the standards: conversations.txt."""

from __future__ import annotations

import re
from ast import literal_eval
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path

import pytest

from screw_module_ros.rig.build import RigSettings

FILE = Path(__file__).with_name("conversations.txt")
NODES = {"drive": 1, "torque_drive": 1, "encoder": 2, "streaming": 2, "planar": 3}
NAMES = {"torque_drive": "drive", "sensor": "force_sensor", "streaming": "encoder"}


def conversations() -> Iterator[object]:
    """Yield devices with their settings, and the steps, of each conversation."""
    text = re.sub(r" *(#.*)?\n", "\n", FILE.read_text(encoding="utf-8"))
    for title, steps in re.findall(r"^(\w.*)\n((?: .*\n|\n)+)", text, re.MULTILINE):
        given, _, sentence = title.partition(": ")
        yield pytest.param(given.split(), steps.split("\n"), id=sentence)


def value_of(text: str) -> object:
    """Return the number, tuple or text."""
    try:
        return literal_eval(text)
    except (SyntaxError, ValueError):
        return text


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


def carry_out(talk: Talk, line: str) -> None:
    """Carry out a step, or several with `;` between them, as often as `N x` before them says."""
    times, _, steps = line.rpartition(" x ")
    for step in int(times or 1) * steps.split("; "):
        said, _, wanted = step.partition(" = ")
        verb, *words = said.split()
        answer = getattr(talk, verb)(*words)
        assert not wanted or fnmatchcase(answer, wanted), f"{step}: {answer}"


@pytest.mark.parametrize(("given", "steps"), list(conversations()))
def test_conversation(request, given, steps):
    devices, *settings = given
    if settings or "," in devices:
        values = {name: value_of(value) for name, value in (s.split("=") for s in settings)}
        make = request.getfixturevalue("make_bench")
        bench = make(*devices.split(","), settings=RigSettings(**values))
    else:
        bench = request.getfixturevalue(devices)
    talk = Talk(bench, devices.partition(",")[0])
    for line in filter(None, map(str.strip, steps)):
        carry_out(talk, line)
