# SPDX-License-Identifier: Apache-2.0
"""Certificate of one module, of which the controller takes the largest force gains (thesis 7.1).

`identification/calibration` writes it: the delivered impedance of every mode, the largest gains
that are stable on what the module may meet, and with which loop, filters and observer they were
found stable, and for which version of the law. Its last line is the SHA-256 of the text before it.

What the controller knows of its own loop and law it compares: a departure in the direction that
makes the largest stable gain smaller is refused, one that makes it larger is not. The delay and the
encoder's velocity filter belong to other nodes: they are written down for who reads the
certificate.
"""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from ..behaviour import digest
from ..control.modes import FORCE_GAINS
from ..control.vertical import initial_state, vertical_step
from ..control.vertical_settings import VerticalSettings
from ..settings import Setting, SettingError, fields, problem
from ..settings_file import read_file, read_text
from .module import check_serial

FORMAT = "screw_module_ros/certificate"
FEEDBACK, OBSERVED = "force_gain", "observer_gain"
"""Settings of the law that a certificate limits."""
LEAST = {"rate": (FEEDBACK, OBSERVED), "observer_bandwidth": (OBSERVED,),
         "observer_delay": (OBSERVED,), "mass": (OBSERVED,)}  # fmt: skip
"""Conditions of which less costs margin, with the gains that need it."""
MOST = {"force_cutoff": (FEEDBACK,), "observer_cutoff": (OBSERVED,),
        "observer_inertia": (OBSERVED,)}  # fmt: skip
"""Conditions of which more costs margin."""
_CHECKSUM = "sha256: "


class Gains(NamedTuple):
    """Largest permitted values of these settings of the law."""

    force_gain: float
    observer_gain: float

    def flaw(self) -> str:
        """Return which gain is out of the law's range, empty if none is."""
        return _beyond_law(self)


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
        return _beyond_law(self)

    def departure(
        self, gain: str, settings: VerticalSettings, rate: float
    ) -> tuple[str, str] | None:
        """Return what costs a gain margin and what the certificate is for, None if nothing does.

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
                        f"is for {wanted:.10g}{unit} {way}: choose a {better} one",
                    )
        return None


def _beyond_law(record: Gains | Conditions) -> str:
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


class Certificate(NamedTuple):
    """A certificate; fields as the keys of its file.

    law: `law_version` for which they were found; permitted_gains: largest permitted values;
    conditions: with which they were found; sha256: of the file's text before it. The others are for
    who reads the file.
    """

    serial: str
    date: str
    law: str
    permitted_gains: Gains
    conditions: Conditions
    sha256: str
    software: str = ""
    bench: str = ""
    asked_for: dict[str, Any] = {}
    delivered: dict[str, Any] = {}
    largest_gains: dict[str, Any] = {}

    @property
    def identity(self) -> str:
        """Return serial, date and checksum for diagnostics."""
        return f"{self.serial} {self.date} sha256:{self.sha256[:12]}"

    def chosen(self, settings: VerticalSettings) -> VerticalSettings:
        """Return the settings with the gains that this module permits, none raised."""
        gains = self.permitted_gains._asdict()
        return settings._replace(
            **{name: min(most, getattr(settings, name)) for name, most in gains.items()}
        )

    def refusal(self, settings: VerticalSettings, mode: int, rate: float) -> str:
        """Return why the settings go beyond the certificate in a mode, empty if they do not.

        rate: of the controller [Hz].
        """
        for name in (name for name, uses in FORCE_GAINS.items() if uses(mode)):
            beyond = self.conditions.departure(name, settings, rate) or self._excess(name, settings)
            if beyond:
                asked, limit = beyond
                return (
                    f"{asked}, and the module's certificate ({self.identity}) {limit}, or set "
                    "uncertified_gains"
                )
        return ""

    def _excess(self, name: str, settings: VerticalSettings) -> tuple[str, str] | None:
        asked, most = getattr(settings, name), getattr(self.permitted_gains, name)
        if asked <= most:
            return None
        return f"{name} is {asked:g}", f"permits {most:g} at most: choose a smaller one"


def load_certificate(path: str | Path, serial: str) -> Certificate:
    """Return the certificate of the module with that serial.

    Raises SettingError naming file, key and problem: when the file cannot be read, was changed,
    belongs to another module or another version of the law, or lacks gains or conditions.
    """
    try:
        certificate = read_file(path, Certificate, FORMAT)
    except SettingError as problem:
        raise SettingError(
            f"{problem}; restore the file as it was written, or run stability and "
            "delivered_impedance again"
        ) from None
    if certificate.sha256 != text_checksum(read_text(path).rpartition(_CHECKSUM)[0]):
        raise SettingError(
            f"{path}: sha256: the file was changed after it was written; restore it, or run "
            "stability and delivered_impedance again"
        )
    check_serial(path, certificate.serial, serial)
    if certificate.law != law_version():
        raise SettingError(
            f"{path}: law: its gains were found for version {certificate.law} of the law, this "
            f"software has {law_version()}: run stability and delivered_impedance again, or empty "
            "certificate_file"
        )
    return certificate


@functools.cache
def law_version() -> str:
    """Return the version of the vertical law: the digest of what its step reaches.

    What `behaviour.digest` does not see stands in the conditions as far as the linear model depends
    on it: values of settings, rate and delay of the loop, the encoder's filter.
    """
    return digest(vertical_step, initial_state)


def text_checksum(text: str) -> str:
    """Return the checksum of a certificate's text before its last line."""
    return hashlib.sha256(text.encode()).hexdigest()
