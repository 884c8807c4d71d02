# SPDX-License-Identifier: Apache-2.0
"""The vertical laws of this package, and those of others: the one list that all others come from.

Modes 1 to 99 are for laws of this package, 100 to 199 for laws of others. Mode 0 is OFF, mode 6 the
excitation of a trial, which is no law.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ... import plugin_flaws, plugins
from ...settings import SettingError, fields
from ..friction import FrictionModel
from ..law import LINEAR, Law, Margin, Robot, Variant
from ..modes import EXCITATION, OFF
from ..vertical_settings import ESTIMATING, VerticalSettings
from .rehearsal import flaw_of_calls
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


def modes_of_gains(law: Law) -> dict[str, int]:
    """Return the gains of a law, each with the first mode that has it."""
    found: dict[str, int] = {}
    for mode, variant in law.variants.items():
        for gain in variant.gains:
            found.setdefault(gain, mode)
    return found


def margin_of(law: Law, gain: str) -> Margin:
    """Return what the largest stable value of a gain depends on."""
    for margin in law.margins:
        if margin.gain == gain:
            return margin
    own = tuple(name for name in law.settings._fields if name not in modes_of_gains(law))
    every = ("rate", *ESTIMATING, *(name for name in own if name not in ESTIMATING))
    return Margin(gain, f"{law.name}_{gain}", every, every)


def parameter_of(law: Law, setting: str) -> str:
    """Return the name of the parameter for a setting that a law names: its own ones come first."""
    own = law.settings is not VerticalSettings and setting in law.settings._fields
    return f"{law.name}.{setting}" if own else setting


def settings_of(law: Any, p: Any, chosen: Any = None) -> Any:
    """Return the settings of a law: the envelope's, `p`, are those of this package's laws too.

    law: of the plane too, with its `PlanarSettings`; chosen: of a law of others, None = its
    defaults.
    """
    if law.settings is type(p):
        return p
    return law.settings() if chosen is None else chosen


def own_of(law: Law, p: VerticalSettings, friction: FrictionModel, chosen: Any = None) -> Any:
    """Return what a law's functions get; p: settings of the envelope; chosen: see `settings_of`."""
    return law.own(settings_of(law, p, chosen), Robot(friction, p.mass, p.gravity))


def load(path: str) -> Law:
    """Return the law `package.module:NAME`, or of an entry point of that name.

    Raises SettingError when there is none, or when it is not one that others may bring: see `flaw`
    and `flaw_of_calls`, which calls its functions.
    """
    law = plugins.load(path, GROUP, "law")
    return plugin_flaws.taken(law, f"law {path}", Law, flaw, flaw_of_calls)


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
            called = {variant.name for variant in other.variants.values()}
            if same := sorted(called & {variant.name for variant in law.variants.values()}):
                raise SettingError(f"law {path}: {other.name} has a mode {same[0]} too: rename it")
            if same := sorted(_names_in_results(law) & _names_in_results(other)):
                raise SettingError(
                    f"law {path}: its gain in results, {same[0]}, is {other.name}'s: choose "
                    "another name"
                )
        laws = (*laws, law)
    return laws


def _names_in_results(law: Law) -> set[str]:
    """Return the names that the largest stable gains of a law have: of one law alone each."""
    return {margin_of(law, gain).name for gain in modes_of_gains(law)} if law.judged else set()


def refusal(law: Any, settings: Any, *mode: int) -> str:
    """Return why settings do not go with a mode of a law, empty if they do.

    law: of the plane too, which has no modes.
    """
    try:
        said = law.refusal(settings, *mode)
        if said is None or isinstance(said, str):
            return plugins.one_line(said or "")
        return f"law {law.name}: its refusal is {plugins.one_line(repr(said))}, no sentence"
    except BaseException as error:  # the law may be somebody else's: anything may come out of it
        return f"law {law.name}: refusal: {plugins.told(error)}"


def flaw(law: Law) -> str:
    """Return why a law of others cannot be taken, empty if it can."""
    return plugin_flaws.first_flaw(law, _flaw_of_kind, _flaw_of_modes, _flaw_of_settings)


def head_flaw(law: Any, *functions: str) -> str:
    """Return what is wrong with what a law says of itself, empty if nothing is.

    law: of the plane too; functions: those that are its own, beside what every law has.
    """
    own = (*functions, "ask", "help", "rest", "memory", "own", "refusal")
    wrong = plugin_flaws.prefix_flaw(law.name) or plugin_flaws.functions_flaw(law, own)
    if wrong:
        return wrong
    if law.heeds:
        return "it heeds the guard by itself: the envelope does that for laws of other packages"
    return plugin_flaws.shown_flaw(law.shown, MOST_SHOWN)


def _flaw_of_kind(law: Law) -> str:
    if wrong := head_flaw(law, "foresee"):
        return wrong
    if law.judged not in ("", LINEAR):
        return f"it is judged by {law.judged!r}: {LINEAR!r} is wanted, or nothing"
    return ""


def _flaw_of_modes(law: Law) -> str:
    if not isinstance(law.variants, dict) or any(type(mode) is not int for mode in law.variants):
        return f"its variants, {law.variants!r}, are no dict of numbers to Variant"
    modes = sorted(law.variants)
    if not modes or not all(FIRST <= mode <= LAST for mode in modes):
        return f"its modes are {modes}: those of other packages are {FIRST} to {LAST}"
    if modes != list(range(modes[0], modes[-1] + 1)):
        return f"its modes are {modes}: they must follow each other"
    for mode, variant in law.variants.items():
        if not isinstance(variant, Variant) or not isinstance(variant.gains, tuple):
            return f"mode {mode} is {variant!r}: a Variant with a tuple of gains is wanted"
        if not plugin_flaws.is_title(variant.name):
            return f"mode {mode} is called {variant.name!r}: a short name is wanted"
        if variant.name in all_names().values():
            return f"mode {mode} has the name of a mode of this package, {variant.name}"
    if len({variant.name for variant in law.variants.values()}) < len(modes):
        return "two of its modes have one name"
    return ""


def _flaw_of_settings(law: Law) -> str:
    kind: Any = law.settings
    if any(kind is other.settings for other in LAWS):
        return "its settings are those of a law of this package: make a NamedTuple of your own"
    if wrong := plugin_flaws.settings_flaw(kind):
        return wrong
    gains = {gain for variant in law.variants.values() for gain in variant.gains}
    if unknown := sorted(gains - set(kind._fields)):
        return f"its gain {unknown[0]} is none of its settings"
    below = [gain for gain in gains if law.judged and fields(kind)[gain].setting.low < 0.0]
    if below:
        return f"its gain {below[0]} may be negative, and the linear model judges gains from 0 up"
    if other := [margin.gain for margin in law.margins if margin.gain not in gains]:
        return f"its margin of {other[0]} is of none of its gains"
    margins = [margin_of(law, gain) for gain in modes_of_gains(law)]
    named = {name for margin in margins for name in (*margin.least, *margin.most)}
    if unknown := sorted(named - {"rate", *kind._fields, *VerticalSettings._fields}):
        return f"its margins name {unknown[0]}, which is no setting of it or of the envelope"
    values = kind()._asdict().items() if law.judged else ()
    if no := [name for name, v in values if name in named and not isinstance(v, (int, float))]:
        return f"its setting {no[0]}, on which its gain limits depend, is no number: name margins"
    return ""
