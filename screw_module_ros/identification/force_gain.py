# SPDX-License-Identifier: Apache-2.0
"""Largest force gain without chatter, with backlash and with a preloaded nut (thesis 6.4.3).

The thesis's hardware chatters at gains much above 5; the thesis supposes backlash as the cause, as
its simulation without backlash allowed 50. Here the handle moves as in that simulation, at rising
gains, and bisection then locates the onset of chatter. Chatter is 0.2 N rms of force above 30 Hz
over the whole trial: three times the noise, and more than the jolts at reversals under PD. It comes
in bursts where friction is low, as in the thesis. The law's rate limit keeps the bursts below a few
newtons, so the criterion is the onset and not instability.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from ..control import modes
from ..control.vertical_settings import VerticalSettings
from ..offset import Spring, offsets
from ..settings import Setting
from .figures import COLOURS, CREDIT, DESIRED, panels
from .force_metric import RAPID, above
from .lab import Lab, Part
from .results import HUMAN_ARM, Drawn, Experiment, Published, Quantity, Result, beside
from .trials import MotionTrial, Samples

NAME = "force_gain"
_WITH = (
    "the friction of the handle's guide and the axial support of the screw are assumed; the guide "
    "damps the nut in its play, and the less there is of either, the smaller is the gain at which "
    "chatter begins: 11 on a rigid support"
)
_CHOSEN = (
    "contact stiffness, contact damping and film damping of the play, so that on a rigid support a "
    "gain of 5 runs and chatter begins not far above it"
)
_WITHOUT = (
    "at the thesis's 50 its simulation was not unstable; here the criterion is lasting chatter of "
    "0.2 N rms, which sampling, the delay of 350 us, the 30 Hz force filter and the stiffness of "
    "contact and axial support cause at a smaller gain (15 on a rigid support); beyond it the "
    "chatter stays bounded"
)
# Both are bounds in the thesis and no onsets: its hardware ran well at 5 and chattered much above,
# its simulation was stable at 50.
THESIS = {
    "gain_with_backlash": Published("chatter_gain", 5.0, _WITH, chosen_by=_CHOSEN),
    "gain_without_backlash": Published("simulated_gain", 10.0, _WITHOUT),
}
_SETTLE_S = 0.5


class Settings(NamedTuple):
    """Search of the onset."""

    gains: Annotated[tuple[float, ...], Setting("gains of the first sweep", "", 0.0, 50.0)] = (
        0.0, 1.0, 2.0, 3.0, 5.0, 7.0, 9.0, 12.0, 16.0, 22.0, 30.0, 40.0, 50.0,
    )  # fmt: skip
    chatter: Annotated[
        float, Setting("rms of the force above 30 Hz that counts as chatter", "N", 0.1, 50.0)
    ] = 0.2
    resolution: Annotated[float, Setting("of the gain found", "", 0.05, 5.0)] = 0.5
    duration: Annotated[float, Setting("of each trial", "s", 2.0, 120.0)] = 31.4
    preloaded: Annotated[bool, Setting("also with a nut without backlash")] = True


def run(lab: Lab, settings: Settings) -> Result:
    """Find the onset of chatter. Raises Cancelled, NotPossible."""
    quantities: list[Quantity] = []
    data: dict[str, np.ndarray] = {}
    nuts = {False: "with backlash", True: "without backlash"}
    # The preloaded nut first: a stand that has none refuses it before an hour of other trials.
    swept = {
        nut: _tried(lab, settings, nut, settings.gains) for nut in (True, False)
        if settings.preloaded or not nut
    }  # fmt: skip
    for preloaded, rows in reversed(swept.items()):
        low, high = onset(rows, settings.chatter)
        while math.isfinite(high) and high - low > settings.resolution:
            rows |= _tried(lab, settings, preloaded, (0.5 * (low + high),))
            low, high = onset(rows, settings.chatter)
        half, label = 0.5 * (high - low) if math.isfinite(high) else math.nan, nuts[preloaded]
        quantities.append(Quantity(f"gain_{label.replace(' ', '_')}", low, half, "",
                                   f"largest force gain without chatter, {label}"))  # fmt: skip
        data[label] = np.array([(gain, *rows[gain]) for gain in sorted(rows)])
    notes: tuple[str, ...] = ()
    if len(data) == 2 and not math.isfinite(quantities[1].uncertainty):
        notes = ("Without backlash no gain up to the law's own limit of 50 chattered.",)
    return Result(NAME, beside(THESIS, quantities), settings._asdict(), notes, data)


def onset(rows: dict[float, tuple[float, float]], chatter: float) -> tuple[float, float]:
    """Return the largest gain without chatter below the first with chatter, and that gain.

    rows: gain -> (offset [N], rms above 30 Hz [N]). The second is infinite without chatter.
    """
    bad = [gain for gain, (_, rms) in rows.items() if rms > chatter]
    high = min(bad, default=math.inf)
    return max((gain for gain in rows if gain < high), default=0.0), high


def reduced(trial: MotionTrial, samples: Samples) -> Part:
    """Return mean offset [N] and the rms of the force above 30 Hz [N]."""
    period = samples.time[1] - samples.time[0]
    settled = above(RAPID, samples.force, period)[round(_SETTLE_S / period) :]
    spring = Spring(trial.settings.stiffness, trial.centre)
    found = offsets(samples.position, samples.velocity, samples.force, spring)
    return {"offset": np.array(found.mean), "rms": np.array(np.sqrt(np.mean(settled**2)))}


def _tried(
    lab: Lab, settings: Settings, preloaded: bool, gains: tuple[float, ...]
) -> dict[float, tuple[float, float]]:
    trials = {
        f"gain_{gain:g}{'_preloaded' if preloaded else ''}": MotionTrial(
            modes.FORCE_FEEDBACK,
            VerticalSettings(force_gain=gain, chatter_limit=50.0),
            duration=settings.duration,
            preloaded=preloaded,
        )
        for gain in gains
    }
    return rows_of(lab.record(NAME, trials, reduced), trials)


def rows_of(
    parts: dict[str, Part], trials: dict[str, MotionTrial]
) -> dict[float, tuple[float, float]]:
    """Return gain -> (offset [N], rms above 30 Hz [N]) of the trials, one for each gain."""
    return {
        trial.settings.force_gain: (float(parts[name]["offset"]), float(parts[name]["rms"]))
        for name, trial in trials.items()
    }


def draw(result: Result) -> Drawn:
    """Draw chatter and offset against the force gain, with and without backlash."""
    figure, (above, below) = panels(2, 1, (7.2, 5.4), sharex=True)
    for colour, (label, table) in zip(COLOURS, result.data.items(), strict=False):
        for axes, column in ((above, 2), (below, 1)):
            axes.plot(table[:, 0], table[:, column], color=colour, marker="o", markersize=3.5,
                      label=label)  # fmt: skip
    above.axhline(result.settings["chatter"], color=DESIRED, linewidth=0.8, linestyle="--")
    above.annotate(
        "chatter", (0.99, result.settings["chatter"]), xycoords=("axes fraction", "data"),
        xytext=(0, 3), textcoords="offset points", ha="right", fontsize=9,
    )  # fmt: skip
    above.set(ylabel="force above 30 Hz, rms [N]", yscale="log", title="Largest force gain (6.4.3)")
    above.legend(loc="lower right")
    below.set(xlabel="force gain $K_f$", ylabel="mean offset [N]", ylim=(0.0, None))
    for quantity, colour in zip(result.quantities, COLOURS, strict=False):
        if quantity.thesis:
            below.axvline(quantity.thesis.value, color=colour, linestyle=":", linewidth=1.8,
                          label=f"{quantity.thesis.value:g} in 6.4.3 ({CREDIT})")  # fmt: skip
    below.legend(loc="best")
    return {"force_gain": figure}


EXPERIMENT = Experiment(
    NAME, "largest force gain without chatter, with backlash and with a preloaded nut (6.4.3)",
    Settings, run, draw, HUMAN_ARM,
)  # fmt: skip
