# SPDX-License-Identifier: Apache-2.0
"""Every executable is there; one that cannot be imported says what is not installed."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from screw_module_ros import programs
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


def test_messages_of_another_version_are_told():
    error = ImportError("cannot import name 'New'", name="screw_module_msgs.msg")
    assert missing(error).startswith("screw_module_msgs does not fit this screw_module_ros")


def test_a_defect_of_ours_keeps_its_traceback():
    assert missing(ModuleNotFoundError("", name="screw_module_ros.nodes.nothing")) == ""
