# SPDX-License-Identifier: Apache-2.0
"""What a node's process says of arguments and files that it cannot use: a sentence, code 2."""

from __future__ import annotations

import subprocess

import pytest

from screw_module_ros.nodes.bringup import executable_path

pytestmark = pytest.mark.long

FILE = "{folder}/mine.yaml"


NEED_A_DOMAIN = (
    "amplifier", "bench", "bringup", "characterize", "demo", "encoder", "endpoint_state",
    "force_sensor", "impedance_controller", "manus", "module", "session_recorder", "sim_rig",
    "soak", "supervisor", "therapy_session",
)  # fmt: skip


def run(*words: str, program: str = "endpoint_state") -> subprocess.CompletedProcess:
    return subprocess.run(
        [executable_path(program), *words],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--foo"], "unknown arguments: --foo"),
        (["--help"], "a node takes ROS arguments alone, like --ros-args -p NAME:=VALUE"),
        (["--ros-args", "--bar"], "--bar"),
        (["--ros-args", "-p", "rate:=["], "rate"),
        (["--ros-args", "-r", "__ns:=/a b"], "__ns:=/a b"),
        (["--ros-args", "-p", "rate:=fast"], "rate = 'fast': a value of type float is wanted"),
        (["--ros-args", "--params-file", "/nonexistent"], "/nonexistent cannot be read"),
        (["--ros-args", "--params-file", FILE], "mine.yaml is no YAML"),
    ],
)
def test_refused_in_a_sentence(tmp_path, words, told):
    (tmp_path / "mine.yaml").write_text("endpoint_state: [\n")
    done = run(*(word.format(folder=tmp_path) for word in words))
    assert done.returncode == 2
    assert told in done.stderr
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


@pytest.mark.parametrize(
    ("program", "told"), [*((name, "7abc") for name in NEED_A_DOMAIN), ("encoder", "233")]
)
def test_a_domain_that_is_none_is_named_before_anything_starts(
    program, told, monkeypatch, tmp_path
):
    monkeypatch.setenv("ROS_DOMAIN_ID", told)
    monkeypatch.chdir(tmp_path)
    done = run(program=program)
    assert done.returncode == 2
    assert f"ROS_DOMAIN_ID = '{told}' is no ROS domain" in done.stderr
    assert len(done.stderr.splitlines()) == 1, "nothing was started"
    assert not list(tmp_path.iterdir())
