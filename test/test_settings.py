# SPDX-License-Identifier: Apache-2.0
"""The one reader of settings: what is taken, and each mistake in a sentence that names its key."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.settings import Setting, SettingError, fields, plain, read, shown, validated
from screw_module_ros.settings_file import load, parse, read_file


class Part(NamedTuple):
    """A part with a bound."""

    mass: Annotated[float, Setting("mass", "kg", 0.1, 10.0)]
    turns: int = 3


class Whole(NamedTuple):
    """What a file may hold."""

    name: Annotated[str, Setting("name", choices=("arm", "leg"))]
    parts: tuple[Part, ...]
    centre: tuple[float, float]
    rest: Annotated[tuple[float, float, float], Setting("rest", "m", 0.0, 5.0)]
    spare: Part | None = None
    notes: dict[str, float] = {}

    def flaw(self) -> str:
        """Return what does not fit together."""
        return "" if self.centre[0] <= self.centre[1] else "centre: must rise"


CONTENT = {"name": "arm", "parts": [{"mass": 2}], "centre": [0, 1.5], "rest": [1, 2, 3]}
RECORD = Whole("arm", (Part(2.0, 3),), (0.0, 1.5), (1.0, 2.0, 3.0), None)


def taken(**changes) -> Whole:
    return read(Whole, CONTENT | changes)


def test_defaults_and_whole_numbers_are_taken():
    found = taken()
    assert found == RECORD
    assert type(found.parts[0].mass) is float
    assert taken(spare={"mass": 1.0, "turns": 7}).spare == Part(1.0, 7)
    assert taken(spare=None).spare is None
    assert taken(notes={"a": 1}).notes == {"a": 1.0}


def test_what_is_written_plainly_is_read_back():
    assert read(Whole, plain(RECORD)) == RECORD
    assert fields(Whole)["rest"].setting.unit == "m"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"nmae": "x"}, "nmae is unknown; known are name, parts"),
        ({"parts": [{"mass": 2.0}, {"turns": 1}]}, "parts[1].mass is missing"),
        ({"parts": [{"mass": 20.0}]}, "parts[0].mass = 20.0 kg: above the largest allowed, 10 kg"),
        ({"parts": [{"mass": True}]}, "parts[0].mass = True: a finite number"),
        ({"parts": [{"mass": "1e-4"}]}, "parts[0].mass = '1e-4': a finite number is wanted (write"),
        ({"parts": [{"mass": 10**400}]}, "parts[0].mass = 1000"),
        ({"parts": [{"mass": math.nan}]}, "parts[0].mass = nan: a finite"),
        ({"parts": [{"mass": 1.0, "turns": 1.5}]}, "parts[0].turns = 1.5: int is wanted"),
        ({"parts": {}}, "parts = {}: a list is wanted"),
        ({"parts": [7]}, "parts[0] = 7: a mapping"),
        ({"centre": [1.0]}, "centre = [1.0]: a list of 2"),
        ({"centre": [1.0, math.inf]}, "centre[1] = inf: a finite"),
        ({"centre": [1.0, 0.0]}, "centre: must rise"),
        ({"rest": [1.0, "2", 3.0]}, "rest[1] = '2': a finite number"),
        ({"rest": [1.0, 2.0, 6.0]}, "rest[2] = 6.0 m: above"),
        ({"spare": {"mass": 0.0}}, "spare.mass = 0.0 kg: below"),
        ({"name": "head"}, "name = 'head': one of 'arm', 'leg'"),
        ({"name": None}, "name = None: str is wanted"),
        ({"notes": {"a": "b"}}, "notes.a = 'b': a finite number"),
        ({"notes": [1.0]}, "notes = [1.0]: dict is wanted"),
    ],
)
def test_what_is_wrong_is_named(changes, words):
    with pytest.raises(SettingError) as caught:
        taken(**changes)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("record", "words"),
    [
        (RECORD._replace(parts=(Part(1.0), Part(0.0))), r"Whole: parts\[1\].mass = 0.0 kg: below"),
        (RECORD._replace(spare=Part(math.nan)), "Whole: spare.mass = nan"),
        (RECORD._replace(centre=(1.0, 0.0)), "Whole: centre: must rise"),
    ],
)
def test_a_record_is_checked_to_its_last_part(record, words):
    assert validated(RECORD) is RECORD
    with pytest.raises(SettingError, match=words):
        validated(record)


def test_the_whole_must_be_a_mapping():
    with pytest.raises(SettingError, match=r"\[1\]: a mapping of names to values"):
        read(Whole, [1])


@pytest.mark.parametrize("value", [1, -2.5, math.nan, "text", True, None, {"a": (1.0,)}, b"raw"])
def test_short_values_are_shown_as_repr_has_them_and_long_ones_cut(value):
    assert shown(value) == repr(value)
    assert len(shown([value] * 200)) == 80


# Texts and files -----------------------------------------------------------------------------


def test_mappings_lists_and_scalars_are_as_usual():
    text = "a: &a {b: [1, -2.5, 1.0e-5, .inf, text, 'q', true, null, 2001-05-11]}\nc: *a\n"
    found = parse(text, "it")
    assert found["a"]["b"] == [
        1, -2.5, 1e-5, math.inf, "text", "q", True, None, "2001-05-11"
    ]  # fmt: skip
    assert found["c"] == found["a"]
    assert parse("", "it") is None


def test_a_digest_of_digits_and_one_e_stays_text_but_ros_takes_it_for_a_number():
    text = "[1e3, 12345e67, '1e3']"
    assert parse(text, "it") == ["1e3", "12345e67", "1e3"]
    assert parse(text, "it", for_ros=True) == [1000.0, 12345e67, "1e3"]


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=20,
)


@given(values)
def test_what_safe_yaml_writes_is_read_back(value):
    assert parse(yaml.safe_dump(value), "it") == value


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: 1\nb: 2\na: 2", "it is no YAML: key 'a' is written twice in line 3"),
        ("a: {b: 1, b: 2}", "key 'b' is written twice in line 1"),
        ("a: [1,\nb: 2", "in line 2"),
        ("a:\n\t- 1", "in line 2"),
        ("a: !!python/object/apply:os.getcwd []", "python/object"),
        ("a: *nobody", "undefined alias"),
        ("a: 1" + "0" * 5000, "it is no YAML"),
        ("a: \x00", "it is no YAML"),
    ],
)
def test_what_is_no_yaml_is_told_with_its_line(text, words):
    with pytest.raises(SettingError) as caught:
        parse(text, "it")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


GOOD = yaml.safe_dump({"format": "a/whole", "version": 1, **CONTENT}, sort_keys=False).encode()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ": None: a mapping of names"),
        (GOOD[: GOOD.index(b"rest")], ": rest is missing"),
        (GOOD.replace(b"1.5", b"'1.5"), " is no YAML: "),
        (GOOD.replace(b"version: 1", b"version: 2"), "version = 2: 'a/whole' and 1 are wanted"),
        (GOOD.replace(b"version: 1", b"version: true"), "version = True: 'a/whole' and 1 are"),
        (GOOD.replace(b"a/whole", b"a/half"), "format = 'a/half'"),
        (GOOD.replace(b"version: 1\n", b""), "version = None"),
        (GOOD + b"mass: 1\n", ": mass is unknown"),
        (GOOD + b"name: arm\n", "key 'name' is written twice in line"),
        (b"\xff\xfe" + GOOD, " cannot be read: 'utf-8' codec"),
    ],
)
def test_a_wrong_file_is_named(tmp_path, content, words):
    path = tmp_path / "whole.yaml"
    path.write_bytes(GOOD)
    assert read_file(path, Whole, "a/whole") == RECORD
    path.write_bytes(content)
    with pytest.raises(SettingError) as caught:
        read_file(path, Whole, "a/whole")
    assert str(caught.value).startswith(str(path))
    assert words in str(caught.value)


@pytest.mark.parametrize("name", ["nothing.yaml", ".", "\0"])
def test_what_cannot_be_read_is_named(tmp_path, name):
    with pytest.raises(SettingError, match="cannot be read: .+"):
        load(tmp_path / name)
