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
from . import GROUP, MOST_SHOWN
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
    if not isinstance(law, PlaneLaw):
        raise SettingError(
            f"law {path}: it is no screw_module_ros.control.plane_law.PlaneLaw"
        )
    if wrong := plugin_flaws.first_flaw(law, flaw, flaw_of_plane_calls):
        raise SettingError(f"law {path}: {wrong}")
    return law


def flaw(law: PlaneLaw) -> str:
    """Return why a law of others cannot be taken, empty if it can."""
    return plugin_flaws.first_flaw(law, _flaw)


def _flaw(law: PlaneLaw) -> str:
    functions = ("memory", "needs", "ask", "help", "rest", "own", "refusal")
    wrong = plugin_flaws.prefix_flaw(law.name) or plugin_flaws.functions_flaw(law, functions)
    if wrong:
        return wrong
    if law.heeds:
        return "it heeds the guard by itself: the envelope does that for laws of other packages"
    if law.name in [known.name for known in PLANE_LAWS]:
        return f"{law.name} is the name of a law of this package: choose another one"
    if wrong := plugin_flaws.shown_flaw(law.shown, MOST_SHOWN):
        return wrong
    if law.settings is PlanarSettings:
        return "its settings are those of the plane: make a NamedTuple of your own"
    return plugin_flaws.settings_flaw(law.settings)


def own_of(law: PlaneLaw, p: PlanarSettings, chosen: Any = None) -> Any:
    """Return what a law's functions get; p: settings of the plane, which are those of this
    package's law too; chosen: of a law of others, None = its defaults."""
    if law.settings is PlanarSettings:
        return law.own(p, p)
    return law.own(law.settings() if chosen is None else chosen, p)
