# SPDX-License-Identifier: Apache-2.0
"""The linearization that a node's parameters name."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..control.linearization import Linearization, default_linearization
from ..settings import Setting
from .file import calibration_identity
from .linearization import load_linearization
from .module import CalibrationSettings, chosen_calibration


class LinearizationSettings(NamedTuple):
    """Which linearization the amplifier uses."""

    linearize: Annotated[
        bool, Setting("undo the amplifier's dead zone around zero (thesis 4.1.1)")
    ] = True
    linearization_file: Annotated[
        str, Setting("linearization file, empty for the thesis's dead zone of 0.025 Nm or when "
                     "calibration_file is set")
    ] = ""


def chosen_linearization(
    settings: CalibrationSettings, own: LinearizationSettings
) -> tuple[Linearization | None, str]:
    """Return the linearization, None where none is wanted, and its identity.

    A calibration that is not used is checked too. Raises CalibrationError, ValueError.
    """
    path = own.linearization_file
    module = chosen_calibration(settings, "linearization_file", path)
    if not own.linearize:
        return None, "none"
    if module is not None:
        return module.linearization, module.identity(settings.calibration_file)
    if path:
        return load_linearization(path), calibration_identity(path)
    return default_linearization(), "thesis 4.1.1"
