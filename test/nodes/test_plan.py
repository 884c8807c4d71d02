# SPDX-License-Identifier: Apache-2.0
"""One plan for bringup and the launch file: what is started, with which arguments, what is told."""

from __future__ import annotations

import os
import signal

import pytest
from click.testing import CliRunner

from screw_module_ros.nodes import bringup
from screw_module_ros.nodes.bringup import plan
from screw_module_ros.nodes.support.arguments import arguments, overrides
from screw_module_ros.settings import SettingError


def given(planned, node: str) -> dict:
    """Return what the planned command line sets for a node."""
    said = arguments(["--ros-args", *planned.common])
    return {parameter.name: parameter.value for parameter in overrides(node, said.rules)}


def test_a_file_that_is_not_there_starts_nothing():
    with pytest.raises(SettingError, match="/nonexistent.yaml"):
        plan(params="/nonexistent.yaml")


def test_the_packaged_files_have_no_section_that_nobody_reads():
    for simulation in (True, False):
        for composed in (True, False):
            assert plan(simulation, composed=composed, namespace="left").warnings == []


@pytest.mark.parametrize("namespace", ["left", "/left", "/left/"])
def test_one_way_to_write_a_namespace(namespace):
    assert plan(namespace=namespace).namespace == "/left"
    assert plan(namespace="/").namespace == ""


@pytest.mark.parametrize("composed", [False, True])
def test_the_rig_has_the_latency_of_the_processes(composed):
    rig = given(plan(namespace="left", composed=composed), "sim_rig")
    assert rig["devices.command_latency"] == (0.3e-3 if composed else 0.6e-3)


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
        (["--only", "sim_rig", "--bench"], "no node to start (hardware has no sim_rig)"),
    ],
)
def test_bringup_refuses_in_a_sentence(monkeypatch, words, told):
    """Nothing is started."""
    monkeypatch.setattr(bringup, "Process", None)
    done = CliRunner().invoke(bringup.command, words)
    assert done.exit_code in (1, 2)
    assert told in done.output


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
