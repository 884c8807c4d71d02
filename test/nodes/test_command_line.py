# SPDX-License-Identifier: Apache-2.0
"""-p NODE:NAME:=VALUE in any namespace, and above every file."""

from __future__ import annotations

import pytest

from screw_module_ros.nodes.support.arguments import Arguments, Rule, arguments, overrides
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


def test_a_rule_for_the_node_wins_over_one_for_all():
    assert values("n", "-p", "n:x:=1", "-p", "x:=2", "-p", "m:x:=3") == {"x": 1}


@pytest.mark.parametrize(
    ("text", "value"),
    [("5e2", 500.0), ("1e-3", 0.001), ("[1e-3, 2.0]", [0.001, 2.0]), ("true", True), ("", ""),
     ("soft", "soft"), ("2001-05-11", "2001-05-11"), ('"7"', "7")],
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
