# SPDX-License-Identifier: Apache-2.0
"""What a parameter file says to whom, and what in it nobody would read."""

from __future__ import annotations

import pytest
import rclpy

from screw_module_ros.nodes.support.arguments import (
    Arguments,
    matches,
    only_for_all,
    sections,
    unread_sections,
)
from screw_module_ros.nodes.support.runtime import _begin
from screw_module_ros.settings import SettingError

NODES = ("encoder", "amplifier")


@pytest.fixture
def file(tmp_path):
    """Return a maker of parameter files from text; it returns the path."""

    def make(text: str) -> str:
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        return str(path)

    return make


@pytest.mark.parametrize(
    ("pattern", "node", "fits"),
    [
        ("/**", "/a/encoder", True),
        ("/**/encoder", "/encoder", True),
        ("/**/encoder", "/a/b/encoder", True),
        ("/**/encoder", "/a/encoder2", False),
        ("/encoder", "/left/encoder", False),
        ("/*/encoder", "/left/encoder", True),
        ("/*/encoder", "/encoder", False),
        ("/left/*", "/left/encoder", True),
    ],
)
def test_patterns(pattern, node, fits):
    assert matches(pattern, node) is fits


def test_nested_namespaces_are_followed(file):
    path = file("left:\n  encoder:\n    ros__parameters:\n      can: {port: 5}\n")
    assert sections(path) == {"/left/encoder": {"can.port"}}


def test_what_only_a_section_for_all_gives(file):
    path = file(
        "/**:\n  ros__parameters:\n    lead: 0.02\n    can: {port: 5}\n    rate: 1.0\n"
        "/**/encoder:\n  ros__parameters: {rate: 2.0}\n"
    )
    assert only_for_all([sections(path)], "/encoder") == {"lead", "can.port"}


def test_a_misspelt_node_is_told_with_the_right_one(file):
    path = file(
        "/**/encodr:\n  ros__parameters: {rate: 1.0}\n"
        "/**/amplifier:\n  ros__parameters: {rate: 1.0}\n"
        "camera:\n  ros__parameters: {rate: 1.0}\n"
    )
    first, second = unread_sections(path, NODES)
    assert "/**/encodr: is no node of this robot; /**/encoder: is" in first
    assert "camera: is no node of this robot; there are encoder, amplifier" in second
    more = (*NODES, "camera")
    assert len(unread_sections(path, more)) == 1
    assert len(unread_sections(path, more, "/left")) == 2  # camera: is for /camera alone


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


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(SettingError, match="nothing.yaml cannot be read: No such file"):
        sections(str(tmp_path / "nothing.yaml"))
