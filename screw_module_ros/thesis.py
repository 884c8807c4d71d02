# SPDX-License-Identifier: Apache-2.0
"""Figures of the thesis by key: what `params/thesis.yaml` holds.

Code, parameters and comments name a figure by its key, so that value, unit and section stand once.
A comment that gives a default its source is one of five words and a colon, after the unit:

    thesis: KEY          the figure of this key; `KEY[0]` for the first of a list, `KEY / 2` or
                         `KEY x 2` for a part or a multiple
    ours: REASON         chosen, assumed or derived by this project
    work: KEY            from a published work; KEY stands in docs/references.md
    public program: KEY  from a program that is public; KEY stands in docs/references.md
    unsourced            nobody knows where the number is from

`test/test_thesis_facts.py` reads these comments and holds each value to its figure.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from .resources import resource_path
from .settings import SettingError
from .settings_file import load

FACTS_FILE = "params/thesis.yaml"
KINDS = (
    "requirement", "estimate", "data sheet", "measured", "fitted", "chosen", "simulated",
    "literature", "statement", "built",
)  # fmt: skip
"""Kinds of figures; `params/thesis.yaml` says at its head what they mean."""
_SI = {"mm": (1e-3, "m"), "mm/s": (1e-3, "m/s"), "kgf": (9.80665, "N"), "1/mm": (1e3, "1/m")}
_FIELDS = {"value", "unit", "where", "kind", "quantity"}


class Fact(NamedTuple):
    """One figure.

    value: a number, a list of numbers, text or a truth value; unit: as in the file, empty for none;
    where: section, table or equation of the thesis; kind: one of `KINDS`; quantity: what it is.
    """

    value: Any
    unit: str
    where: str
    kind: str
    quantity: str


def unit_of(text: str) -> str:
    """Return a unit in one spelling: `N s/m` and `Ns/m`, `kg m^2` and `kg m2` are the same."""
    return text.replace(" ", "").replace("^", "")


def in_unit(value: float, unit: str, wanted: str) -> float:
    """Return a value of a unit in another one. Raises SettingError when none leads to the other."""
    if unit_of(unit) == unit_of(wanted):
        return value
    own, own_si = _SI.get(unit, (1.0, unit))
    other, other_si = _SI.get(wanted, (1.0, wanted))
    if unit_of(own_si) != unit_of(other_si):
        raise SettingError(f"a value in {unit or '1'} cannot be given in {wanted or '1'}")
    return value * own / other


def facts_of(content: Any, where: str) -> dict[str, Fact]:
    """Return the figures of a mapping of keys to fields; fields of other names are left out.

    where: its name in messages. Raises SettingError naming the key and what is wrong with it.
    """
    if not isinstance(content, Mapping):
        raise SettingError(f"{where}: a mapping of keys to facts is wanted")
    found = {}
    for key, fields in content.items():
        if not isinstance(fields, Mapping) or not fields.keys() >= _FIELDS:
            lacking = _FIELDS - set(fields if isinstance(fields, Mapping) else ())
            raise SettingError(f"{where}: {key} lacks {', '.join(sorted(lacking))}")
        if fields["kind"] not in KINDS:
            kinds = ", ".join(KINDS)
            raise SettingError(f"{where}: {key}: kind = {fields['kind']!r}: one of {kinds}")
        found[str(key)] = Fact(**{name: fields[name] for name in Fact._fields})
    return found


@cache
def facts(path: str | Path | None = None) -> dict[str, Fact]:
    """Return all figures by key; path: None = the file of the package. Raises SettingError."""
    file = Path(path) if path else resource_path(FACTS_FILE)
    return facts_of(load(file), str(file))


def fact(key: str) -> Fact:
    """Return the figure of a key. Raises SettingError naming a key that is near."""
    known = facts()
    if key not in known:
        near = difflib.get_close_matches(key, known, 1)
        hint = f"; {near[0]} is there" if near else ""
        raise SettingError(f"{FACTS_FILE} has no key {key!r}{hint}")
    return known[key]


def figure(key: str, part: int | None = None, unit: str = "") -> float:
    """Return one number of the thesis; part: which one of a list; unit: wanted, empty = its own.

    Raises SettingError for an unknown key, a figure without such a number, another kind of unit.
    """
    found = fact(key)
    value = found.value
    if part is not None:
        if not isinstance(value, list) or not 0 <= part < len(value):
            raise SettingError(f"{key} of {FACTS_FILE} has no number {part}")
        value = value[part]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SettingError(f"{key} = {value!r} of {FACTS_FILE} is not one number")
    return in_unit(float(value), found.unit, unit or found.unit)
