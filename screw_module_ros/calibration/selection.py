# SPDX-License-Identifier: Apache-2.0
"""The calibration that a node's parameters name: gain limits, friction model or linearization."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, NamedTuple

from ..control.friction import FrictionModel
from ..control.linearization import Linearization, default_linearization
from ..control.vertical_settings import VerticalSettings
from ..resources import resource_path
from ..settings import Setting, SettingError
from .gain_limits import GainLimits, load_gain_limits
from .limits_file import GainLimitsSettings
from .module import (
    THESIS_FILE,
    ModuleCalibration,
    load_friction_model,
    load_linearization,
    load_module_calibration,
)

LARGEST_DELAY_CHANGE = 0.5e-3
"""Of a loop since its calibration [s]: OBSERVER's error is hardly larger up to here."""


class CalibrationSettings(NamedTuple):
    """Parameters of a node that loads a module's calibration."""

    calibration_file: Annotated[
        str, Setting("calibration file of the module, empty for none")
    ] = ""
    module_serial: Annotated[
        str, Setting("serial of the connected module, empty when unknown")
    ] = ""


class LinearizationSettings(NamedTuple):
    """Linearization of the amplifier."""

    linearize: Annotated[
        bool, Setting("compensate the amplifier's dead zone around zero (thesis 4.1.1)")
    ] = True
    linearization_file: Annotated[
        str, Setting("linearization file, empty for a dead zone as wide as the thesis's nonlinear "
                     "range, 0.025 Nm, or when calibration_file is set")
    ] = ""


class ChosenFriction(NamedTuple):
    """A friction model, its identity, and the module's weight [N] and mass [kg].

    Weight and mass are None if unknown: then the friction model is not this module's either.
    delay: of its loop, from a sample to its force, drive_delay: the drive's part [s]; 0: unknown.
    """

    model: FrictionModel
    identity: str
    gravity: float | None = None
    mass: float | None = None
    delay: float = 0.0
    drive_delay: float = 0.0

    def described(self, gravity: float, mass: float) -> str:
        """Return the identity, with a note if gravity [N] or mass [kg] was set by hand."""
        text = self.identity
        if self.gravity not in (None, gravity):
            text += f", gravity {gravity:g} N by hand"
        if self.mass not in (None, mass):
            text += f", mass {mass:g} kg by hand"
        return text

    def delay_flaw(self, latency: float) -> str:
        """Return why the loop is not the one of the calibration, empty if it is, or unknown.

        latency: measured now, from a sample to the write to the drive [s].
        """
        now = latency + self.drive_delay
        if not (latency and self.delay) or abs(now - self.delay) <= LARGEST_DELAY_CHANGE:
            return ""
        return (
            f"a sample's force comes after {1e3 * now:.2f} ms, in the module's calibration after "
            f"{1e3 * self.delay:.2f} ms, which OBSERVER expects: run torque_response and "
            "calibration again in this arrangement"
        )

    def law(self, settings: VerticalSettings) -> VerticalSettings:
        """Return the law's settings, in which OBSERVER carries no mass beyond the one measured."""
        return settings if self.mass is None else settings.carrying_at_most(self.mass)


def chosen_calibration(
    settings: CalibrationSettings, other: str, other_file: str
) -> ModuleCalibration | None:
    """Return the calibration that the settings name, None for none.

    other, other_file: name and value of the setting for a file with a part of the calibration; only
    one of both may be set. Raises SettingError.
    """
    path = settings.calibration_file
    if not path:
        return None
    if other_file:
        raise SettingError(
            f"{path}: it is named by calibration_file, and {other} names {other_file}; a "
            "calibration holds that too: empty one of the two parameters"
        )
    return load_module_calibration(path, settings.module_serial)


def chosen_gain_limits(settings: GainLimitsSettings, serial: str) -> GainLimits | None:
    """Return the gain limits that the settings name, None without a file. Raises SettingError.

    serial: of the connected module.
    """
    path = settings.gain_limits_file
    return load_gain_limits(path, serial) if path else None


def chosen_friction(settings: CalibrationSettings, path: str) -> ChosenFriction:
    """Return the friction model: of the module, of the file at `path`, or the thesis's.

    Raises SettingError.
    """
    module = chosen_calibration(settings, "friction_file", path)
    if module is None:
        file = path or resource_path(THESIS_FILE)
        return ChosenFriction(load_friction_model(file), file_identity(file))
    identity = module.identity(settings.calibration_file)
    return ChosenFriction(
        module.friction, identity, module.gravity_N, module.mass_kg, module.delay_s,
        module.drive_delay_s,
    )  # fmt: skip


def chosen_linearization(
    settings: CalibrationSettings, own: LinearizationSettings
) -> tuple[Linearization | None, str]:
    """Return the linearization, None if switched off, and its identity.

    An unused calibration is checked too. Raises SettingError.
    """
    path = own.linearization_file
    module = chosen_calibration(settings, "linearization_file", path)
    if not own.linearize:
        return None, "none"
    if module is not None:
        return module.linearization, module.identity(settings.calibration_file)
    if path:
        return load_linearization(path), file_identity(path)
    return default_linearization(), "thesis 4.1.1"


def file_identity(path: str | Path) -> str:
    """Return the identity of a file for logs and bags: its name and the hash of its bytes.

    Raises OSError when the file cannot be read.
    """
    digest = hashlib.sha256(Path(path).read_bytes()).hexdigest()
    return f"{Path(path).name} sha256:{digest[:12]}"
