# SPDX-License-Identifier: Apache-2.0
"""The linearization that a node's parameters name."""

from __future__ import annotations

from ..control.linearization import Linearization, default_linearization
from .file import calibration_identity
from .linearization import load_linearization
from .module import CalibrationSettings, chosen_calibration


def chosen_linearization(
    settings: CalibrationSettings, path: str, linearize: bool
) -> tuple[Linearization | None, str]:
    """Return the linearization, None where none is wanted, and its identity.

    path: a file of its own beside the module's calibration, empty for none. A calibration that is
    not used is checked too. Raises CalibrationError.
    """
    module = chosen_calibration(settings, "linearization_file", path)
    if not linearize:
        return None, "none"
    if module is not None:
        return module.linearization, module.identity(settings.calibration_file)
    if path:
        return load_linearization(path), calibration_identity(path)
    return default_linearization(), "thesis 4.1.1"
