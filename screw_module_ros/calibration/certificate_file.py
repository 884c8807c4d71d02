# SPDX-License-Identifier: Apache-2.0
"""Certificate of one module, of which the controller takes the largest force gains (thesis 7.1).

`identification/certificate` writes it: the delivered impedance of every mode, the largest gains
that are stable on what the module may meet, and the conditions of that (`certificate_conditions`).
Its last line is the SHA-256 of the text before it.
"""

from __future__ import annotations

import hashlib
from typing import Annotated, NamedTuple

from ..control.modes import uses_feedback, uses_observer
from ..control.vertical_settings import VerticalSettings
from ..settings import Setting, declared
from .certificate_conditions import Conditions, read_conditions
from .strict_mapping import CalibrationError, Section
from .yaml_file import check_serial, file_content, parsed_calibration

FORMAT = "screw_module_ros/certificate"
GAINS = ("force_gain", "observer_gain")
"""Settings of the law that a certificate limits."""
_MEASURE = "restore the file as it was written, or run stability and delivered_impedance again"
_CHECKSUM = "sha256: "


class CertificateError(CalibrationError):
    """A certificate that cannot be used."""


class CertificateSettings(NamedTuple):
    """Parameters of a node that keeps to a module's certificate."""

    certificate_file: Annotated[
        str, Setting("certificate of the module, empty for none: no gain is refused then")
    ] = ""
    uncertified_gains: Annotated[
        bool, Setting("also take force gains beyond the certificate's, and its conditions")
    ] = False


class Certificate(NamedTuple):
    """What a certificate permits.

    force_gain, observer_gain: largest permitted values of these settings; conditions: with which
    they were found; identity: serial, date and checksum for diagnostics.
    """

    force_gain: float
    observer_gain: float
    conditions: Conditions
    identity: str

    def refusal(self, settings: VerticalSettings, mode: int, rate: float) -> str:
        """Return why the settings go beyond the certificate in a mode, empty if they do not.

        rate: of the controller [Hz].
        """
        used = {"force_gain": uses_feedback(mode), "observer_gain": uses_observer(mode)}
        for name in (name for name in GAINS if used[name]):
            beyond = self.conditions.departure(name, settings, rate) or self._excess(name, settings)
            if beyond:
                asked, limit = beyond
                return (
                    f"{asked}, and the module's certificate ({self.identity}) {limit}, or set "
                    "uncertified_gains"
                )
        return ""

    def _excess(self, name: str, settings: VerticalSettings) -> tuple[str, str] | None:
        asked, most = getattr(settings, name), getattr(self, name)
        if asked <= most:
            return None
        return f"{name} is {asked:g}", f"permits {most:g} at most: choose a smaller one"


def load_certificate(settings: CertificateSettings, serial: str) -> Certificate | None:
    """Return the certificate that the settings name, None without one.

    serial: of the connected module. Raises CertificateError naming file, problem and way out: when
    the file cannot be read, was changed, belongs to another module, or lacks gains or conditions.
    """
    path = settings.certificate_file
    if not path:
        return None
    content = file_content(path, CertificateError)
    top = parsed_calibration(path, content, FORMAT, CertificateError, _MEASURE)
    checksum = _checked(content, top)
    written = top.text("serial")
    check_serial(path, written, serial, CertificateError)
    permitted = top.section("permitted_gains")
    fields = declared(VerticalSettings)
    gains = [
        permitted.number(name, fields[name].setting.low, fields[name].setting.high)
        for name in GAINS
    ]
    conditions = read_conditions(top.section("conditions"))
    return Certificate(*gains, conditions, f"{written} {top.text('date')} sha256:{checksum[:12]}")


def _checked(content: bytes, top: Section) -> str:
    """Return the checksum after comparing it with the text before it."""
    noted, found = top.text("sha256"), text_checksum(content.decode().rpartition(_CHECKSUM)[0])
    if noted != found:
        top.fail("sha256", "the file was changed after it was written", _MEASURE)
    return found


def text_checksum(text: str) -> str:
    """Return the checksum of a certificate's text before its last line."""
    return hashlib.sha256(text.encode()).hexdigest()
