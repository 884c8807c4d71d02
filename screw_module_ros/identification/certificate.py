# SPDX-License-Identifier: Apache-2.0
"""The certificate of a module: delivered impedance at the handle, and margins of the gains."""

from __future__ import annotations

import hashlib
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import yaml

from ..control.vertical_settings import VerticalSettings
from . import stability
from .lab import Lab, MissingResult
from .results import Result

FILE = "module_certificate.yaml"


def write(lab: Lab, result: Result, serial: str) -> None:
    """Write the certificate into the lab's folder, with gains if `stability` has a result.

    result: of `delivered_impedance`; serial: of the module. The checksum covers the text before
    it. Raises OSError.
    """
    content: dict[str, Any] = {
        "format": "screw_module_ros/certificate",
        "version": 1,
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
    text += _yaml({"sha256": hashlib.sha256(text.encode()).hexdigest()})
    (lab.folder / FILE).write_text(text, encoding="utf-8")


def software() -> str:
    """Return the version of this package, "unknown" where it is not installed."""
    try:
        return version("screw_module_ros")
    except PackageNotFoundError:
        return "unknown"


def _gains(lab: Lab) -> dict[str, Any]:
    """Return the largest stable gains and their margins over the defaults, if measured."""
    try:
        gains = lab.result(stability.NAME)
    except MissingResult:
        return {}
    defaults = VerticalSettings()
    own = {"feedback": defaults.force_gain, "observer": defaults.observer_gain}
    return {
        "largest_gains": {
            q.name: {
                "gain": round(q.value, 2),
                "margin": round(q.value / own[q.name.split("_")[0]], 2),
                "what": q.text,
            }
            for q in gains.quantities
            if q.name.split("_")[0] in own
        }
    }


def _yaml(content: dict[str, Any]) -> str:
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
