# SPDX-License-Identifier: Apache-2.0
"""Largest force gain of the plane against the stiffness of its structure, predicted and felt.

The encoders stand at the joints, the force sensor at the handle; between them links, bearings and
flange bend (`plant.planar`). `planar_sampled_loop` predicts the largest stable gain for each
stiffness, in a rigid hand, with an arm of 30 kg and in a soft grip, while the joints slide. In
simulation a rigid hand moves the handle fast, and the force error tells what the guard leaves of a
gain beyond that.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np

from ..control.planar_settings import STUDIED_GAIN, PlanarSettings
from ..settings import Setting, validated
from .figures import COLOURS, DESIRED, panels
from .lab import Lab
from .planar_error import error_of, reduced, trial_of
from .planar_sampled_loop import MOST, Plane, first_modes, largest_gain
from .results import DERIVED, HUMAN_ARM, Drawn, Experiment, Quantity, Result
from .stability import ENVIRONMENTS as LOADS
from .trials import PlaneLoop, require

NAME = "planar_stability"
ENVIRONMENTS = {name: LOADS[name] for name in ("hand", "heavy_arm", "soft_grip")}
RIGID = 1e9  # [N/m] from here on the table says so
_CASE = "fast_between"


class Settings(NamedTuple):
    """Stiffnesses of the structure, and the gains that are tried in simulation."""

    stiffnesses: Annotated[
        tuple[float, ...], Setting("of the structure", "N/m", 1e3, 1e13)
    ] = (5e4, 1e5, 2e5, 4e5, 1e6, RIGID)
    gains: Annotated[tuple[float, ...], Setting("force gains", "", 0.0, MOST)] = (
        0.0, 2.0, STUDIED_GAIN,
    )  # fmt: skip
    damping: Annotated[float, Setting("of the law's damper", "Ns/m", 0.0, 200.0)] = 10.0


def run(lab: Lab, settings: Settings) -> Result:
    """Predict and simulate. Raises ValueError, NotPossible on a real robot, Cancelled."""
    validated(settings)
    law, loop = PlanarSettings(damping=settings.damping), PlaneLoop()
    trials = {}
    for stiffness in settings.stiffnesses:
        for gain in settings.gains:
            trial = trial_of(_CASE, law._replace(force_gain=gain))
            trials[f"gain_{gain:g}_{_name(stiffness)}"] = trial._replace(
                loop=loop, structure_stiffness=stiffness
            )
    for trial in trials.values():
        require(trial, lab.stand)
    stand: Any = lab.stand  # a simulated one, which offers trials of the plane
    errors = {name: error_of(part) for name, part in lab.record(NAME, trials, reduced).items()}
    quantities = []
    for stiffness in settings.stiffnesses:
        robot = stand.world.planar._replace(structure_stiffness=stiffness)
        end, on = _name(stiffness), f"on a structure of {_said(stiffness)}"
        for which, mode in zip(("low", "high"), first_modes(Plane(robot)), strict=True):
            text = f"module {on}, joints and handle free, {which}er of two"
            quantities.append(Quantity(f"mode_{which}_{end}", mode, math.nan, "Hz", text, DERIVED))
        for name, (load, environment) in ENVIRONMENTS.items():
            gain = largest_gain(Plane(robot, environment), loop, law)
            half = 0.005 * gain if 0.0 < gain < math.inf else math.nan  # of the last interval
            text = f"largest stable gain predicted, {load}, {on}"
            if math.isinf(gain):
                text += f"; none up to {MOST:g} is unstable"
            quantities.append(Quantity(f"limit_{name}_{end}", gain, half, "", text, DERIVED))
        for gain in settings.gains:
            error = errors[f"gain_{gain:g}_{end}"]
            text = f"in fast motion in a rigid hand, gain {gain:g}, {on}"
            quantities += (
                Quantity(f"rms_{gain:g}_{end}", error.rms, math.nan, "N", f"rms error {text}"),
                Quantity(f"share_{gain:g}_{end}", error.share, math.nan, "",
                         f"share of the gain that is left {text}"),
            )  # fmt: skip
    return Result(NAME, tuple(quantities), settings._asdict(), _NOTES)


_NOTES = (
    "The linear loop has the law, the velocity filters, counts apart, the delay and the age of the "
    "force as in `manus`; viscous friction, but no dry friction: that of a joint at rest "
    "stabilises.",
    "The force feedback is an integral of the force below its cut-off w: it meets the first mode "
    "W with the gain k w / W, and the mode answers with 1 / (2 zeta). So stiffness and damping of "
    "the structure bound the gain; with a stiff one the delay does. In a soft grip its damping "
    "does.",
    "The structure's stiffness and damping are estimates: no real plane's were found.",
)


def _name(stiffness: float) -> str:
    return f"{stiffness:.0f}"


def _said(stiffness: float) -> str:
    return f"{stiffness:.3g} N/m" if stiffness < RIGID else "no compliance"


def draw(result: Result) -> Drawn:
    """Draw the predicted gains and the felt errors over the stiffness."""
    stiffnesses = result.settings["stiffnesses"]
    places = np.arange(len(stiffnesses))
    figure, (left, right) = panels(1, 2, (8.6, 4.8))
    for number, (name, (text, _)) in enumerate(ENVIRONMENTS.items()):
        gains = np.array([result.value(f"limit_{name}_{_name(k)}") for k in stiffnesses])
        colour, beyond = COLOURS[number], np.isinf(gains)
        left.plot(places, np.minimum(gains, MOST), "o-", color=colour, markersize=4, label=text)
        left.plot(places[beyond], np.full(beyond.sum(), MOST), "^", color=colour, markersize=9,
                  markerfacecolor="none")  # fmt: skip
    left.axhline(STUDIED_GAIN, color=DESIRED, linewidth=0.8, linestyle="--")
    left.set(title="Largest stable gain of the linear loop", yscale="log", ylabel="force gain")
    for number, gain in enumerate(result.settings["gains"]):
        felt = [result.value(f"rms_{gain:g}_{_name(k)}") for k in stiffnesses]
        right.plot(places, felt, "o-", color=COLOURS[number], markersize=4, label=f"gain {gain:g}")
    right.set(title="Felt in fast motion, rigid hand", ylim=(0.0, None),
              ylabel="rms force error [N]")  # fmt: skip
    marks = ["rigid" if k >= RIGID else f"{1e-3 * k:g}" for k in stiffnesses]
    for axes in (left, right):
        axes.set_xticks(places, marks)
        axes.set_xlabel("stiffness of the structure [kN/m]")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), fontsize=8)
    figure.suptitle(
        f"The plane's structure and its force gain. Dashed: {STUDIED_GAIN:g}. "
        f"Triangle: no limit up to {MOST:g}", x=0.01, ha="left",
    )  # fmt: skip
    return {"planar stability": figure}


EXPERIMENT = Experiment(
    NAME, "largest stable force gain of the plane against its structure's stiffness, and the error",
    Settings, run, draw, HUMAN_ARM,
)  # fmt: skip
