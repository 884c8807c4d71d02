# SPDX-License-Identifier: Apache-2.0
"""The table of products: complete, held by the import contract, the ratchet and the extras."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import Counter
from importlib.metadata import requires
from pathlib import Path

import pytest
from catkin_pkg.package import parse_package
from grimp import ImportGraph

import ratchet
from products import NAME, PACKAGE, ROOT, Products, product_of, table, tomllib

RUNTIME = ROOT / "requirements/runtime.txt"
DISTRIBUTIONS = {"can": "python-can", "markdown_it": "markdown-it-py", "yaml": "pyyaml"}
"""Of a module that is not called like what is installed for it."""
NEEDED_BELOW = {"msgpack": "python-can's udp_multicast", "numpy": "rclpy"}
"""What no module of the robot has to import, and who does."""
EXTRAS_OF_PROGRAMS = {"distributed": "study --scheduler, extra `cluster`"}
KEYS = {
    "canopen-pip": {"canopen"}, "mcap-ros2-support": {"lz4", "mcap", "zstandard"},
    "python3-can": {"python-can"}, "python3-rich": {"markdown-it-py", "rich"},
    "python3-rosbags-pip": {"rosbags"}, "python3-yaml": {"pyyaml"}, "xacro": {"xacro"},
}  # fmt: skip
"""What a key of rosdep brings, where that is not its name without `python3-`."""

WITHOUT_KEY = {"robot": set(), "experiments": {"greenlet"}}
"""What rosdep does not know: docs/ros.md says how it is installed."""


def modules() -> dict[str, Path]:
    """Return each module below the package, and its file."""
    files = [file for file in PACKAGE.rglob("*.py") if file != PACKAGE / "__init__.py"]
    names = (".".join(file.relative_to(PACKAGE).with_suffix("").parts) for file in files)
    return dict(zip((name.removesuffix(".__init__") for name in names), files, strict=True))


def imported(file: Path) -> set[str]:
    """Return the packages that a file imports, also within functions."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found |= {name.name.partition(".")[0] for name in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add(str(node.module).partition(".")[0])
    return found - sys.stdlib_module_names - {NAME}


def of_ros() -> set[str]:
    """Return what import-linter knows as ROS."""
    tool = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]
    (contract,) = (
        each for each in tool["importlinter"]["contracts"] if each["name"].endswith("import ROS")
    )
    return set(contract["forbidden_modules"])


def extra(name: str) -> set[str]:
    """Return what an extra of the installed package asks for."""
    asked = [line.partition(";") for line in requires(NAME) or ()]
    return {
        requirement.strip().lower()
        for requirement, _, marker in asked
        if re.search(rf"extra == ['\"]{name}['\"]", marker)
    }


# The table ----------------------------------------------------------------------------------------


def test_every_module_is_in_a_product_and_every_name_of_the_table_is_a_module():
    products = table()
    assert list(products) == ["gym", "experiments", "simulation", "therapy", "robot"]
    assert {product_of(module, products) for module in modules()} == set(products)
    named = {name for names in products.values() for name in names}
    assert named <= modules().keys(), "a name of the table is no module any more"


def test_the_longest_name_of_the_table_counts():
    products = {"above": ["nodes.web"], "below": ["nodes"]}
    assert product_of("nodes.web", products) == "above"
    assert product_of("nodes.website", products) == "below"
    with pytest.raises(ValueError, match="other is in no product: name it in"):
        product_of("other", products)


def test_the_contract_tells_an_import_upwards_and_none_downwards():
    graph = ImportGraph()
    graph.add_module(NAME)
    for importer, name in (("rig.rig", "can_io.frames"), ("loop.drive", "rig.faults")):
        graph.add_import(importer=f"{NAME}.{importer}", imported=f"{NAME}.{name}")
    found = Products("", {}, {}).check(graph, verbose=False)
    told = f"robot: {NAME}.loop.drive imports {NAME}.rig.faults of simulation"
    assert (found.kept, found.metadata["found"]) == (False, [told])


# The ratchet --------------------------------------------------------------------------------------


def test_a_product_weighs_as_much_as_its_rooms_and_each_has_its_figure():
    found = ratchet.weights(PACKAGE)
    limits = ratchet.allowed(ratchet.WEIGHTS.read_text("utf-8"))
    assert {*found, ratchet.PRIVATE_READS} == limits.keys()
    rooms: Counter[str] = Counter()
    for name, weight in found.items():
        product, slash, _ = name.partition("/")
        rooms[product] += weight if slash else -weight
    assert set(rooms) == set(table()) and not any(rooms.values())


def test_the_ratchet_counts_a_file_for_its_product_and_tells_what_became_heavier(tmp_path):
    (tmp_path / "nodes").mkdir()
    (tmp_path / "nodes/web_bridge.py").write_text('"""No statement."""\nimport os\nimport re\n')
    (tmp_path / "nodes/encoder.py").write_text("import os\n")
    (tmp_path / "units.py").write_text(
        '"""Text."""\n\n\ndef f():\n    """Text."""\n    a = 1; b = 2\n    return a + b\n'
    )
    found = ratchet.weights(tmp_path)
    robot = {"robot": 5, "robot/nodes": 1, "robot/.": 4}
    assert found == {"therapy": 2, "therapy/nodes": 2, **robot}
    limits = ratchet.allowed("# of all\ntherapy 2\ntherapy/nodes 1\nrobot 5\nrobot/. 4\n")
    told = ratchet.too_heavy(found, limits)
    assert [sentence.split()[0] for sentence in told] == ["robot/nodes", "therapy/nodes"]
    assert "therapy/nodes weighs 2 statements, 1 are allowed" in told[1]
    assert ratchet.too_heavy(found, dict(found)) == []


def test_the_ratchet_counts_reads_of_private_attributes_in_tests(tmp_path):
    """Of others: an object's own are not counted, nor what every NamedTuple offers."""
    (tmp_path / "nodes").mkdir()
    (tmp_path / "nodes/test_one.py").write_text(
        "node._state = a._b()._c\nself._own\ncls._own\nself.other._deep\n"
        "settings._replace(x=1)._asdict()\nkind.__name__\n"
    )
    assert ratchet.private_reads(tmp_path) == 4


def test_a_file_in_no_product_ends_the_ratchet(tmp_path):
    (tmp_path / "stray.py").touch()
    with pytest.raises(ValueError, match="stray is in no product"):
        ratchet.weights(tmp_path)


# What is installed for a product ------------------------------------------------------------------


@pytest.mark.parametrize("product", ["robot", "therapy", "simulation", "experiments", "gym"])
def test_the_extra_of_a_product_names_what_its_modules_import_and_no_more(product):
    products = table()
    order = list(products)
    below = order[order.index(product) :]
    used = {
        DISTRIBUTIONS.get(name, name)
        for module, file in modules().items()
        if product_of(module, products) in below
        for name in imported(file) - of_ros() - EXTRAS_OF_PROGRAMS.keys()
    }
    assert extra(product) == used | NEEDED_BELOW.keys()


def test_what_is_pinned_is_what_the_highest_product_asks_for():
    asked_for = RUNTIME.read_text("utf-8").partition("# asked for")[2].partition("\n\n")[0]
    pinned = {line.partition("==")[0] for line in asked_for.split()}
    elsewhere = {"numpy", "pyyaml"}  # ros.txt, build.txt
    brought = {"markdown-it-py"}  # needed by rich
    assert pinned == extra("experiments") - elsewhere - brought


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # catkin_pkg calls pyparsing by old names
@pytest.mark.parametrize(
    ("environment", "product"), [({}, "experiments"), ({"SCREW_MODULE_ROBOT_ONLY": "1"}, "robot")]
)
def test_rosdep_is_asked_for_what_a_product_needs(environment, product):
    """As rosdep and colcon read package.xml: conditions by the variables of the environment."""
    package = parse_package(str(ROOT / "package.xml"))
    package.evaluate_conditions(environment)
    keys = {each.name for each in package.exec_depends if each.evaluated_condition}
    brought = {
        distribution
        for key in keys
        if key in KEYS or key.startswith("python3-")
        for distribution in KEYS.get(key, {key.removeprefix("python3-")})
    }
    rich = {"markdown-it-py"}  # brought along, not needed by the robot
    assert brought | rich | WITHOUT_KEY[product] == extra(product) | rich
    assert not brought & WITHOUT_KEY[product]
    assert "rclpy" in keys


_BLOCKED = """
import importlib, sys
for absent in ("numba", "greenlet", "matplotlib", "scipy", "aiohttp", "jinja2"):
    sys.modules[absent] = None
for module in sys.argv[1:]:
    importlib.import_module("screw_module_ros." + module)
"""


def test_all_of_the_robot_is_imported_without_numba_matplotlib_and_scipy():
    """Every module of the product, its nodes among them, in one Python without these packages."""
    products = table()
    robot = [module for module in modules() if product_of(module, products) == "robot"]
    assert {"nodes.module", "nodes.manus", "nodes.session_recorder", "operator.robot"} <= {*robot}
    words = [sys.executable, "-c", _BLOCKED, *robot]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


_SESSION = """
import sys
sys.modules["scipy"] = None
from screw_module_ros.session_command import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["info", "/nowhere"], 1, "session: there is no bag /nowhere\n"),
        (["replay", "/nowhere"], 2, "without the commands of therapy: scipy is not installed: "),
    ],
)
def test_session_shows_bags_without_therapy_and_says_what_its_commands_need(words, code, told):
    words = [sys.executable, "-c", _SESSION, *words]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, "Traceback" in done.stderr) == (code, False)
    assert told in done.stderr
