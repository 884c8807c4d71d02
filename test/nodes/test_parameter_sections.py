# SPDX-License-Identifier: Apache-2.0
"""What a parameter file says to whom, and what in it nobody would read."""

from __future__ import annotations

import pytest

from screw_module_ros.nodes.support.parameter_files import (
    matches,
    notices,
    read_file,
    strangers,
)
from screw_module_ros.nodes.support.parameters import ParameterError

NODES = ("encoder", "amplifier")


@pytest.fixture
def file(tmp_path):
    """Return a maker of parameter files from text."""

    def make(text: str):
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        return read_file(str(path))

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


def test_a_file_with_nothing_for_the_node_is_named_with_the_way_out(file):
    given = file("encoder:\n  ros__parameters: {rate: 1.0}\n")
    assert notices([given], "/encoder") == []
    (told,) = notices([given], "/left/encoder")
    assert "has no parameters for /left/encoder" in told
    assert "write /**/encoder: in place of encoder:" in told


def test_a_section_for_all_is_not_the_node_s_own(file):
    given = file("/**:\n  ros__parameters: {use_sim_time: true}\n")
    assert len(notices([given], "/encoder")) == 1


def test_nested_namespaces_are_followed(file):
    given = file("left:\n  encoder:\n    ros__parameters:\n      can: {port: 5}\n")
    assert given.own("/left/encoder") == ["/left/encoder"]
    assert notices([given], "/left/encoder") == []


def test_what_only_a_section_for_all_gives(file):
    given = file(
        "/**:\n  ros__parameters:\n    lead: 0.02\n    can: {port: 5}\n    rate: 1.0\n"
        "/**/encoder:\n  ros__parameters: {rate: 2.0}\n"
    )
    assert given.shared("/encoder") == {"lead", "can.port"}


def test_a_misspelt_node_is_told_with_the_right_one(file):
    given = file(
        "/**/encodr:\n  ros__parameters: {rate: 1.0}\n"
        "/**/amplifier:\n  ros__parameters: {rate: 1.0}\n"
        "camera:\n  ros__parameters: {rate: 1.0}\n"
    )
    first, second = strangers(given, NODES)
    assert "/**/encodr: is no node of this robot; /**/encoder: is" in first
    assert "camera: is no node of this robot; there are encoder, amplifier" in second
    assert len(strangers(given, (*NODES, "camera"), "left")) == 2  # camera: is for /camera alone


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a: [", "is no YAML"),
        ("", "it has no `ros__parameters:`"),
        ("encoder: {rate: 1.0}", "no `ros__parameters:`"),
        ("ros__parameters: {rate: 1.0}", "outside of any node"),
        ("encoder: {ros__parameters: 5}", "has no values"),
        ("'': {ros__parameters: {rate: 1.0}}", "a section in / has no name"),
        ("/: {ros__parameters: {rate: 1.0}}", "a section in / has no name"),
        ("left: {'': {ros__parameters: {rate: 1.0}}}", "a section in /left has no name"),
        ("encoder: {ros__parameters: {'': 1.0}}", "a parameter in /encoder has no name"),
        ("encoder: {ros__parameters: {can: {'': 1}}}", "a parameter in /encoder has no name"),
    ],
)
def test_a_file_that_is_none_is_refused_by_name(file, text, told):
    with pytest.raises(ParameterError, match="mine.yaml") as caught:
        file(text)
    assert told in str(caught.value)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(ParameterError, match="nothing.yaml cannot be read: No such file"):
        read_file(str(tmp_path / "nothing.yaml"))
