# SPDX-License-Identifier: Apache-2.0
"""Mistakes in every file and text of YAML that is read: a value, or a sentence."""

from __future__ import annotations

import random
import textwrap
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from file_damage import NOTES
from runner import sentence

from screw_module_ros.calibration.gain_limits import (
    Loop,
    conditions_of,
    load_gain_limits,
)
from screw_module_ros.calibration.limits_file import text_checksum
from screw_module_ros.calibration.module import (
    ModuleCalibration,
    SensorBias,
    load_friction_model,
    load_linearization,
    load_module_calibration,
    thesis_friction,
    write_calibration,
)
from screw_module_ros.calibration.version import law_version
from screw_module_ros.control.laws.thesis import THESIS
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.identification.experiments import EXPERIMENTS, settings_from_yaml
from screw_module_ros.nodes.bringup import plan
from screw_module_ros.nodes.support.arguments import arguments, overrides
from screw_module_ros.parameter_files import sections
from screw_module_ros.plant.settings import load_world
from screw_module_ros.resources import resource_path
from screw_module_ros.therapy.protocol_file import SHIPPED, load_protocol
from screw_module_ros.therapy.scores import scores_in

_ODD = (
    ".inf", ".nan", "-.inf", "1e400", "1e-4", "2001-99-99", "2001-01-01", "null", "true", "''",
    "[]", "{}", "[1, [2, [3]]]", "*i", "? [a, b]\n: c", "'unclosed", "-0.0", "1:2:3", "0b1",
    "1_000", "~", "9" * 400,
)  # fmt: skip


_SCORES = (
    'scores:\n- at: "2026-03-03T13:05:00+01:00"\n  scale: FM_UE\n  value: 34.0\n'
    '- at: "2026-03-04T09:00:00+01:00"\n  scale: pain_after\n  value: 3\n'
)
_GAINS = "{force_gain: 3.5, observer_gain: 4.9}"


def _gain_limits() -> list[str]:
    """Return a file of gain limits, one of the version before, and a certificate before that."""
    common = "serial: SIM-1\ndate: '2001-05-11T09:30:00Z'\n"
    law, loop = VerticalSettings(), Loop(1e3, 1e-3, 30.0)
    conditions = "conditions:\n"
    for name, value in conditions_of(THESIS, law, law, loop).items():
        conditions += f"  {name}: {value}\n"
    limits = (
        f"largest_gains_on:\n  hand: {_GAINS}\n  heavy_arm: {_GAINS}\n  wall: {_GAINS}\n"
        f"exceeds:\n  soft_grip: {_GAINS}\n{conditions}"
    )
    form = "format: screw_module_ros/gain_limits\nversion:"
    texts = (
        f"{form} 3\n{common}laws:\n  thesis:\n    version: '{law_version()}'\n"
        + textwrap.indent(limits, "    "),
        f"{form} 2\n{common}law: '{law_version()}'\n{limits}",
        f"format: screw_module_ros/certificate\nversion: 1\n{common}law: '{law_version()}'\n"
        f"permitted_gains: {_GAINS}\n{conditions}",
    )
    return [f"{text}sha256: {text_checksum(text)}\n" for text in texts]


class YamlInputs:
    """One case: one reader, one of its files, damaged."""

    def __init__(self, folder: Path):
        self.counts: Counter[str] = Counter()
        self._file = folder / "given.yaml"
        self._readers = self._make_readers(folder)

    def _make_readers(self, folder: Path) -> list[tuple[str, Callable[[str], Any], list[str]]]:
        calibration = folder / "module.yaml"
        friction = thesis_friction()
        write_calibration(calibration, ModuleCalibration(
            serial="SIM-1", date="2001-05-11T09:30:00Z", software="0.1.0", gravity_N=9.8,
            mass_kg=5.5, sensor_bias=SensorBias((0.1, -0.2, 0.3), (0.01, -0.02, 0.03)),
            residuals={"backlash_mm": 0.1}, friction=friction,
            linearization=default_linearization(),
        ))  # fmt: skip
        module = calibration.read_text("utf-8")
        thesis, plant, sim, hardware = (
            resource_path(f"params/{name}.yaml").read_text("utf-8")
            for name in ("friction_thesis", "plant", "sim", "hardware")
        )
        protocols = [resource_path(f"params/therapy/{n}.yaml").read_text("utf-8") for n in SHIPPED]
        return [
            ("friction", load_friction_model, [thesis, module]),
            ("linearization", load_linearization, [module, thesis]),
            ("module", lambda path: load_module_calibration(path, "SIM-1"), [module]),
            ("gain limits", lambda path: load_gain_limits(path, "SIM-1"), _gain_limits()),
            ("plant", load_world, [plant]),
            ("protocol", load_protocol, protocols),
            ("scores", lambda path: scores_in(Path(path)), [_SCORES]),
            ("parameter file", sections, [sim, hardware]),
            ("bringup's file", lambda path: plan(params=path), [sim, hardware]),
        ]

    def case(self, rng: random.Random) -> None:
        """Let one reader read something odd."""
        way = rng.random()
        if way < 0.15:
            self._settings(rng)
        elif way < 0.25:
            self._command_line(rng)
        else:
            self._from_file(rng)

    def close(self) -> None:
        """Nothing is held."""

    def _from_file(self, rng: random.Random) -> None:
        name, read, texts = rng.choice(self._readers)
        self._file.write_bytes(_damaged(rng, rng.choice(texts)))
        self._read(name, lambda: read(str(self._file)))

    def _settings(self, rng: random.Random) -> None:
        experiment = rng.choice(list(EXPERIMENTS.values()))
        fields = list(experiment.settings._fields) or ["x"]
        lines = [f"{rng.choice(fields)}: {_value(rng)}" for _ in range(rng.randrange(4))]
        text = rng.choice(("\n".join(lines), _value(rng)))
        self._read("settings", lambda: settings_from_yaml(text, experiment.settings))

    def _command_line(self, rng: random.Random) -> None:
        rule = rng.choice(("rate:=", "encoder:rate:=", ":=", "", "a.b:=")) + _value(rng)
        words = [rng.choice(("-p", "--param", "-r")), rule]
        self._read("-p", lambda: overrides("encoder", arguments(["--ros-args", *words]).rules))

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
    if way < 0.5:
        return _reworded(rng, text).encode()
    if way < 0.55:
        return _value(rng).encode()
    return rng.choice(NOTES)(rng, text.encode())


def _reworded(rng: random.Random, text: str) -> str:
    """Put an odd value in place of one."""
    lines = text.split("\n")
    for _ in range(rng.randrange(1, 4)):
        number = rng.randrange(len(lines))
        key = lines[number].partition(":")[0]
        lines[number] = f"{key}: {_value(rng)}"
    return "\n".join(lines)
