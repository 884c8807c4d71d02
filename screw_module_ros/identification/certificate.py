# SPDX-License-Identifier: Apache-2.0
"""The certificate of a module: delivered impedance at the handle, and margins of the gains."""

from __future__ import annotations

import math
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import yaml

from ..calibration.certificate import FORMAT, Conditions, text_checksum
from ..control.vertical_settings import VerticalSettings
from ..settings import VERSION, fields
from . import stability
from .lab import Lab, MissingResult
from .results import Result

FILE = "module_certificate.yaml"
_MET = ("hand", "heavy_arm", "wall")
"""Environments of `stability` on which a permitted gain is stable. On a light mass against a wall
hardly any is; there the chatter guard ends the oscillation."""
_SETTINGS = {"feedback": "force_gain", "observer": "observer_gain"}


def write(lab: Lab, result: Result, serial: str) -> None:
    """Write the certificate into the lab's folder, with gains if `stability` has a result.

    result: of `delivered_impedance`; serial: of the module. The checksum covers the text before
    it. Raises OSError.
    """
    content: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "serial": serial,
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "software": software(),
        "bench": lab.bench.name,
        "asked_for": {"stiffness_N_m": result.settings["stiffness"]},
        "delivered": {
            q.name: {"value": round(q.value, 6), "unit": q.unit, "what": q.text}
            for q in result.quantities
        },
    }
    content |= _gains(lab)
    text = _yaml(content)
    text += _yaml({"sha256": text_checksum(text)})
    (lab.folder / FILE).write_text(text, encoding="utf-8")


def software() -> str:
    """Return the version of this package, "unknown" where it is not installed."""
    try:
        return version("screw_module_ros")
    except PackageNotFoundError:
        return "unknown"


def _gains(lab: Lab) -> dict[str, Any]:
    """Return largest stable gains with margins over the defaults, permitted gains and conditions.

    Raises MissingResult if the gains are of a version that kept no conditions.
    """
    try:
        gains = lab.result(stability.NAME)
    except MissingResult:
        return {}
    found = {q.name: q for q in gains.quantities if q.name.split("_")[0] in _SETTINGS}
    return {
        "largest_gains": {
            name: {
                "gain": round(q.value, 2),
                "margin": round(q.value / _default(name.split("_")[0]), 2),
                "what": q.text,
            }
            for name, q in found.items()
        },
        "permitted_gains": {
            setting: _permitted(setting, [found[f"{law}_{met}"].value for met in _MET])
            for law, setting in _SETTINGS.items()
        },
        "conditions": _conditions(gains),
    }


def _conditions(gains: Result) -> dict[str, float]:
    """Return the conditions of the gains, to the last bit: the controller compares them."""
    if missing := set(Conditions._fields) - set(gains.settings):
        raise MissingResult(
            f"the result of {stability.NAME} does not say with which {min(missing)} its gains were "
            f"found, an older version wrote it: run {stability.NAME} again"
        )
    return {name: gains.settings[name] for name in Conditions._fields}


def _default(law: str) -> float:
    return getattr(VerticalSettings(), _SETTINGS[law])


def _permitted(setting: str, stable: list[float]) -> float:
    """Return the smallest stable gain, rounded down, within the range of its setting."""
    most = fields(VerticalSettings)[setting].setting.high
    return math.floor(100.0 * min(*stable, most)) / 100.0


def _yaml(content: dict[str, Any]) -> str:
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
