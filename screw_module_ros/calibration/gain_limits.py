# SPDX-License-Identifier: Apache-2.0
"""Gain limits of a linear model of one module, to which the controller keeps.

The thesis asks for tools of this kind (7.1); this one is ours.

`identification/calibration` writes the file: the delivered impedance of every mode; and of each law
that is judged by the linear model the largest force gains that are stable in the sampled loop of
`identification/stability` on a hand, a heavy arm and a wall, with which loop, filters and settings
they were found, and for which version of the law. Its last line is the SHA-256 of the text before
it.

A limit is the smallest of these gains. It is no promise: the model has neither friction nor play,
and on the loads under `exceeds`, such as a soft grip, a gain at its limit is unstable even in the
model. There the guard (`control/gain_guard.py`) ends what grows.

What the controller knows of its own loop and law it compares: a departure in the direction that
makes the largest stable gain smaller is refused, one that makes it larger is not
(`control.law.Margin`). The delay and the encoder's velocity filter belong to other nodes: they are
written down for who reads the file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, NamedTuple

from ..control.law import Law
from ..control.laws import LAWS, margin_of, modes_of_gains, parameter_of
from ..control.laws.thesis import THESIS
from ..control.vertical_settings import VerticalSettings
from ..settings import Field, Setting, SettingError, fields, problem, shown
from ..settings_file import load, read_file
from .limits_file import was_changed
from .module import check_serial
from .version import fits, law_version

FORMAT = "screw_module_ros/gain_limits"
VERSION = 3
"""Of the format. Version 2 had the limits of one law, version 1 was a certificate."""
_OLD_FORMAT = "screw_module_ros/certificate"
LOADS = ("hand", "heavy_arm", "wall")
"""Loads that limit; `stability.ENVIRONMENTS` says what each is."""
_AGAIN = "run stability and delivered_impedance again"


class Loop(NamedTuple):
    """The loop in which gain limits were found.

    rate, delay: of the loop; velocity_cutoff: of the encoder's filter.
    """

    rate: Annotated[float, Setting("samples per second", "Hz", 50.0, 10_000.0)]
    delay: Annotated[float, Setting("from a sample to the current's answer", "s", 0.0, 0.1)]
    velocity_cutoff: Annotated[float, Setting("of the velocity filter", "Hz", 0.1, 1000.0)]


def conditions_of(law: Law, settings: VerticalSettings, own: Any, loop: Loop) -> dict[str, Any]:
    """Return, by the parameters' names, what the gain limits of a law hold for.

    settings: of the envelope; own: of the law.
    """
    of = {law.settings: own, VerticalSettings: settings}
    named = {full: getattr(of[kind], name) for full, (kind, name) in _named(law).items()}
    return loop._asdict() | named


def _named(law: Law) -> dict[str, tuple[type, str]]:
    """Return the settings on which a law's limits depend: parameter -> record and field."""
    found = {}
    for margin in (margin_of(law, gain) for gain in modes_of_gains(law)):
        for name in (*margin.least, *margin.most):
            if name != "rate":
                kind = law.settings if name in law.settings._fields else VerticalSettings
                found[parameter_of(law, name)] = (kind, name)
    return found


class LawLimits(NamedTuple):
    """Gain limits of one law; fields as the keys of the file.

    version: of the law for which they were found, empty where that is unknown; largest_gains_on:
    load -> setting -> largest stable gain, for each of `LOADS`; exceeds: the same for other loads
    of the model on which a gain at its limit is unstable; conditions: with which they were found,
    by the parameters' names; largest_gains: for who reads the file.
    """

    version: str
    largest_gains_on: dict[str, dict[str, float]]
    exceeds: dict[str, dict[str, float]]
    conditions: dict[str, Any]
    largest_gains: dict[str, Any] = {}

    def flaw(self) -> str:
        """Return which load or gain is missing or unknown, empty if all are there."""
        if unknown := set(self.largest_gains_on) - set(LOADS):
            return f"largest_gains_on.{min(unknown)} is unknown; known are {', '.join(LOADS)}"
        if missing := [each for each in LOADS if each not in self.largest_gains_on]:
            return f"largest_gains_on.{missing[0]} is missing"
        known = {gain: None for on in self.largest_gains_on.values() for gain in on}
        for each, on in self.largest_gains_on.items():
            if missing := [gain for gain in known if gain not in on]:
                return f"largest_gains_on.{each}.{missing[0]} is missing"
        for each, on in self.exceeds.items():
            if more := [gain for gain in on if gain not in known]:
                what = f"exceeds.{each}.{more[0]} is unknown"
                return f"{what}; known are {', '.join(known)}"
        if missing := [name for name in Loop._fields if name not in self.conditions]:
            return f"conditions.{missing[0]} is missing"
        return ""

    def law_flaw(self, law: Law) -> str:
        """Return which gain or condition is not one of this law, or missing; empty if none is."""
        found, known = self.largest, modes_of_gains(law)
        if unknown := [gain for gain in found if gain not in known]:
            return f"largest_gains_on.hand.{unknown[0]} is unknown; known are {', '.join(known)}"
        if missing := [gain for gain in known if gain not in found]:
            return f"largest_gains_on.hand.{missing[0]} is missing"
        named, conditions = _named(law), self.conditions
        if more := [name for name in conditions if name not in {*named, *Loop._fields}]:
            return f"conditions.{more[0]} is unknown; known are {', '.join(named)}"
        if missing := [name for name in named if name not in conditions]:
            return f"conditions.{missing[0]} is missing"
        checks = [
            (fields(law.settings)[gain], value, f"largest_gains_on.{each}.{gain}")
            for each, on in self.largest_gains_on.items() for gain, value in on.items()
        ]  # fmt: skip
        checks += [(fields(Loop)[name], conditions[name], f"conditions.{name}")
                   for name in Loop._fields]  # fmt: skip
        checks += [(fields(kind)[name], conditions[full], f"conditions.{full}")
                   for full, (kind, name) in named.items()]  # fmt: skip
        return next(filter(None, (_value_flaw(*check) for check in checks)), "")

    @property
    def largest(self) -> dict[str, float]:
        """Return the limits: the smallest of the largest stable gains, by setting."""
        ons = self.largest_gains_on.values()
        return {gain: min(on[gain] for on in ons) for gain in self.largest_gains_on[LOADS[0]]}

    def chosen(self, own: Any) -> Any:
        """Return the law's settings with gains within the limits, none raised."""
        return own._replace(
            **{gain: min(most, getattr(own, gain)) for gain, most in self.largest.items()}
        )

    def exceeded(self, own: Any) -> str:
        """Return which gains of the law's settings are unstable in the model, and on which loads.

        Each load with the largest gain that is stable on it. Empty if none is.
        """
        found = []
        for gain in self.largest:
            asked = getattr(own, gain)
            beyond = [
                f"{each.replace('_', ' ')} {on[gain]:g}"
                for each, on in (self.largest_gains_on | self.exceeds).items()
                if gain in on and asked > on[gain]
            ]
            found += [f"{gain} {asked:g} ({', '.join(beyond)})"] if beyond else []
        return ", ".join(found)

    def departure(
        self, law: Law, gain: str, settings: VerticalSettings, own: Any, rate: float
    ) -> tuple[str, str] | None:
        """Return what costs a gain margin and what the limits are for, None if nothing does.

        settings: of the envelope; own: of the law; rate: of the controller [Hz].
        """
        margin, named = margin_of(law, gain), _named(law)
        actual = conditions_of(law, settings, own, Loop(rate, 0.0, 0.0))
        sides = ((margin.least, "at least", "higher"), (margin.most, "at most", "lower"))
        for number, (names, way, better) in enumerate(sides):
            for name in names:
                full = parameter_of(law, name)
                found, wanted = actual[full], self.conditions[full]
                if found > wanted if number else found < wanted:
                    field = fields(Loop)["rate"] if name == "rate" else fields(named[full][0])[name]
                    unit = f" {field.setting.unit}" if field.setting.unit else ""
                    return (
                        f"{full} is {found:.10g}{unit}",
                        f"are for {wanted:.10g}{unit} {way}: choose a {better} one",
                    )
        return None


def _value_flaw(field: Field, value: Any, label: str) -> str:
    """Return why a value is none of a field's, empty if it is."""
    if isinstance(value, str) or not isinstance(value, (bool, int, float)):
        return f"{label} = {shown(value)}: a number is wanted"
    return problem(field, value, label)


class GainLimits(NamedTuple):
    """Gain limits of one module; fields as the keys of their file.

    laws: by their names; sha256: of the file's text before it. The others are for who reads the
    file.
    """

    serial: str
    date: str
    laws: dict[str, LawLimits]
    sha256: str
    software: str = ""
    bench: str = ""
    asked_for: dict[str, Any] = {}
    delivered: dict[str, Any] = {}

    def flaw(self) -> str:
        """Return what is wrong with a law's limits, empty if nothing is."""
        for name, limits in self.laws.items():
            shipped = next((law for law in LAWS if law.name == name), None)
            if wrong := limits.flaw() or (limits.law_flaw(shipped) if shipped else ""):
                return f"laws.{name}.{wrong}"
        return ""

    @property
    def identity(self) -> str:
        """Return serial, date and checksum for diagnostics."""
        return f"{self.serial} {self.date} sha256:{self.sha256[:12]}"

    def feedback_refusal(self, law: Law) -> str:
        """Return why these limits permit a law no force feedback, empty if they do."""
        found = self.laws.get(law.name)
        if found is None:
            return f"{self.identity}: no gain limits of law {law.name} are in the file: {_AGAIN}"
        if not found.version:
            return (
                f"{self.identity} is a certificate, as gain limits were called: the law for which "
                "its gains were found cannot be compared with this one, so it limits the gains but "
                f"permits no force feedback where limits are required; {_AGAIN}, which writes "
                "module_gain_limits.yaml; the next release does not read a certificate"
            )
        if not fits(found.version, law):
            return (
                f"{self.identity}: laws.{law.name}: its gains were found for version "
                f"{found.version} of the law, this one is {law_version(law)}: {_AGAIN}"
            )
        wrong = found.law_flaw(law)
        return wrong and f"{self.identity}: laws.{law.name}.{wrong}: {_AGAIN}"

    def _of(self, law: Law) -> LawLimits | None:
        """Return what limits a law; a law of others of another version has other gains."""
        found = self.laws.get(law.name)
        return None if found is None or law not in LAWS and self.feedback_refusal(law) else found

    def chosen(self, law: Law, own: Any) -> Any:
        """Return a law's settings with gains within the limits, none raised."""
        found = self._of(law)
        return found.chosen(own) if found else own

    def exceeded(self, law: Law, own: Any) -> str:
        """Return which gains in a law's settings are unstable in the model; see `LawLimits`."""
        found = self._of(law)
        return found.exceeded(own) if found else ""

    def refusal(
        self, law: Law, mode: int, settings: VerticalSettings, own: Any, rate: float
    ) -> str:
        """Return why the settings go beyond the limits in a mode, empty if they do not.

        settings: of the envelope; own: of the law; rate: of the controller [Hz].
        """
        found = self._of(law)
        if found is None:
            return ""
        for gain in law.variants[mode].gains:
            asked, most = getattr(own, gain), found.largest[gain]
            beyond = found.departure(law, gain, settings, own, rate)
            if asked > most:
                beyond = beyond or (
                    f"{parameter_of(law, gain)} is {asked:g}",
                    f"are {most:g} at most: choose a smaller one",
                )
            if beyond:
                return (
                    f"{beyond[0]}, and the module's gain limits ({self.identity}) {beyond[1]}, or "
                    "set beyond_gain_limits"
                )
        return ""


def _of_one_law(content: dict[str, Any]) -> dict[str, Any]:
    """Return the content of a file of version 2, with the limits of the law of modes 1 to 5 alone.

    It has them below the law's name, as a file of this version.
    """
    names = {"law": "version"} | {name: name for name in LawLimits._fields[1:]}
    limits = {now: content.pop(was) for was, now in names.items() if was in content}
    return content | {"laws": {THESIS.name: limits}}


def _of_certificate(content: dict[str, Any]) -> dict[str, Any]:
    """Return that of a file of version 1, which this release alone still reads.

    Its loads are not told apart. Its law, a digest of files, says nothing of the law of another
    version; 0.1.0 wrote none.
    """
    gains = dict.fromkeys(LOADS, content.pop("permitted_gains", None))
    return _of_one_law(content | {"law": "", "largest_gains_on": gains, "exceeds": {}})


def load_gain_limits(path: str | Path, serial: str) -> GainLimits:
    """Return the gain limits of the module with that serial.

    Those of a certificate (version 1) permit no force feedback. Raises SettingError naming file,
    key and problem: when the file cannot be read, was changed, belongs to another module or another
    version of a law of this package, or lacks gains or conditions.
    """
    of: tuple[Any, ...] = ()
    try:
        content = load(path)
        of = (content.get("format"), content.get("version")) if isinstance(content, dict) else ()
        if of[:1] == (_OLD_FORMAT,):
            limits = read_file(path, GainLimits, _OLD_FORMAT, 1, _of_certificate)
        elif of == (FORMAT, 2):
            limits = read_file(path, GainLimits, FORMAT, 2, _of_one_law)
        else:
            limits = read_file(path, GainLimits, FORMAT, VERSION)
    except SettingError as wrong:
        told = str(wrong)
        if of[:1] == (_OLD_FORMAT,):
            told = told.replace(f"laws.{THESIS.name}.largest_gains_on.hand", "permitted_gains")
        raise SettingError(f"{told}; restore the file as it was written, or {_AGAIN}") from None
    if was_changed(path, limits.sha256):
        raise SettingError(
            f"{path}: sha256: the file was changed after it was written; restore it, or {_AGAIN}"
        )
    check_serial(path, limits.serial, serial)
    for law in LAWS:
        found = limits.laws.get(law.name)
        if found and found.version and not fits(found.version, law):
            raise SettingError(
                f"{path}: law: its gains were found for version {found.version} of law "
                f"{law.name}, this software has {law_version(law)}: {_AGAIN}, or empty "
                "gain_limits_file"
            )
    return limits
