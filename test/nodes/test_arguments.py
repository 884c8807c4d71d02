# SPDX-License-Identifier: Apache-2.0
"""What a node and `bringup` take of command lines and parameter files."""

from __future__ import annotations

import os
import signal

import pytest
import rclpy
from click.testing import CliRunner

from screw_module_ros.graph import MODULE, WHOLE
from screw_module_ros.nodes import bringup
from screw_module_ros.nodes.bringup import plan
from screw_module_ros.nodes.support.arguments import (
    Arguments,
    Rule,
    arguments,
    overrides,
)
from screw_module_ros.nodes.support.runtime import _begin
from screw_module_ros.settings import SettingError
from screw_module_ros.trials.runner import recordings_in

LEFT = ("-r", "__ns:=/left")


def values(name: str, *words: str) -> dict:
    given = arguments(["--ros-args", *words])
    return {parameter.name: parameter.value for parameter in overrides(name, given.rules)}


def test_what_a_command_line_says():
    words = ["one", "--ros-args", "--params-file", "a.yaml", "-p", "n:x:=1", "--param", "y:=a:=b",
             "-r", "t:=u", "--log-level", "debug", "--", "two"]  # fmt: skip
    assert arguments(words) == Arguments(
        ["a.yaml"], [Rule("n", "x", "1"), Rule("", "y", "a:=b")], ["one", "two"]
    )


def test_the_word_that_opens_a_node_to_other_machines():
    given = arguments(["--network", "--ros-args", "-p", "x:=1"])
    assert given.network and given.others == []
    assert not arguments(["--ros-args", "--network"]).network


def test_a_rule_for_the_node_wins_over_one_for_all():
    assert values("n", "-p", "n:x:=1", "-p", "x:=2", "-p", "m:x:=3") == {"x": 1}


@pytest.mark.parametrize(
    ("text", "value"),
    [("5e2", 500.0), ("1e-3", 0.001), ("[1e-3, 2.0]", [0.001, 2.0]), ("true", True), ("", ""),
     ("'1e3'", "1e3"), ("soft", "soft"), ("2001-05-11", "2001-05-11"), ('"7"', "7")],
)  # fmt: skip
def test_values_are_what_rcl_takes_them_for(text, value):
    assert values("n", "-p", f"x:={text}") == {"x": value}


@pytest.mark.parametrize(
    "text", ["[", "{a: 1}", "[1, a]", "*x", "9" * 5000]
)
def test_a_value_that_cannot_be_is_named(text):
    with pytest.raises(SettingError, match="parameter x = "):
        values("n", "-p", f"x:={text}")


def test_it_reaches_the_node_in_a_namespace(make_node):
    node = make_node("encoder", *LEFT, "-p", "encoder:home_position:=0.2")
    assert node.get_fully_qualified_name() == "/left/encoder"
    assert node.get_parameter("home_position").value == 0.2


@pytest.mark.parametrize("name", ["two words", "ä", "\N{GRINNING FACE}", "#1", "a:=b", "\n"])
def test_a_run_can_record_into_any_folder(make_node, tmp_path, name):
    node = make_node("session_recorder", *recordings_in(tmp_path / name))
    assert node.get_parameter("folder").value == str(tmp_path / name)


@pytest.mark.parametrize("key", ["/**/encoder", "encoder", "/**"])
def test_it_wins_over_a_file(make_node, tmp_path, key):
    file = tmp_path / "p.yaml"
    file.write_text(f"/**:\n  ros__parameters: {{autostart: false}}\n"
                    f"{key}:\n  ros__parameters: {{rate: 1000.0}}\n")
    if key == "/**":
        file.write_text("/**:\n  ros__parameters: {rate: 1000.0}\n")
    node = make_node("encoder", "--params-file", str(file), "-p", "rate:=500.0")
    assert node.get_parameter("rate").value == 500.0


@pytest.fixture
def file(tmp_path):
    """Return a maker of parameter files from text; it returns the path."""

    def make(text: str) -> str:
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        return str(path)

    return make


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a: [", "is no YAML"),
        ("", "has no section with `ros__parameters:`"),
        ("encoder: {rate: 1.0}", "has no section with `ros__parameters:`"),
        ("ros__parameters: {rate: 1.0}", "no node names before ros__parameters"),
        ("encoder: {ros__parameters: 5}", "Cannot have a value before ros__parameters"),
        ("'': {ros__parameters: {rate: 1.0}}", "No key at line 1"),
        ("/: {ros__parameters: {rate: 1.0}}", "node name must not be empty"),
        ("left: {'': {ros__parameters: {rate: 1.0}}}", "No key at line 1"),
        ("encoder: {ros__parameters: {'': 1.0}}", "No key at line 1"),
        ("encoder: {ros__parameters: {can: {'': 1}}}", "No key at line 1"),
    ],
)
def test_a_file_that_is_none_is_refused_by_name(file, monkeypatch, text, told):
    """By us or by rcl, before a node is made."""
    path = file(text)
    monkeypatch.setattr("sys.argv", ["encoder", "--ros-args", "--params-file", path])
    with pytest.raises(SettingError, match="mine.yaml") as caught:
        _begin(Arguments([path], [], []))
    assert told in str(caught.value)
    assert not rclpy.ok()


def given(planned, node: str) -> dict:
    """Return what the planned command line sets for a node."""
    said = arguments(["--ros-args", *planned.common])
    return {parameter.name: parameter.value for parameter in overrides(node, said.rules)}


def test_a_file_that_is_not_there_starts_nothing():
    with pytest.raises(SettingError, match="/nonexistent.yaml"):
        plan(params="/nonexistent.yaml")


def test_the_packaged_files_have_no_section_that_nobody_reads():
    for simulation in (True, False):
        for shared in (None, MODULE):
            assert plan(simulation, shared=shared, namespace="left").warnings == []


@pytest.mark.parametrize("namespace", ["left", "/left", "/left/"])
def test_one_way_to_write_a_namespace(namespace):
    assert plan(namespace=namespace).namespace == "/left"
    assert plan(namespace="/").namespace == ""


@pytest.mark.parametrize("shared", [None, MODULE, WHOLE])
def test_the_rig_has_the_latency_of_the_processes(shared):
    rig = given(plan(namespace="left", shared=shared), "sim_rig")
    assert rig["devices.command_latency"] == (0.3e-3 if shared else 0.6e-3)


def test_the_whole_robot_is_one_process_but_for_those_that_stay_apart():
    (entry,) = plan(shared=WHOLE).entries
    assert (entry, bringup.own_words(entry)) == (WHOLE, [])
    entry, *others = plan(shared=WHOLE, apart=["manus"], without=["endpoint_state"]).entries
    assert [each.executable for each in others] == ["manus"]
    assert {*entry.nodes, "manus", "endpoint_state"} == {*WHOLE.nodes}
    assert bringup.own_words(entry) == ["--parts", ",".join(entry.nodes)]
    assert given(plan(shared=WHOLE, apart=["manus"]), "manus") == {}


def test_an_enclave_for_each_where_security_is_in_force(monkeypatch):
    monkeypatch.delenv("ROS_SECURITY_ENABLE", raising=False)
    entry = plan().entries[0]
    assert "--enclave" not in plan().arguments(entry)
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    assert plan().arguments(entry)[-2:] == ["--enclave", "/therapy_robot/sim_rig"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--foo"], "No such option: --foo"),
        (["foo"], "unexpected extra argument"),
        (["-p", "encodr:rate:=1.0"], "no node 'encodr'; there are amplifier"),
        (["-p", "rate"], "NODE:NAME:=VALUE is wanted"),
        (["--first-port", "5000"], "No such option: --first-port"),
        (["--params", "/nonexistent.yaml"], "/nonexistent.yaml"),
        (["--without", "encodr"], "no node 'encodr'"),
        (["--only", "encoder", "--without", "encoder"], "no node to start"),
        (["--only", "sim_rig", "--hardware"], "no node to start (hardware has no sim_rig)"),
        (["--composed", "--one-process"], "--composed and --one-process: one of them"),
        (["--one-process", "--hardware"], "whole: the whole robot in one process is for simulated"),
        (["--one-process", "--wall-clock"], "whole: the whole robot in one process is for simul"),
        (["--one-process", "--apart", "encoder"],
         "encoder cannot leave the process whole: only supervisor, manus, endpoint_state, sess"),
        (["--one-process", "--apart", "nobody"], "nobody cannot leave the process whole: only s"),
        (["--one-process", "--without", "sim_rig"], "sim_rig cannot leave the process whole"),
        (["--apart", "manus"], "manus: the nodes are apart already"),
        (["--composed", "--apart", "encoder"], "none of its nodes can"),
    ],
)
def test_bringup_refuses_in_a_sentence(monkeypatch, words, told):
    """Nothing is started."""
    monkeypatch.setattr(bringup, "Process", None)
    done = CliRunner().invoke(bringup.command, words)
    assert done.exit_code in (1, 2)
    assert told in done.output


def test_the_old_word_for_the_real_robot_answers_with_the_new_one(monkeypatch):
    monkeypatch.setattr(bringup, "Process", None)
    done = CliRunner().invoke(bringup.command, ["--bench"])
    assert done.exit_code == 2
    assert done.output.splitlines() == [
        "Error: --bench is --hardware now: the real robot, with params/hardware.yaml (make bench "
        "tells how fast it runs)"
    ]
    assert "--bench" not in CliRunner().invoke(bringup.command, ["--help"]).output


@pytest.fixture
def unprepared(monkeypatch):
    """Return a process that has no handlers for signals, as a node that still imports."""
    monkeypatch.setattr(bringup, "executable_path", lambda name: name)
    process = bringup.Process("sleep", ["600"])
    yield process
    process.stop()


def test_a_node_that_is_stopped_while_it_starts_has_not_failed(unprepared):
    assert unprepared.stop() == 0


def test_a_node_that_somebody_else_ended_has_failed(unprepared, wait_until):
    os.kill(unprepared.pid, signal.SIGTERM)
    wait_until(lambda: unprepared.exit_code() is not None)
    assert unprepared.stop() == -signal.SIGTERM


def test_a_patient_holds_the_handle_of_the_simulated_rig_alone():
    assert given(plan(patient="weak"), "sim_rig")["patient"] == "weak"
    assert "patient" not in given(plan(), "sim_rig")
    with pytest.raises(ValueError, match="the real robot has no simulated one"):
        plan(simulation=False, patient="weak")
    with pytest.raises(ValueError, match="there are healthy, weak, tremor, flaccid"):
        plan(patient="lazy")
