# SPDX-License-Identifier: Apache-2.0
"""Definitions are gathered as rosbag2 does, with everything they depend on."""

import os

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from screw_module_ros.recording.definitions import DefinitionError, Definitions, fields

LINE = "=" * 80


def test_dependencies_follow_once_and_in_rosbag2s_form(definitions):
    found = definitions.find("screw_module_msgs/msg/EndpointState")
    parts = found.text.split(f"\n{LINE}\n")
    assert [part.split("\n", 1)[0] for part in parts[1:]] == [
        "MSG: geometry_msgs/Point",
        "MSG: geometry_msgs/Vector3",
        "MSG: std_msgs/Header",
        "MSG: builtin_interfaces/Time",
    ]
    assert found.encoding == "ros2msg"
    assert "bool vertical_locked" in parts[0]


def test_type_of_the_same_package_needs_no_prefix(tmp_path):
    folder = tmp_path / "own_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Outer.msg").write_text("# Inner in a comment\nInner[<=3] parts\nstring<=5 name\n")
    (folder / "Inner.msg").write_text("uint8 RED=1\nuint8 colour\n")
    text = Definitions({"own_msgs": folder.parent}).find("own_msgs/msg/Outer").text
    assert text.count("MSG: own_msgs/Inner\n") == 1
    assert text.endswith("uint8 RED=1\nuint8 colour\n")


@pytest.mark.parametrize("name", ["nowhere_msgs/msg/X", "screw_module_msgs/msg/X", "no type"])
def test_unknown_type_is_named(definitions, monkeypatch, name):
    monkeypatch.setenv("AMENT_PREFIX_PATH", "")
    with pytest.raises(DefinitionError, match=name):
        definitions.find(name)


def test_fields_leave_out_constants_and_comments():
    own = "uint8 OFF=0  # x\n# float64 no\nint32 a  # b\n\nstring<=4 c\n"
    text = f"{own}\n{LINE}\nMSG: x/Y\nint8 z"
    assert fields(text) == [("int32", "a"), ("string<=4", "c")]


@pytest.mark.skipif(not os.environ.get("AMENT_PREFIX_PATH"), reason="needs installed messages")
@pytest.mark.parametrize(
    "name",
    [
        "screw_module_msgs/msg/EncoderSample",
        "screw_module_msgs/msg/SafetyState",
        "sensor_msgs/msg/JointState",
        "rcl_interfaces/msg/ParameterEvent",
        "diagnostic_msgs/msg/DiagnosticArray",
        "lifecycle_msgs/msg/TransitionEvent",
    ],
)
def test_installed_hash_is_that_of_the_definition(name):
    found = Definitions().find(name)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(found.text, name))
    assert found.type_hash == store.hash_rihs01(name)
