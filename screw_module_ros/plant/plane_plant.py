# SPDX-License-Identifier: Apache-2.0
"""What the simulated rig needs of a planar arm: its physics as one object, this package's or not.

A plant of another package is one file too. It shares no formula with the arm that the controller
has (`control/arms.py`): a simulation that does proves nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from .. import plugin_flaws, plugins
from .patient import ArmForce
from .planar import (
    ManusInput,
    ManusState,
    Planar,
    handle_place,
    motor_torques,
    planar_params,
    planar_step,
    resting_plane,
)

GROUP = "screw_module_ros.plane_plants"
"""Entry points that name plants of other packages."""


@dataclass(frozen=True, eq=False)
class PlanePlant:
    """The physics of a planar arm, which is itself alone. `own`: its settings.

    rest(own, x, y): at rest with the handle there [m]; params(own, hand, dt): a NamedTuple of
    numbers, for substeps of dt [s] with that arm of the patient; step(params, state, input): a
    substep further, with `pull_y` and `vigour` of the patient; place(own, state): x, y of the
    handle [m]; torques(own, state, shoulder_braked, elbow_braked): on both joints, braked [Nm].
    Angles are those that the drives measure; where a plant has no bristles and does not bend, these
    numbers of the state stay 0. `step` is compiled: functions at the top of modules, numbers,
    `math`.

    name: as shown; settings: a NamedTuple with defaults.
    """

    name: str
    settings: Any
    rest: Callable[[Any, float, float], ManusState]
    params: Callable[[Any, ArmForce, float], Any]
    step: Callable[[Any, ManusState, ManusInput], ManusState]
    place: Callable[[Any, ManusState], tuple[float, float]]
    torques: Callable[[Any, ManusState, bool, bool], tuple[float, float]]


MANUS_PLANT = PlanePlant(
    "five_bar", Planar, resting_plane, planar_params, planar_step, handle_place, motor_torques
)
"""MIT-MANUS; its numbers stand in the plant's file."""


def load(path: str) -> PlanePlant:
    """Return the plant `package.module:NAME`, or of an entry point of that name.

    Empty, or `five_bar`: this package's. Raises SettingError when there is none.
    """
    if path in ("", MANUS_PLANT.name):
        return MANUS_PLANT
    plant = plugins.load(path, GROUP, "plane_plant")
    return plugin_flaws.taken(plant, f"plane_plant {path}", PlanePlant, _flaw)


def _flaw(plant: PlanePlant) -> str:
    functions = ("rest", "params", "step", "place", "torques")
    wrong = plugin_flaws.functions_flaw(plant, functions)
    return wrong or plugin_flaws.settings_flaw(plant.settings)
