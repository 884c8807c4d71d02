# SPDX-License-Identifier: Apache-2.0
"""The vertical laws of this package, and those of others: the one list that all others come from.

Modes 1 to 99 are for laws of this package, 100 to 199 for laws of others. Mode 0 is OFF, mode 6 the
excitation of a trial, which is no law.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from importlib.metadata import entry_points
from typing import Any

from ...settings import SettingError
from ..law import Law, Variant
from ..modes import EXCITATION, OFF
from .thesis import THESIS

LAWS: tuple[Law, ...] = (THESIS,)
FIRST, LAST = 100, 199
"""Modes of laws from outside this package."""
GROUP = "screw_module_ros.laws"
"""Entry points that name laws of other packages."""
MOST_SHOWN = 8
"""Numbers of its own that a law may publish."""


def variants(laws: Iterable[Law] = LAWS) -> dict[int, Variant]:
    """Return all modes of the laws."""
    return {mode: variant for law in laws for mode, variant in law.variants.items()}


def names(laws: Iterable[Law] = LAWS) -> dict[int, str]:
    """Return the names of the modes that are laws, OFF among them."""
    return {OFF: "OFF", **{mode: variant.name for mode, variant in variants(laws).items()}}


def all_names(laws: Iterable[Law] = LAWS) -> dict[int, str]:
    """Return the names of all modes: with the sine of a trial, which is no law."""
    return {**names(laws), EXCITATION: "EXCITATION"}


def law_of(mode: int, laws: Iterable[Law] = LAWS) -> Law | None:
    """Return the law of a mode, None where it has none."""
    return next((law for law in laws if mode in law.variants), None)


def gains_of(mode: int, laws: Iterable[Law] = LAWS) -> tuple[str, ...]:
    """Return the settings with which a mode feeds the handle's force back."""
    variant = variants(laws).get(mode)
    return variant.gains if variant else ()


def load(path: str) -> Law:
    """Return the law `package.module:NAME`, or of an entry point of that name.

    Raises SettingError when there is none, or when it is not one that others may bring: see `flaw`.
    """
    named = [point for point in entry_points(group=GROUP) if point.name == path]
    where = named[0].value if named else path
    module, colon, name = where.partition(":")
    if not colon:
        known = ", ".join(sorted(point.name for point in entry_points(group=GROUP))) or "none"
        raise SettingError(
            f"law {path}: neither package.module:NAME nor an entry point of {GROUP}; there: {known}"
        )
    try:
        law = getattr(importlib.import_module(module), name)
    except Exception as error:  # the module is somebody else's: anything may come out of it
        raise SettingError(f"law {path}: {type(error).__name__}: {error}") from None
    if not isinstance(law, Law):
        raise SettingError(f"law {path}: {where} is no screw_module_ros.control.law.Law")
    if wrong := flaw(law):
        raise SettingError(f"law {path}: {wrong}")
    return law


def loaded(paths: Iterable[str]) -> tuple[Law, ...]:
    """Return this package's laws and those of the paths. Raises SettingError, also for a clash."""
    laws = LAWS
    for path in filter(None, paths):
        law = load(path)
        for other in laws:
            if law.name == other.name:
                raise SettingError(f"law {path}: another one is called {law.name} too")
            if both := sorted(law.variants.keys() & other.variants.keys()):
                raise SettingError(
                    f"law {path}: mode {both[0]} is {other.name}'s: choose another number"
                )
        laws = (*laws, law)
    return laws


def refused(law: Law, settings: Any, mode: int) -> str:
    """Return why settings do not go with a mode of a law, empty if they do."""
    try:
        return law.refusal(settings, mode)
    except Exception as error:  # the law may be somebody else's: anything may come out of it
        return f"law {law.name}: refusal: {type(error).__name__}: {error}"


def flaw(law: Law) -> str:
    """Return why a law of others cannot be taken, empty if it can."""
    if not law.name.isidentifier():
        return f"its name, {law.name!r}, is also the prefix of its parameters: use letters"
    modes = sorted(law.variants)
    if not modes or not all(FIRST <= mode <= LAST for mode in modes):
        return f"its modes are {modes}: those of other packages are {FIRST} to {LAST}"
    if modes != list(range(modes[0], modes[-1] + 1)):
        return f"its modes are {modes}: they must follow each other"
    if law.heeds:
        return "it heeds the guard by itself: the envelope does that for laws of other packages"
    if not hasattr(law.settings, "_fields"):
        return "its settings are no NamedTuple"
    if bare := sorted(set(law.settings._fields) - set(law.settings._field_defaults)):
        return f"its setting {bare[0]} has no default"
    if len(law.shown) > MOST_SHOWN:
        return f"it shows {len(law.shown)} numbers: {MOST_SHOWN} at most are published"
    gains = {gain for variant in law.variants.values() for gain in variant.gains}
    if unknown := sorted(gains - set(law.settings._fields)):
        return f"its gain {unknown[0]} is none of its settings"
    return ""
