# SPDX-License-Identifier: Apache-2.0
"""The laws of the plane: this package's, and those of others. Only one of them is there at a time.
"""

from __future__ import annotations

from typing import Any

from ... import plugin_flaws, plugins
from ...settings import SettingError
from ..law import Law
from ..planar_settings import PlanarSettings
from ..plane_law import PlaneLaw
from . import GROUP, head_flaw, settings_of
from .plane_impedance import PLANE_IMPEDANCE
from .plane_rehearsal import flaw_of_plane_calls

PLANE_LAWS: tuple[PlaneLaw, ...] = (PLANE_IMPEDANCE,)


def load(path: str) -> PlaneLaw:
    """Return the law of a name here, `package.module:NAME`, or of an entry point of that name.

    Raises SettingError when there is none, or when it is not one that others may bring: see `flaw`
    and `flaw_of_plane_calls`, which calls its functions.
    """
    for known in PLANE_LAWS:
        if path == known.name:
            return known
    law = plugins.load(path, GROUP, "law")
    if isinstance(law, Law):
        raise SettingError(
            f"law {path}: it is a law of the vertical axis: for `laws` of impedance_controller"
        )
    return plugin_flaws.taken(law, f"law {path}", PlaneLaw, flaw, flaw_of_plane_calls)


def flaw(law: PlaneLaw) -> str:
    """Return why a law of others cannot be taken, empty if it can."""
    return plugin_flaws.first_flaw(law, _flaw)


def _flaw(law: PlaneLaw) -> str:
    if wrong := head_flaw(law, "needs"):
        return wrong
    if law.name in [known.name for known in PLANE_LAWS]:
        return f"{law.name} is the name of a law of this package: choose another one"
    if law.settings is PlanarSettings:
        return "its settings are those of the plane: make a NamedTuple of your own"
    return plugin_flaws.settings_flaw(law.settings)


def own_of(law: PlaneLaw, p: PlanarSettings, chosen: Any = None) -> Any:
    """Return what a law's functions get; p: settings of the plane; chosen: see `settings_of`."""
    return law.own(settings_of(law, p, chosen), p)
