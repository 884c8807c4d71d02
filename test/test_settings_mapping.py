# SPDX-License-Identifier: Apache-2.0
"""Settings tuples from mappings: defaults, optional parts, lists of parts, and refusals by key."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import pytest

from screw_module_ros.settings import Setting
from screw_module_ros.settings_mapping import from_mapping


class Part(NamedTuple):
    """A part with a bound."""

    mass: Annotated[float, Setting("mass", "kg", 0.1, 10.0)]
    turns: int = 3


class Whole(NamedTuple):
    """What a file may hold."""

    name: str
    parts: tuple[Part, ...]
    centre: tuple[float, float]
    rest: tuple
    spare: Part | None = None


CONTENT = {"name": "arm", "parts": [{"mass": 2}], "centre": [0, 1.5], "rest": [1, 2, 3]}


def read(**changes) -> Whole:
    return from_mapping(Whole, CONTENT | changes, sizes={"rest": 3})


def test_defaults_and_whole_numbers_are_taken():
    found = read()
    assert found == Whole("arm", (Part(2.0, 3),), (0.0, 1.5), (1.0, 2.0, 3.0), None)
    assert type(found.parts[0].mass) is float
    assert read(spare={"mass": 1.0, "turns": 7}).spare == Part(1.0, 7)
    assert read(spare=None).spare is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"nmae": "x"}, "nmae is unknown; known are name, parts"),
        ({"parts": [{"mass": 2.0}, {"turns": 1}]}, "parts[1].mass is missing"),
        ({"parts": [{"mass": 20.0}]}, "parts[0].mass = 20.0 kg: above"),
        ({"parts": [{"mass": True}]}, "parts[0].mass = True: a number"),
        ({"parts": [{"mass": 10**400}]}, "parts[0].mass = "),
        ({"parts": [{"mass": math.nan}]}, "parts[0].mass = nan: a finite"),
        ({"parts": [{"mass": 1.0, "turns": 1.5}]}, "parts[0].turns = 1.5: int"),
        ({"parts": {}}, "parts: a list is wanted"),
        ({"parts": [7]}, "parts[0].: a mapping"),
        ({"centre": [1.0]}, "centre: a list of 2 numbers"),
        ({"rest": [1.0, "2", 3.0]}, "rest: a list of 3 numbers"),
        ({"spare": {"mass": 0.0}}, "spare.mass = 0.0 kg: below"),
    ],
)
def test_what_is_wrong_is_named(changes, words):
    with pytest.raises(ValueError) as caught:
        read(**changes)
    assert words in str(caught.value)


def test_the_whole_must_be_a_mapping():
    with pytest.raises(ValueError, match="the file: a mapping"):
        from_mapping(Whole, [1])
