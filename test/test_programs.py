# SPDX-License-Identifier: Apache-2.0
"""What a program needs before it runs: its entry, its packages, its files, its ROS domain."""

from __future__ import annotations

import ast
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from rclpy.context import Context

from screw_module_ros import programs, resources
from screw_module_ros.domain import domain_id
from screw_module_ros.programs import PROGRAMS, missing

ROOT = Path(__file__).parents[1]


def test_setup_installs_these_programs():
    tree = ast.parse((ROOT / "setup.py").read_text(encoding="utf-8"))
    (listed,) = (
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and node.targets[0].id == "PROGRAMS"
    )
    assert sorted(listed) == sorted(PROGRAMS)


@pytest.mark.parametrize("name", PROGRAMS)
def test_every_program_is_a_function(name):
    assert callable(getattr(programs, name))


def test_an_unknown_program_is_an_unknown_attribute():
    with pytest.raises(AttributeError, match="no executable nothing"):
        _ = programs.nothing


@pytest.mark.parametrize("name", ["bench", "soak"])
def test_what_measures_from_a_checkout_is_no_program_but_a_target_of_make(name):
    assert name not in PROGRAMS
    file = f"tools/{name}.py"
    assert f"@tools/run python {file} $(ARGS)" in (ROOT / "Makefile").read_text(encoding="utf-8")
    words = [sys.executable, str(ROOT / file), "--help"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout.startswith(f"Usage: {name}")


def _start(name: str, absent: str) -> subprocess.CompletedProcess:
    """Start a program in a Python in which a package cannot be imported."""
    code = (
        f"import sys; sys.modules['{absent}'] = None\n"
        f"from screw_module_ros.programs import {name}; sys.exit({name}())"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", ["encoder", "demo", "characterize"])
def test_a_program_without_its_messages_names_the_command(name):
    done = _start(name, "screw_module_msgs")
    assert done.returncode == 2
    assert done.stderr == (
        f"{name}: screw_module_msgs is not installed: in the workspace, "
        "ln -s screw_module_ros/msg_defs src/screw_module_msgs && colcon build && "
        "source install/setup.bash (without ROS: make build)\n"
    )


def test_a_program_without_a_package_of_pip_names_rosdep():
    done = _start("encoder", "canopen")
    assert done.returncode == 2
    assert done.stderr.startswith("encoder: canopen is not installed: rosdep install")
    assert len(done.stderr.splitlines()) == 1


# As Ctrl-C while a package of pip is imported.
_INTERRUPTED = """
import signal, sys
class Interrupts:
    def find_spec(self, name, path, target=None):
        if name == "canopen":
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Interrupts())
from screw_module_ros import programs
getattr(programs, sys.argv[1])
"""


@pytest.mark.parametrize(("name", "code"), [("encoder", 0), ("check_hardware", 130)])
@pytest.mark.parametrize("before", [signal.SIG_DFL, signal.SIG_IGN])
def test_ctrl_c_while_a_program_starts_is_no_traceback(name, code, before):
    """Also where a script's & has made its jobs ignore the signal."""
    done = subprocess.run(
        [sys.executable, "-c", _INTERRUPTED, name], capture_output=True, text=True, check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, before),
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (code, "")


_LISTENS = """
import signal
from screw_module_ros.programs import importing
with importing("it"):
    pass
try:
    signal.raise_signal(signal.SIGINT)
except KeyboardInterrupt:
    print("heard")
"""


def test_after_the_imports_a_signal_is_heard_that_a_script_had_made_ignored():
    done = subprocess.run(
        [sys.executable, "-c", _LISTENS], capture_output=True, text=True, check=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )  # fmt: skip
    assert done.stdout == "heard\n"


def test_a_signal_that_the_launch_file_held_back_ends_the_program_that_listens():
    """It came while Python itself was starting."""
    held = subprocess.Popen(
        ["env", "--block-signal=INT", sys.executable, "-c", _HELD], stdin=subprocess.PIPE,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert held.stdout.readline() == "starting\n"
    held.send_signal(signal.SIGINT)
    assert held.communicate("\n") == ("", "")
    assert held.returncode == 0


_HELD = """
print("starting", flush=True)
input()
from screw_module_ros.programs import encoder
print("not reached")
"""


def test_messages_of_another_version_are_told():
    error = ImportError("cannot import name 'New'", name="screw_module_msgs.msg")
    assert missing(error).startswith("screw_module_msgs does not fit this screw_module_ros")


def test_a_defect_of_ours_keeps_its_traceback():
    assert missing(ModuleNotFoundError("", name="screw_module_ros.nodes.nothing")) == ""


@pytest.mark.parametrize("told", ["", "0", "7", "07", "010", "0x10", "+5", " 12", "101"])
def test_as_the_middleware_reads_it(monkeypatch, told):
    monkeypatch.setenv("ROS_DOMAIN_ID", told)
    context = Context()
    context.init(args=[])
    try:
        assert domain_id() == context.get_domain_id()
    finally:
        context.try_shutdown()


def test_without_the_variable_it_is_0(monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID")
    assert domain_id() == 0


@pytest.mark.parametrize(
    "told", ["seven", "7th", "08", "-1", "0x", "1.0", "9" * 1000, "٣", "233", "0xE9"]
)
def test_what_is_no_number_is_named(monkeypatch, told):
    monkeypatch.setenv("ROS_DOMAIN_ID", told)
    with pytest.raises(ValueError, match="ROS_DOMAIN_ID") as raised:
        domain_id()
    assert len(str(raised.value)) < 100


def test_a_file_of_the_source_tree_is_found() -> None:
    assert resources.resource_path("package.xml").read_text().startswith("<?xml")


def test_a_file_inside_the_package_is_found() -> None:
    assert resources.resource_path("resources.py") == Path(resources.__file__).resolve()


def test_an_installed_file_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "share/screw_module_ros/params/mine.yaml"
    file.parent.mkdir(parents=True)
    file.touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    assert resources.resource_path("params/mine.yaml") == file


def test_a_missing_file_is_named_with_the_places() -> None:
    with pytest.raises(resources.ResourceError, match=r"params/none\.yaml not found in .*ros"):
        resources.resource_path("params/none.yaml")


def test_the_plain_package_brings_no_ros() -> None:
    code = "import sys, screw_module_ros; sys.exit('rclpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
