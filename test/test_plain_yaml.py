# SPDX-License-Identifier: Apache-2.0
"""YAML from others: what is taken, and that the rest costs nothing and is told in one sentence."""

from __future__ import annotations

import datetime
import math

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.plain_yaml import LARGEST, PlainYamlError, load_plain_yaml

LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{after}: &{after} [{', '.join([f'*{name}'] * 9)}]\n"
    for name, after in zip("abcdefgh", "bcdefghi", strict=True)
)
MERGES = "a: &a {x: 1}\n" + "".join(
    f"{after}: &{after} {{<<: [{', '.join([f'*{name}'] * 9)}]}}\n"
    for name, after in zip("abcdefgh", "bcdefghi", strict=True)
)


def test_mappings_lists_and_scalars_are_as_usual():
    text = "a: {b: [1, -2.5, 1.0e-5, .inf, text, 'q', true, null, 2001-05-11]}\n1: {}\n"
    found = load_plain_yaml(text)
    assert found["a"]["b"] == [
        1, -2.5, 1e-5, math.inf, "text", "q", True, None, datetime.date(2001, 5, 11)
    ]  # fmt: skip
    assert found[1] == {}
    assert load_plain_yaml("") is None


plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=20,
)


@given(plain)
def test_what_safe_yaml_writes_is_read_back(value):
    text = yaml.dump(value, Dumper=NoAliases)
    assert load_plain_yaml(text) == yaml.safe_load(text)


class NoAliases(yaml.SafeDumper):
    def ignore_aliases(self, data):
        return True


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (LAUGHS, r"alias \*a: write it out in line 2"),
        (MERGES, r"alias \*a: write it out in line 2"),
        ("&a [*a]", "alias"),
        ("speed: {<<: {x: 1}}", "speed: key << is not taken in line 1"),
        ("speed: !!python/object/apply:os.system ['true']", "speed: tag .*python/object.*"),
        ("speed: !!binary aGFsbG8=", "speed: tag"),
        ("speed: !!set {a}", "speed: tag"),
        ("a: {b: [0, 1" + "0" * 5000 + "]}", r"a\.b\[1\]: a number of 5001 characters in line 1"),
        ("a: " + "1:" * 4000 + "1", r"a: a number of 8001 characters"),
        ("a: 2001-99-99", "a: '2001-99-99' is no timestamp"),
        ("a: 1\na: 2", "key 'a' is written twice in line 2"),
        ("[1, 2]: 3", "key that is no name is not taken"),
        ("[" * 100_000, "nested too deeply"),
        ("a: [", "line 1"),
        ("a: \x00", "character"),
        ("x" * (LARGEST + 1), "longer than"),
        ("- &" + "x" * 5000 + " 1\n- *" + "x" * 5000, "alias"),
        ("k" * 900 + ": {" + "q" * 900 + ": !!foo 1}", "tag"),
    ],
)
@pytest.mark.timeout(20)
def test_what_goes_beyond_is_refused_in_a_short_sentence(text, told):
    with pytest.raises(PlainYamlError, match=told) as raised:
        load_plain_yaml(text)
    assert len(str(raised.value)) < 400
    assert "\n" not in str(raised.value)


def test_aliases_where_they_are_wanted():
    text = "a: &a {x: [1, 2]}\nb: *a\nc: [*a, *a]\n"
    assert load_plain_yaml(text, aliases=True) == {
        "a": {"x": [1, 2]}, "b": {"x": [1, 2]}, "c": [{"x": [1, 2]}] * 2
    }  # fmt: skip


@pytest.mark.parametrize("text", [LAUGHS, MERGES, "a: &a [*a]", "&a {b: *a}", "a: *nobody"])
def test_aliases_cost_no_more_than_what_they_stand_for(text):
    with pytest.raises(PlainYamlError) as refused:
        load_plain_yaml(text, aliases=True)
    assert len(str(refused.value)) < 400
