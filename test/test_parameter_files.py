# SPDX-License-Identifier: Apache-2.0
"""Parameter files are read as ROS reads them, without it; rclpy itself is the reference here."""

from __future__ import annotations

import subprocess
import sys

import pytest
import rclpy
from rclpy.context import Context

from screw_module_ros.parameter_files import (
    above,
    matches,
    only_for_all,
    sections,
    unread_sections,
    values_of,
)
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


def as_rclpy_reads(path: str, namespace: str) -> dict:
    """Return the parameters that rclpy gives to a node `encoder`."""
    context = Context()
    place = ["-r", f"__ns:={namespace}"] if namespace else []
    context.init(args=["--ros-args", "--params-file", path, *place])
    try:
        node = rclpy.create_node(
            "encoder", context=context, automatically_declare_parameters_from_overrides=True
        )
        found = {name: p.value for name, p in node.get_parameters_by_prefix("").items()}
        node.destroy_node()
    finally:
        context.try_shutdown()
    own = {"use_sim_time", "start_type_description_service"}
    return {name: value for name, value in found.items() if name not in own}


SEVERAL = """
/**/encoder:
  ros__parameters: {rate: 1.0, can: {port: 5, name: a}, list: [1e-3, 2.0], quoted: "1e3"}
/**:
  ros__parameters: {rate: 2.0, can.name: b, small: 1e-3, large: 5E+2, hex: 0x10, octal: 010}
encoder:
  ros__parameters: {rate: 3.0, date: 2001-05-11, word: yes, empty: ""}
/left/encoder:
  ros__parameters: {rate: 4.0}
left:
  encoder:
    ros__parameters: {rate: 5.0, can: {bitrate: 500000}}
  "**":
    ros__parameters: {deep: 1}
/*/encoder:
  ros__parameters: {word: "no"}
/right/encoder:
  ros__parameters: {rate: 6.0}
/**/amplifier:
  ros__parameters: {rate: 7.0, more: 1}
"""


@pytest.mark.parametrize("namespace", ["", "/left", "/right", "/left/deeper", "/other"])
@pytest.mark.parametrize("turned", [False, True])
def test_a_node_gets_what_rclpy_gives_it(file, namespace, turned):
    """Sections in another order too: the later one overrides, whatever it is called."""
    parts = SEVERAL.strip().split("\n/")
    text = "\n".join(f"/{part}" for part in reversed([parts[0][1:], *parts[1:]]))
    path = file(text if turned else SEVERAL)
    wanted = as_rclpy_reads(path, namespace)
    assert wanted, "nothing is compared"
    assert values_of(sections(path), f"{namespace}/encoder") == wanted


def test_the_reader_needs_no_ros():
    code = (
        "import sys; from screw_module_ros import parameter_files; "
        "from screw_module_ros.hardware import command; sys.exit('rclpy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("written", "prefix"), [("", ""), ("/", ""), ("left", "/left"), ("/left/", "/left")]
)
def test_one_form_of_a_namespace(written, prefix):
    assert above(written) == prefix


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
    assert sections(path) == {"/left/encoder": {"can.port": 5}}


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


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(SettingError, match="nothing.yaml cannot be read: No such file"):
        sections(str(tmp_path / "nothing.yaml"))
