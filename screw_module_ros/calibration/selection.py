# SPDX-License-Identifier: Apache-2.0
"""The calibration that a node's parameters name: friction model or linearization."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..control.friction import FrictionModel
from ..control.linearization import Linearization, default_linearization
from ..control.vertical_settings import VerticalSettings
from ..resources import resource_path
from ..settings import Setting
from .friction_file import THESIS_FILE, load_friction_model
from .linearization_file import load_linearization
from .module_file import CalibrationSettings, chosen_calibration
from .yaml_file import calibration_identity


class ChosenFriction(NamedTuple):
    """A friction model, its identity, and the module's weight [N] and mass [kg].

    Weight and mass are None if unknown: then the friction model is not this module's either.
    """

    model: FrictionModel
    identity: str
    gravity: float | None = None
    mass: float | None = None

    def described(self, gravity: float, mass: float) -> str:
        """Return the identity, with a note if gravity [N] or mass [kg] was set by hand."""
        text = self.identity
        if self.gravity not in (None, gravity):
            text += f", gravity {gravity:g} N by hand"
        if self.mass not in (None, mass):
            text += f", mass {mass:g} kg by hand"
        return text

    def law(self, settings: VerticalSettings) -> VerticalSettings:
        """Return the law's settings, in which OBSERVER carries no mass beyond the one measured."""
        return settings if self.mass is None else settings.carrying_at_most(self.mass)


def chosen_friction(settings: CalibrationSettings, path: str) -> ChosenFriction:
    """Return the friction model: of the module, of the file at `path`, or the thesis's.

    Raises CalibrationError, ValueError.
    """
    module = chosen_calibration(settings, "friction_file", path)
    if module is None:
        path = path or resource_path(THESIS_FILE)
        return ChosenFriction(load_friction_model(path), calibration_identity(path))
    identity = module.identity(settings.calibration_file)
    return ChosenFriction(module.friction, identity, module.gravity, module.mass)


class LinearizationSettings(NamedTuple):
    """Linearization of the amplifier."""

    linearize: Annotated[
        bool, Setting("compensate the amplifier's dead zone around zero (thesis 4.1.1)")
    ] = True
    linearization_file: Annotated[
        str, Setting("linearization file, empty for the thesis's dead zone of 0.025 Nm or when "
                     "calibration_file is set")
    ] = ""


def chosen_linearization(
    settings: CalibrationSettings, own: LinearizationSettings
) -> tuple[Linearization | None, str]:
    """Return the linearization, None if switched off, and its identity.

    An unused calibration is checked too. Raises CalibrationError, ValueError.
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
