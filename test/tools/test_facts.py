# SPDX-License-Identifier: Apache-2.0
"""The comparison of the figures with another list of facts and with a text."""

from __future__ import annotations

import copy

import pytest
import yaml

import facts
from screw_module_ros import thesis

OURS = {
    "length": thesis.Fact(0.5, "m", "1.1", "built", "of a stick"),
    "spring": thesis.Fact([10.0, 20.0], "N s/m", "1.2", "chosen", "damper of the stick"),
    "law": thesis.Fact("F = k x", "", "1.3", "statement", "of the stick"),
    "straight": thesis.Fact(True, "", "1.4", "statement", "the stick is"),
}
TEXT = "A stick.\nIt is half a metre long\nbetween ten and twenty\nF = k x, and straight\n"
THEIRS = {
    "length": {"value": 0.5, "unit": "m", "where": "1.1", "line": 2, "quote": "half a metre"},
    "spring": {"value": [10, 20], "unit": "Ns/m", "where": "1.2", "quote": "ten and twenty"},
    "law": {"value": "F = k x", "unit": "", "where": "1.3", "line": 4, "quote": "F = k x"},
    "straight": {"value": True, "unit": "", "where": "1.4", "line": 4, "quote": "straight"},
}


def changed(key, field, value):
    theirs = copy.deepcopy(THEIRS)
    if field is None:
        theirs[key] = value
    elif value is None:
        del theirs[key][field]
    else:
        theirs[key][field] = value
    return list(facts.differences(OURS, theirs, TEXT))


def test_equal_lists_have_no_differences():
    assert list(facts.differences(OURS, THEIRS, TEXT)) == []
    assert changed("length", "value", "5e-1") == []  # as YAML reads a number without a point


@pytest.mark.parametrize(
    ("key", "field", "value", "said"),
    [
        ("length", "value", 0.51, "length: value = 0.5 in params/thesis.yaml, 0.51 in the list"),
        ("length", "value", True, "length: value = 0.5 "),
        ("length", "value", "long", "length: value = 0.5 "),
        ("spring", "value", [10.0], "spring: value = [10.0, 20.0] "),
        ("spring", "value", [10.0, 21.0], "spring: value = "),
        ("law", "value", "F = 2 k x", "law: value = 'F = k x' "),
        ("straight", "value", 1, "straight: value = True "),
        ("length", "unit", "mm", "length: unit = 'm' in params/thesis.yaml, 'mm' in the list"),
        ("length", "where", "1.2", "length: where = '1.1' in params/thesis.yaml, '1.2'"),
        ("length", "quote", "a whole metre", "length: the text has no 'a whole metre'"),
        ("length", "quote", None, "length of the list of facts has no quote"),
        ("length", "line", 3, "length: the text has 'half a metre' in line 2, not in line 3"),
        ("length", None, 0.5, "length of the list of facts has no fields"),
    ],
)
def test_each_difference_is_a_sentence(key, field, value, said):
    (found,) = changed(key, field, value)
    assert found.startswith(said)


def test_what_is_in_one_list_alone_is_told():
    less = {key: value for key, value in THEIRS.items() if key != "law"}
    assert list(facts.differences(OURS, less, TEXT)) == ["law is in params/thesis.yaml alone"]
    more = THEIRS | {"weight": THEIRS["length"]}
    assert list(facts.differences(OURS, more, TEXT)) == ["weight is not in params/thesis.yaml"]
    assert list(facts.differences(OURS, [1], TEXT)) == [
        "the list of facts is no mapping of keys to facts"
    ]


def test_the_command_tells_by_its_code(tmp_path, capsys):
    """Against the repository's own figures, with quotes of ours."""
    text, listed = tmp_path / "text.txt", tmp_path / "facts.yaml"
    own = {
        key: {**fact._asdict(), "quote": f"words on {key}."} for key, fact in thesis.facts().items()
    }
    text.write_text("\n".join(entry["quote"] for entry in own.values()), encoding="utf-8")
    listed.write_text(yaml.safe_dump(own), encoding="utf-8")
    assert facts.main([str(listed), str(text)]) == 0
    assert f"{len(own)} figures agree" in capsys.readouterr().out
    own["lead"]["value"] = 0.02
    listed.write_text(yaml.safe_dump(own), encoding="utf-8")
    assert facts.main([str(listed), str(text)]) == 1
    assert capsys.readouterr().out.startswith("lead: value = 0.01905 ")


def test_without_arguments_nothing_fails(capsys):
    assert facts.main([]) == 0
    assert "To compare them: tools/facts.py FACTS TEXT" in capsys.readouterr().out


def test_misuse_is_told(tmp_path, capsys):
    assert facts.main(["one"]) == 2
    assert "usage: tools/facts.py FACTS TEXT" in capsys.readouterr().err
    assert facts.main([str(tmp_path / "none.yaml"), str(tmp_path / "none.txt")]) == 2
    assert "none.yaml cannot be read" in capsys.readouterr().err
