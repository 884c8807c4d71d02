# SPDX-License-Identifier: Apache-2.0
"""YAML from others into everything that reads some: a value, or a sentence."""

from __future__ import annotations

import os
import random
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bag_damage import NOTES
from runner import sentence

from screw_module_ros.calibration.friction_file import load_friction_model, thesis_friction
from screw_module_ros.calibration.linearization_file import load_linearization
from screw_module_ros.calibration.module_fields import ModuleCalibration
from screw_module_ros.calibration.module_file import load_module_calibration, write_calibration
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.identification.catalogue import EXPERIMENTS, settings_from_yaml
from screw_module_ros.nodes.bringup import plan
from screw_module_ros.nodes.support.command_line import arguments, overrides
from screw_module_ros.nodes.support.parameter_files import read_file
from screw_module_ros.plant.settings import load_world
from screw_module_ros.resources import resource_path
from screw_module_ros.therapy.protocol_file import SHIPPED, load_protocol

_SLOWEST_S = 20.0  # of the processor; the largest text that is read at all takes a few
_BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{chr(98 + n)}: &{chr(98 + n)} [{', '.join([f'*{chr(97 + n)}'] * 10)}]\n" for n in range(8)
)
_ODD = (
    "*i", "&x [*x]", "&x {a: *x}", "!!python/object/apply:os.getcwd []", "1e400", ".inf", ".nan",
    "-.inf", "1" * 5000, "0x" + "f" * 5000, "2001-99-99", "2001-01-01", "[" * 3000, "{a: " * 3000,
    "null", "true", "''", "[]", "{}", "[1, [2, [3]]]", "!!binary aGFsbG8=", "!!set {a, b}",
    "<<: {a: 1}", "\x00", "\ud800", "? [a, b]\n: c", "'unclosed", "%YAML 9.9", "x" * 200_000,
    "-0.0", "1:2:3", "0b1", "1_000", "~", "!!float x", "!!int ''", "9" * 400,
)  # fmt: skip


class YamlInputs:
    """One case: one reader, one of its files, damaged."""

    def __init__(self, folder: Path):
        self.counts: Counter[str] = Counter()
        self._file = folder / "given.yaml"
        self._fifo, self._link = folder / "fifo.yaml", folder / "link.yaml"
        os.mkfifo(self._fifo)
        self._link.symlink_to(folder / "nowhere")
        self._large = folder / "large.yaml"
        with self._large.open("wb") as file:
            file.truncate(1 << 30)
        self._readers = self._make_readers(folder)

    def _make_readers(self, folder: Path) -> list[tuple[str, Callable[[str], Any], list[str]]]:
        calibration = folder / "module.yaml"
        friction = thesis_friction()
        write_calibration(calibration, ModuleCalibration(
            serial="SIM-1", date="2001-05-11T09:30:00Z", software="0.1.0", friction=friction,
            linearization=default_linearization(), gravity=9.8, mass=5.5,
            sensor_bias=(0.1, -0.2, 0.3, 0.01, -0.02, 0.03), residuals={"backlash_mm": 0.1},
        ))  # fmt: skip
        module = calibration.read_text("utf-8")
        thesis, plant, sim, bench = (
            resource_path(f"params/{name}.yaml").read_text("utf-8")
            for name in ("friction_thesis", "plant", "sim", "bench")
        )
        protocols = [resource_path(f"params/therapy/{n}.yaml").read_text("utf-8") for n in SHIPPED]
        return [
            ("friction", load_friction_model, [thesis, module]),
            ("linearization", load_linearization, [module, thesis]),
            ("module", lambda path: load_module_calibration(path, "SIM-1"), [module]),
            ("plant", load_world, [plant]),
            ("protocol", load_protocol, protocols),
            ("parameter file", read_file, [sim, bench]),
            ("bringup's file", lambda path: plan(params=path), [sim, bench]),
        ]

    def case(self, rng: random.Random) -> None:
        """Let one reader read something odd."""
        begun = time.process_time()
        way = rng.random()
        if way < 0.15:
            self._settings(rng)
        elif way < 0.25:
            self._command_line(rng)
        else:
            self._from_file(rng)
        spent = time.process_time() - begun
        assert spent < _SLOWEST_S, f"{spent:.0f} s of the processor"

    def close(self) -> None:
        """Nothing is held."""

    def _from_file(self, rng: random.Random) -> None:
        name, read, texts = rng.choice(self._readers)
        path = self._odd_path(rng)
        if path is None:
            path = self._file
            path.write_bytes(_damaged(rng, rng.choice(texts)))
        self._read(name, lambda: read(str(path)))

    def _odd_path(self, rng: random.Random) -> Path | None:
        if rng.random() > 0.05:
            return None
        odd = (self._fifo, self._link, self._large, self._file.parent, Path("/dev/zero"),
               Path("\0"), Path("x" * 300), Path(""))  # fmt: skip
        return rng.choice(odd)

    def _settings(self, rng: random.Random) -> None:
        experiment = rng.choice(list(EXPERIMENTS.values()))
        fields = list(experiment.settings._fields) or ["x"]
        lines = [f"{rng.choice(fields)}: {_value(rng)}" for _ in range(rng.randrange(4))]
        text = rng.choice(("\n".join(lines), _BOMB, _value(rng)))
        self._read("settings", lambda: settings_from_yaml(text, experiment.settings))

    def _command_line(self, rng: random.Random) -> None:
        rule = rng.choice(("rate:=", "encoder:rate:=", ":=", "", "a.b:=")) + _value(rng)[:5000]
        words = [rng.choice(("-p", "--param", "-r")), rule]
        self._read("-p", lambda: overrides("encoder", arguments(["--ros-args", *words])))

    def _read(self, name: str, read: Callable[[], Any]) -> None:
        try:
            read()
            self.counts[f"{name}: taken"] += 1
        except ValueError as error:
            sentence(error)
            self.counts[f"{name}: refused"] += 1


def _value(rng: random.Random) -> str:
    known = ("0", "-1", "1e9", "0.5", "[1, 2]", "abc", str(rng.uniform(-1e3, 1e3)))
    return rng.choice(known + _ODD)


def _damaged(rng: random.Random, text: str) -> bytes:
    way = rng.random()
    if way < 0.4:
        return _reworded(rng, text).encode("utf-8", "surrogatepass")
    if way < 0.5:
        return (_BOMB + text + "\n" + f"z: *{rng.choice('bcdefghi')}\n").encode()
    if way < 0.55:
        return _value(rng).encode("utf-8", "surrogatepass")
    return rng.choice(NOTES)(rng, text.encode())


def _reworded(rng: random.Random, text: str) -> str:
    """Put an odd value in place of one, an alias of a bomb among them."""
    lines = text.split("\n")
    for _ in range(rng.randrange(1, 4)):
        number = rng.randrange(len(lines))
        key = lines[number].partition(":")[0]
        lines[number] = f"{key}: {_value(rng)}"
    head = _BOMB if rng.random() < 0.3 else ""
    return head + "\n".join(lines)
