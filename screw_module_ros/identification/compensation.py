# SPDX-License-Identifier: Apache-2.0
"""Benefit of the identified model: feed-forward with it and with the thesis's default (6.4.2).

The hand moves through the spring of 100 N/m as in figure 6-8, once with the thesis's printed model
(friction of 5.2.5, 10 N of gravity, dead zone of 0.025 Nm) and once with the model identified on
this module; also without feed-forward, and with additional force feedback (6.4.4). On the nominal
simulated module the printed model is the plant's own polynomial: what it is worth on a module that
it was not made for is seen on a perturbed one.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ..control import modes
from ..control.vertical_settings import VerticalSettings
from ..settings import Setting
from . import friction_model, gravity, static_torque
from .figures import Trace, force_position
from .force_metric import Spring
from .force_position import reduced
from .lab import Lab, Part
from .results import HUMAN_ARM, Experiment, Quantity, Result
from .trials import MotionTrial

NAME = "compensation"
_MODES = {
    "pd": modes.IMPEDANCE,
    "feed_forward": modes.FRICTION_COMPENSATION,
    "combined": modes.COMBINED,
}
_STIFFNESS = 100.0  # [N/m], thesis 6.1


class Settings(NamedTuple):
    """Motion of the hand, and gains."""

    amplitude: Annotated[float, Setting("of the virtual hand", "m", 0.02, 0.15)] = 0.15
    omega: Annotated[float, Setting("of the hand", "rad/s", 0.05, 3.0)] = 0.8
    cycles: Annotated[float, Setting("of the hand", "", 1.0, 20.0)] = 3.0
    fraction: Annotated[
        float, Setting("share of the modelled friction that is fed forward", "", 0.0, 1.0)
    ] = 0.9
    force_gain: Annotated[float, Setting("of the combined law", "", 0.0, 10.0)] = 5.0


def run(lab: Lab, settings: Settings) -> Result:
    """Measure with both models. Raises MissingResult without the module's results, Cancelled."""
    identified = {
        "friction": friction_model.friction_model_of(lab.result(friction_model.NAME)),
        "linearization": static_torque.linearization_of(lab.result(static_torque.NAME)),
    }
    own_gravity = lab.result(gravity.NAME).value("gravity")
    trials = {}
    for model, weight, options in (("default", 10.0, {}), ("identified", own_gravity, identified)):
        for name, mode in _MODES.items():
            law = VerticalSettings(
                stiffness=_STIFFNESS,
                gravity=weight,
                friction_fraction=settings.fraction,
                force_gain=settings.force_gain,
            )
            trials[f"{name}_{model}"] = MotionTrial(
                mode,
                law,
                amplitude=settings.amplitude,
                omega=settings.omega,
                duration=settings.cycles * 2.0 * math.pi / settings.omega,
                **options,
            )
    parts = lab.record(NAME, trials, reduced)
    data = {
        f"{name}/{column}": part[column]
        for name, part in parts.items()
        for column in ("position", "velocity", "force")
    }
    return Result(NAME, tuple(_quantities(parts)), settings._asdict(), (), data)


def _quantities(parts: dict[str, Part]) -> list[Quantity]:
    found = []
    for name, part in parts.items():
        text = f"mean offset from the spring in motion, {name.replace('_', ', ')} model"
        found.append(
            Quantity(f"offset_{name}", float(part["offset"]), float(part["spread"]), "N", text)
        )
    before, after = (float(parts[f"feed_forward_{m}"]["offset"]) for m in ("default", "identified"))
    spread = [float(parts[f"feed_forward_{m}"]["spread"]) for m in ("default", "identified")]
    ratio = after / before
    found.append(
        Quantity(
            "ratio",
            ratio,
            ratio * float(np.hypot(spread[0] / before, spread[1] / after)),
            "",
            "offset with the identified model over that with the thesis's default",
        )
    )
    return found


def draw(result: Result) -> dict[str, Figure]:
    """Draw feed-forward with the thesis's model and with the identified one."""
    names = {
        "pd_default": "PD",
        "feed_forward_default": "thesis's model fed forward",
        "feed_forward_identified": "identified model fed forward",
    }
    columns = ("position", "velocity", "force")
    traces = [
        Trace(label, *(result.data[f"{name}/{column}"] for column in columns))
        for name, label in names.items()
    ]
    figure = force_position(traces, Spring(_STIFFNESS, 0.18), "Benefit of the identified model")
    return {"compensation": figure}


EXPERIMENT = Experiment(
    NAME, "benefit of the identified model: feed-forward with it and with the thesis's (6.4.2)",
    Settings, run, draw, HUMAN_ARM, ("static_torque", "gravity", "friction_model"),
)  # fmt: skip
