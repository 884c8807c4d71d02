# SPDX-License-Identifier: Apache-2.0
"""Gain limits of a linear model of one module, to which the controller keeps.

The thesis asks for tools of this kind (7.1); this one is ours.

`identification/calibration` writes the file: the delivered impedance of every mode; the largest
force gains that are stable in the linear sampled loop of `identification/stability` on a hand, a
heavy arm and a wall; with which loop, filters and observer they were found, and for which version
of the law. Its last line is the SHA-256 of the text before it.

A limit is the smallest of these gains. It is no promise: the model has neither friction nor play,
and on the loads under `exceeds`, such as a soft grip, a gain at its limit is unstable even in the
model. There the guard (`control/gain_guard.py`) ends what grows.

What the controller knows of its own loop and law it compares: a departure in the direction that
makes the largest stable gain smaller is refused, one that makes it larger is not. The delay and the
encoder's velocity filter belong to other nodes: they are written down for who reads the file.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from ..control.laws import gains_of
from ..control.vertical_settings import VerticalSettings
from ..settings import Setting, SettingError, fields, problem
from ..settings_file import load, read_file, read_text
from .module import check_serial
from .version import law_version

FORMAT = "screw_module_ros/gain_limits"
VERSION = 2
"""Of the format. Version 1 was a certificate: `_Certificate` reads it."""
_OLD_FORMAT = "screw_module_ros/certificate"
FEEDBACK, OBSERVED = "force_gain", "observer_gain"
"""Settings of the law that a file limits."""
LEAST = {"rate": (FEEDBACK, OBSERVED), "observer_bandwidth": (OBSERVED,),
         "observer_delay": (OBSERVED,), "mass": (OBSERVED,)}  # fmt: skip
"""Conditions of which less costs margin, with the gains that need it."""
MOST = {"rate": (FEEDBACK, OBSERVED), "force_cutoff": (FEEDBACK,), "observer_cutoff": (OBSERVED,),
        "observer_inertia": (OBSERVED,)}  # fmt: skip
"""Conditions of which more costs margin. On the screw's axial support a faster loop feeds back more
of a heavy arm's oscillation, so the rate must be that of the limits."""
_CHECKSUM = "sha256: "
_AGAIN = "run stability and delivered_impedance again"


class Gains(NamedTuple):
    """Largest values of these settings of the law that are stable in the linear model."""

    force_gain: float
    observer_gain: float

    def flaw(self) -> str:
        """Return which gain is out of the law's range, empty if none is."""
        return _range_flaw(self)


class Loads(NamedTuple):
    """Largest gains on the loads that limit them; `stability.ENVIRONMENTS` says what each is."""

    hand: Gains
    heavy_arm: Gains
    wall: Gains


class Conditions(NamedTuple):
    """The loop and the law's settings with which the largest gains were found.

    rate, delay: of the loop; velocity_cutoff: of the encoder's filter; the others: settings of the
    law (`VerticalSettings`).
    """

    rate: Annotated[float, Setting("samples per second", "Hz", 50.0, 10_000.0)]
    delay: Annotated[float, Setting("from a sample to the current's answer", "s", 0.0, 0.1)]
    velocity_cutoff: Annotated[float, Setting("of the velocity filter", "Hz", 0.1, 1000.0)]
    force_cutoff: float
    observer_cutoff: float
    observer_bandwidth: float
    observer_delay: float
    observer_inertia: float
    mass: float

    def flaw(self) -> str:
        """Return which setting of the law is out of its range, empty if none is."""
        return _range_flaw(self)

    def departure(
        self, gain: str, settings: VerticalSettings, rate: float
    ) -> tuple[str, str] | None:
        """Return what costs a gain margin and what the limits are for, None if nothing does.

        gain: name of the setting; rate: of the controller [Hz].
        """
        actual = conditions_of(settings, rate, self.delay, self.velocity_cutoff)
        for names, way, better in ((LEAST, "at least", "higher"), (MOST, "at most", "lower")):
            for name in (name for name, gains in names.items() if gain in gains):
                found, wanted = getattr(actual, name), getattr(self, name)
                if found < wanted if names is LEAST else found > wanted:
                    field = fields(VerticalSettings).get(name) or fields(Conditions)[name]
                    unit = field.setting.unit
                    unit = f" {unit}" if unit else ""
                    return (
                        f"{name} is {found:.10g}{unit}",
                        f"are for {wanted:.10g}{unit} {way}: choose a {better} one",
                    )
        return None


def _range_flaw(record: Gains | Conditions) -> str:
    """Return which field is out of the range that the law has for it, empty if none is."""
    law = fields(VerticalSettings)
    found = (problem(law[name], getattr(record, name)) for name in record._fields if name in law)
    return next(filter(None, found), "")


def conditions_of(
    law: VerticalSettings, rate: float, delay: float, velocity_cutoff: float
) -> Conditions:
    """Return the conditions of a law in a loop; rate [Hz], delay [s], velocity_cutoff [Hz]."""
    own = {name: getattr(law, name) for name in Conditions._fields if hasattr(law, name)}
    return Conditions(rate=rate, delay=delay, velocity_cutoff=velocity_cutoff, **own)


class GainLimits(NamedTuple):
    """Gain limits of one module; fields as the keys of their file.

    law: `law_version` for which they were found, empty where that is unknown; exceeds: load ->
    setting -> largest stable gain, for other loads of the model on which a gain at its limit is
    unstable; conditions: with which they were found; sha256: of the file's text before it. The
    others are for who reads the file.
    """

    serial: str
    date: str
    law: str
    largest_gains_on: Loads
    exceeds: dict[str, dict[str, float]]
    conditions: Conditions
    sha256: str
    software: str = ""
    bench: str = ""
    asked_for: dict[str, Any] = {}
    delivered: dict[str, Any] = {}
    largest_gains: dict[str, Any] = {}

    def flaw(self) -> str:
        """Return which gain under `exceeds` is none, empty if all are."""
        unknown = (
            f"exceeds.{load}.{name} is unknown; known are {', '.join(Gains._fields)}"
            for load, gains in self.exceeds.items()
            for name in gains
            if name not in Gains._fields
        )
        return next(unknown, "")

    @property
    def identity(self) -> str:
        """Return serial, date and checksum for diagnostics."""
        return f"{self.serial} {self.date} sha256:{self.sha256[:12]}"

    @property
    def feedback_refusal(self) -> str:
        """Return why these limits permit no force feedback, empty if they do."""
        if self.law == law_version():
            return ""
        return (
            f"{self.identity} is a certificate, as gain limits were called: the law for which its "
            "gains were found cannot be compared with this one, so it limits the gains but permits "
            f"no force feedback where limits are required; {_AGAIN}, which writes "
            "module_gain_limits.yaml; the next release does not read a certificate"
        )

    @property
    def largest(self) -> Gains:
        """Return the limits: the smallest of the largest stable gains."""
        return Gains(*map(min, zip(*self.largest_gains_on, strict=True)))

    def chosen(self, settings: VerticalSettings) -> VerticalSettings:
        """Return the settings with gains within the limits, none raised."""
        return settings._replace(
            **{name: min(most, getattr(settings, name))
               for name, most in self.largest._asdict().items()}
        )  # fmt: skip

    def exceeded(self, settings: VerticalSettings) -> str:
        """Return which gains of the settings are unstable in the model, and on which loads.

        Each load with the largest gain that is stable on it. Empty if none is.
        """
        loads = {load: gains._asdict() for load, gains in self.largest_gains_on._asdict().items()}
        found = []
        for name in Gains._fields:
            asked = getattr(settings, name)
            beyond = [
                f"{load.replace('_', ' ')} {gains[name]:g}"
                for load, gains in (loads | self.exceeds).items()
                if name in gains and asked > gains[name]
            ]
            found += [f"{name} {asked:g} ({', '.join(beyond)})"] if beyond else []
        return ", ".join(found)

    def refusal(self, settings: VerticalSettings, mode: int, rate: float) -> str:
        """Return why the settings go beyond the limits in a mode, empty if they do not.

        rate: of the controller [Hz].
        """
        for name in gains_of(mode):
            beyond = self.conditions.departure(name, settings, rate) or self._excess(name, settings)
            if beyond:
                asked, limit = beyond
                return (
                    f"{asked}, and the module's gain limits ({self.identity}) {limit}, or set "
                    "beyond_gain_limits"
                )
        return ""

    def _excess(self, name: str, settings: VerticalSettings) -> tuple[str, str] | None:
        asked, most = getattr(settings, name), getattr(self.largest, name)
        if asked <= most:
            return None
        return f"{name} is {asked:g}", f"are {most:g} at most: choose a smaller one"


class _Certificate(NamedTuple):
    """A file of version 1, which this release alone still reads; its loads are not told apart.

    law: a digest of files, which says nothing of the law of another version; 0.1.0 wrote none.
    """

    serial: str
    date: str
    permitted_gains: Gains
    conditions: Conditions
    sha256: str
    law: str = ""
    software: str = ""
    bench: str = ""
    asked_for: dict[str, Any] = {}
    delivered: dict[str, Any] = {}
    largest_gains: dict[str, Any] = {}

    def renamed(self) -> GainLimits:
        """Return the limits by their present names, for no law."""
        same = self._asdict() | {"law": ""}
        gains = same.pop("permitted_gains")
        return GainLimits(largest_gains_on=Loads(gains, gains, gains), exceeds={}, **same)


def load_gain_limits(path: str | Path, serial: str) -> GainLimits:
    """Return the gain limits of the module with that serial.

    Those of a certificate (version 1) permit no force feedback. Raises SettingError naming file,
    key and problem: when the file cannot be read, was changed, belongs to another module or another
    version of the law, or lacks gains or conditions.
    """
    try:
        content = load(path)
        old = isinstance(content, dict) and content.get("format") == _OLD_FORMAT
        if old:
            limits = read_file(path, _Certificate, _OLD_FORMAT).renamed()
        else:
            limits = read_file(path, GainLimits, FORMAT, VERSION)
    except SettingError as problem:
        raise SettingError(f"{problem}; restore the file as it was written, or {_AGAIN}") from None
    if limits.sha256 != text_checksum(read_text(path).rpartition(_CHECKSUM)[0]):
        raise SettingError(
            f"{path}: sha256: the file was changed after it was written; restore it, or {_AGAIN}"
        )
    check_serial(path, limits.serial, serial)
    if not old and limits.law != law_version():
        raise SettingError(
            f"{path}: law: its gains were found for version {limits.law} of the law, this "
            f"software has {law_version()}: {_AGAIN}, or empty gain_limits_file"
        )
    return limits


def text_checksum(text: str) -> str:
    """Return the checksum of a file's text before its last line."""
    return hashlib.sha256(text.encode()).hexdigest()
