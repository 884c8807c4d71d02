# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

LIBRARIES, PREFIXES, WHEELS_DONE = (
    "LD_LIBRARY_PATH",
    "AMENT_PREFIX_PATH",
    "_ROS_WHEELS_BOOTSTRAP_COMPLETE",
)
# Creating a publisher loads the middleware's support of the message, a library found by name.
PUBLISHER = """
import rclpy
from screw_module_msgs.msg import SimTruth
rclpy.init()
node = rclpy.create_node("probe")
node.create_publisher(SimTruth, "truth", 1)
print(node.get_name())
node.destroy_node()
rclpy.shutdown()
"""
with_wheels = pytest.mark.skipif(
    not Path(sys.prefix, "share/rclpy").is_dir(), reason="a sourced ROS is in use"
)


def python(*arguments: str, **changes: str | None) -> str:
    env = {**os.environ, **changes}
    given = {name: value for name, value in env.items() if value is not None}
    command = [sys.executable, *arguments]
    return subprocess.run(command, env=given, capture_output=True, text=True, check=True).stdout


@with_wheels
@pytest.mark.parametrize("done", [None, "1"])
def test_ros_and_messages_are_found_whatever_was_inherited(done: str | None) -> None:
    left = {"LD_LIBRARY_PATH": None, "AMENT_PREFIX_PATH": None, WHEELS_DONE: done}
    assert python("-c", PUBLISHER, **left) == "probe\n"


@with_wheels
def test_what_was_set_is_kept_behind() -> None:
    code = f"import os; print(os.environ['{LIBRARIES}'], os.environ['{PREFIXES}'], sep='|')"
    printed = python("-c", code, LD_LIBRARY_PATH="/mine", AMENT_PREFIX_PATH="/theirs")
    libraries, prefixes = printed.rstrip().split("|")
    assert libraries.split(":")[-1] == "/mine"
    assert f"{sys.prefix}/lib" in libraries.split(":")
    assert prefixes.split(":")[-2:] == [sys.prefix, "/theirs"]


def test_arguments_and_input_survive_the_restart() -> None:
    code = "import sys; print(sys.argv[1:], sys.flags.optimize, sys.executable)"
    printed = python("-O", "-c", code, "a b", "*", LD_LIBRARY_PATH=None)
    assert printed == f"['a b', '*'] 1 {sys.executable}\n"


def test_colcons_setup_scripts_see_what_they_were_given(tmp_path: Path) -> None:
    script = tmp_path / "_local_setup_util_sh.py"
    script.write_text("import os; print(os.environ.get('AMENT_PREFIX_PATH'))")
    assert python(str(script), AMENT_PREFIX_PATH=None, **{WHEELS_DONE: "1"}) == "None\n"
