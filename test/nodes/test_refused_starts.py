# SPDX-License-Identifier: Apache-2.0
"""What a node's process says of arguments and files that it cannot use: a sentence, code 2."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from screw_module_ros.graph import WHOLE
from screw_module_ros.nodes.bringup import executable_path
from screw_module_ros.nodes.support.arguments import arguments
from screw_module_ros.nodes.support.runtime import _begin
from screw_module_ros.settings import SettingError

pytestmark = pytest.mark.long

FILE = "{folder}/mine.yaml"


def run(*words: str, program: str = "endpoint_state") -> subprocess.CompletedProcess:
    return subprocess.run(
        [executable_path(program), *words],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--help"], "a node takes ROS arguments alone, like --ros-args -p NAME:=VALUE"),
        (["--ros-args", "--bar"], "--bar"),
        (["--ros-args", "-p", "rate:=["], "rate"),
        (["--ros-args", "-r", "__ns:=/a b"], "__ns:=/a b"),
        (["--ros-args", "--params-file", "/nonexistent"], "/nonexistent cannot be read"),
        (["--ros-args", "--params-file", FILE], "mine.yaml is no YAML"),
    ],
)
def test_what_is_refused_before_there_is_a_node(monkeypatch, tmp_path, words, told):
    (tmp_path / "mine.yaml").write_text("endpoint_state: [\n")
    given = [word.format(folder=tmp_path) for word in words]
    monkeypatch.setattr(sys, "argv", ["endpoint_state", *given])
    with pytest.raises(SettingError, match=re.escape(told)):
        _begin(arguments())


@pytest.mark.parametrize(
    ("program", "words", "told"),
    [
        ("endpoint_state", ["--foo"], ["unknown arguments: --foo"]),
        ("endpoint_state", ["--ros-args", "-p", "rate:=fast"],
         ["rate = 'fast': a value of type float is wanted"]),
        ("module", ["--ros-args", "-p", "encoder:rate:=500.0"],
         ["their rates differ", "encoder: 500", "amplifier: 1000"]),
        ("whole", ["--parts", ",".join([*WHOLE.parts, "nobody"])],
         ["--parts: nobody cannot leave the process whole: only supervisor, manus"]),
        ("whole", ["--parts", "supervisor"],
         ["amplifier cannot leave the process whole: only supervisor, manus"]),
        ("whole", ["--ros-args", "-p", "use_sim_time:=false"], ["is for simulated time alone"]),
    ],
)  # fmt: skip
def test_refused_in_a_sentence(program, words, told):
    done = run(*words, program=program)
    assert done.returncode == 2
    assert all(part in done.stderr for part in told)
    assert "Traceback" not in done.stderr


def test_what_ros_itself_cannot_do_is_a_sentence_too(monkeypatch, tmp_path):
    """No keys where SROS2 is in force: the node cannot be made."""
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Enforce")
    monkeypatch.setenv("ROS_SECURITY_KEYSTORE", str(tmp_path))
    done = run()
    assert done.returncode == 2
    assert str(tmp_path) in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("program", ["encoder", "bringup", "demo"])
def test_a_domain_that_is_none_is_named_before_anything_starts(program, monkeypatch, tmp_path):
    """A node, and the two ways in which commands begin; `test_programs.py` has other numbers."""
    monkeypatch.setenv("ROS_DOMAIN_ID", "7abc")
    monkeypatch.chdir(tmp_path)
    done = run(program=program)
    assert done.returncode == 2
    assert "ROS_DOMAIN_ID = '7abc' is no ROS domain" in done.stderr
    assert len(done.stderr.splitlines()) == 1, "nothing was started"
    assert not list(tmp_path.iterdir())
