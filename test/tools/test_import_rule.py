# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from pathlib import Path

import pytest

import import_rule
import rules


def check(folder: Path, file: str, source: str) -> list[str]:
    path = folder / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(source)
    return [violation.reason for violation in import_rule.violations(folder)]


@pytest.mark.parametrize(
    ("file", "source"),
    [
        ("devices/encoder.py", "import rclpy"),
        ("devices/encoder.py", "import rclpy.node"),
        ("recording/bag.py", "from screw_module_msgs.msg import EncoderSample"),
        ("rig/rig.py", "def late():\n    from std_msgs.msg import Header"),
        ("samples.py", "from builtin_interfaces.msg import Time"),
        ("plant/world.py", "from screw_module_ros.control import friction"),
        ("plant/world.py", "from screw_module_ros import devices"),
        ("plant/world.py", "from ..control.friction import friction_force"),
        ("rig/rig.py", "from ..devices import encoder"),
        ("rig/rig.py", "import screw_module_ros.control.limits"),
        ("safety/permit.py", "from screw_module_ros.plant.world import World"),
        ("safety/permit.py", "import canopen"),
        ("filters.py", "import can"),
        ("recording/bag.py", "from screw_module_ros.nodes import bringup"),
        ("control/__init__.py", "from ..nodes import bringup"),
        ("__init__.py", "from . import nodes"),
        ("control/friction.py", "import yaml"),
        ("control/friction.py", "from pathlib import Path"),
        ("control/friction.py", "def load(path):\n    return open(path).read()"),
        ("safety/permit.py", "import os.path"),
        ("safety/permit.py", "from io import StringIO"),
        ("safety/checks.py", "from time import monotonic_ns"),
        ("safety/checks.py", "import socket"),
        ("plant/friction.py", "import time"),
        ("plant/friction.py", "from pathlib import Path"),
        ("geometry.py", "import yaml"),
        ("filters.py", "print(1)"),
        ("samples.py", "import os"),
        ("control/friction.py", "from ..settings import Setting, read_file"),
        ("plant/world.py", "import time"),
        ("control/friction.py", "from ..calibration.file import VERSION"),
        ("rig/rig.py", "from screw_module_ros.calibration import module"),
        ("recording/bag.py", "from ..operator import robot"),
        ("recording/bag.py", "from ..trials.demo import main"),
        ("identification/lab.py", "from .live.bench import LiveBench"),
        ("identification/lab.py", "import rclpy"),
        ("identification/lively.py", "import rclpy"),
        ("can_io/port.py", "from ..devices.errors import BusError"),
        ("rig/port.py", "from screw_module_ros.loop.ticker import Ticker"),
        ("recording/expected.py", "from ..therapy.bag import read_session"),
        ("nodes/encoder.py", "from screw_module_ros.operator.robot import Robot"),
        ("operator/robot.py", "from screw_module_ros.trials.demo import main"),
        ("identification/live/bench.py", "from screw_module_ros.trials.demo import main"),
        ("nodes/encoder.py", "from screw_module_ros.identification.live.loop import LiveLoop"),
        ("safety/checks.py", "from ..clock import Clock"),
        ("plant/world.py", "from screw_module_ros.clock import Clock"),
        ("cellar/encoder.py", "from ..settings import Setting"),
        ("loop/one.py", "from . import one\nfrom .two import three\nfrom ..cellar import wine"),
    ],
)
def test_a_violation_is_caught(tmp_path: Path, file: str, source: str) -> None:
    assert len(check(tmp_path, file, source)) == 1


@pytest.mark.parametrize(
    ("file", "source"),
    [
        ("nodes/encoder.py", "import rclpy\nfrom ..devices.encoder import Encoder"),
        ("nodes/sim_rig.py", "from screw_module_ros.rig.rig import Rig"),
        ("operator/robot.py", "import rclpy"),
        ("trials/demo.py", "import rclpy\nfrom ..operator.robot import Robot"),
        ("identification/live/bench.py", "import rclpy\nfrom ...nodes.support import topics"),
        ("plant/settings.py", "import yaml\nfrom pathlib import Path"),
        ("calibration/module.py", "import yaml\nfrom ..control.friction import Branch"),
        ("identification/calibration.py", "from ..calibration.module import write_calibration"),
        ("rig/rig.py", "from screw_module_ros.plant.world import World\nimport can"),
        ("devices/drive.py", "from ..can_io import bus\nfrom ..samples import DriveReading"),
        ("control/vertical.py", "import math\nfrom .impedance import force"),
        ("plant/world.py", "from screw_module_ros.compiled import compiled"),
        ("rig/port.py", "from screw_module_ros.can_io.port import Port"),
        ("__init__.py", "from . import clock"),
    ],
)
def test_what_the_layers_may_import(tmp_path: Path, file: str, source: str) -> None:
    assert check(tmp_path, file, source) == []


def test_a_circle_of_modules_is_named(tmp_path: Path) -> None:
    check(tmp_path, "loop/one.py", "def late():\n    from .two import b")
    check(tmp_path, "loop/two.py", "from . import three")
    (reason,) = check(tmp_path, "loop/three.py", "from screw_module_ros.loop.one import a")
    names = [f"screw_module_ros.loop.{name}" for name in ("one", "two", "three", "one")]
    assert reason.endswith(f"circle: {' -> '.join(names)}")


def test_an_import_for_types_alone_closes_no_circle(tmp_path: Path) -> None:
    check(tmp_path, "loop/one.py", "if TYPE_CHECKING:\n    from .two import B")
    assert check(tmp_path, "loop/two.py", "from .one import a") == []


def test_a_violation_names_file_and_line(tmp_path: Path) -> None:
    check(tmp_path, "plant/world.py", "import math\nimport rclpy\n")
    (violation,) = import_rule.violations(tmp_path)
    assert str(violation).startswith(f"{tmp_path}/plant/world.py:2: ")


def test_this_package_keeps_to_the_rule() -> None:
    assert import_rule.violations(rules.FOLDER) == []
