# SPDX-License-Identifier: Apache-2.0
"""Closures: what importing a module loads is counted as Python loads it, and held to a figure."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import closures
import ratchet


@pytest.fixture
def package(tmp_path) -> Path:
    """A package `robot`: `nodes.one` loads `loop` and `units`, and only for a type `law`."""
    files = {
        "__init__.py": "",
        "units.py": "KILO = 1000\n",
        "law.py": "A = 1\nB = 2\n",
        "loop/__init__.py": "from ..units import KILO\n",
        "loop/turn.py": "import math\n\ndef turn():\n    from .. import law\n    return law.A\n",
        "nodes/__init__.py": "",
        "nodes/one.py": (
            "from typing import TYPE_CHECKING\nimport robot.loop.turn as turning\n"
            "if TYPE_CHECKING:\n    from robot.law import A\n"
            "try:\n    import unknown\nexcept ImportError:\n    unknown = None\n"
        ),
    }
    for name, text in files.items():
        file = tmp_path / "robot" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return tmp_path / "robot"


def test_a_closure_counts_what_the_import_loads_and_no_type_or_function_does(package):
    assert set(closures.loaded(package, "nodes.one")) == {
        "robot", "robot.nodes", "robot.nodes.one", "robot.loop", "robot.loop.turn", "robot.units",
    }  # fmt: skip
    own, turn, loop, units = 7, 4, 1, 1
    assert closures.closure(package, "nodes.one") == own + turn + loop + units


def test_a_closure_that_grows_beyond_its_figure_is_named(package):
    limits = {"nodes.one": 13}
    assert closures.too_wide(package, limits) == []
    with (package / "loop" / "turn.py").open("a") as file:
        file.write("import robot.law\n")
    (sentence,) = closures.too_wide(package, limits)
    assert sentence.startswith("importing nodes.one loads 16 statements of the package, 13 are")


@pytest.mark.parametrize("module", ["nodes.encoder", "nodes.supervisor", "operator.robot"])
def test_a_closure_names_the_files_that_python_loads(module):
    """Nothing of the package is loaded behind the back of the count, as by an entry point."""
    name = ratchet.PACKAGE.name
    code = (
        f"import sys, {name}.{module}\n"
        f"print(*(m for m in sys.modules if m.split('.')[0] == '{name}'))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(run.stdout.split()) == set(closures.loaded(ratchet.PACKAGE, module))


def test_a_sensor_s_process_loads_no_law_no_drive_and_no_simulated_bus():
    for module in ("nodes.encoder", "nodes.force_sensor"):
        rooms = {name.split(".", 1)[-1] for name in closures.loaded(ratchet.PACKAGE, module)}
        strange = {"loop.controller", "loop.drive", "devices.drive"} & rooms
        strange |= {room for room in rooms if room.split(".")[0] in ("control", "plant", "rig")}
        assert not strange


def test_every_figure_names_a_module_of_the_package():
    limits = ratchet.allowed(closures.FIGURES.read_text("utf-8"))
    assert min(closures.closure(ratchet.PACKAGE, module) for module in limits) > 0
    assert limits["nodes.encoder"] <= 4400 and limits["nodes.force_sensor"] <= 4410
    assert limits["nodes.supervisor"] <= 2900
