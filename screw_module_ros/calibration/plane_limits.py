# SPDX-License-Identifier: Apache-2.0
"""Gain limits of one plane, to which `manus` keeps: what its structure bears of the force feedback.

`identification/planar_stability` writes the file::

    format: screw_module_ros/plane_gain_limits
    version: 1
    serial: ARM-0007
    date: '2026-11-28T09:30:00Z'
    software: 0.2.0
    law: 0123456789ab             # version of the law for which they were found
    rate: 500.0                   # Hz
    force_cutoff: 7.0             # Hz
    found_by: sweep
    first_mode_Hz: 71.5
    largest_gains_on: {hand: 5.5, any_arm: 1.36}
    sha256: ...                   # of the text before it

They are those of a linear loop, as those of the vertical axis (`gain_limits`): a grip that is soft
bears less, and the guard ends what grows there.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, NamedTuple

from ..control.laws.plane_impedance import PLANE_IMPEDANCE
from ..control.planar_settings import PlanarSettings
from ..settings import Setting, SettingError
from ..settings_file import read_file
from .limits_file import was_changed
from .module import check_serial
from .plane_version import plane_law_version

FORMAT = "screw_module_ros/plane_gain_limits"
VERSION = 1
_AGAIN = "run planar_stability again"
WITHOUT = (
    "force_gain is {gain:g}, and no gain limits of this plane are known (gain_limits_file): run "
    "planar_stability, or set beyond_gain_limits on your own word"
)


class PlaneGainLimits(NamedTuple):
    """Gain limits of a plane; fields as the keys of their file."""

    serial: str
    date: str
    software: str
    law: str
    rate: Annotated[float, Setting("ticks per second", "Hz", 50.0, 10_000.0)]
    force_cutoff: Annotated[float, Setting("of the feedback", "Hz", 1.0, 100.0)]
    found_by: str
    first_mode_Hz: Annotated[float, Setting("of the structure", "Hz", 1.0, 1e6)]
    largest_gains_on: dict[str, float]
    sha256: str = ""

    @property
    def largest(self) -> float:
        """The limit: the smallest of the largest stable gains."""
        return min(self.largest_gains_on.values())

    def flaw(self) -> str:
        """Return what is wrong with the gains, empty if nothing is."""
        if wrong := [load for load, gain in self.largest_gains_on.items() if not gain >= 0.0]:
            return f"largest_gains_on.{wrong[0]}: 0 or more is wanted"
        return "" if self.largest_gains_on else "largest_gains_on: at least one is wanted"

    def refusal(self, law: PlanarSettings, rate: float) -> str:
        """Return why a law goes beyond the limits at a rate [Hz], empty if it does not."""
        said = ""
        if law.force_gain > self.largest:
            said = f"force_gain is {law.force_gain:g}, and the limits are {self.largest:g} at most"
        elif law.force_gain and (rate < self.rate or law.force_cutoff > self.force_cutoff):
            said = (
                f"rate and force_cutoff are {rate:g} and {law.force_cutoff:g} Hz, and the limits "
                f"are for {self.rate:g} Hz at least and {self.force_cutoff:g} Hz at most"
            )
        return said and f"{said} ({self.serial} {self.date}), or set beyond_gain_limits"


def load_plane_limits(path: str | Path, serial: str) -> PlaneGainLimits:
    """Return the gain limits of the plane with that serial.

    Raises SettingError naming file, key and problem: when the file cannot be read, was changed, or
    belongs to another plane or another version of the law.
    """
    found = read_file(path, PlaneGainLimits, FORMAT, VERSION)
    if was_changed(path, found.sha256):
        raise SettingError(f"{path}: sha256: the file was changed after it was written: {_AGAIN}")
    check_serial(path, found.serial, serial)
    if found.law != (version := plane_law_version(PLANE_IMPEDANCE)):
        raise SettingError(
            f"{path}: law: its gains were found for version {found.law} of the plane's law, this "
            f"software has {version}: {_AGAIN}, or empty gain_limits_file"
        )
    return found
