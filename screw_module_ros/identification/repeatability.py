# SPDX-License-Identifier: Apache-2.0
"""Repeatability of two runs of the stage at one speed, bin by bin (thesis 5.2.4, fig 5-15)."""

from __future__ import annotations

from functools import partial
from typing import Annotated, NamedTuple

import numpy as np

from ..settings import Setting
from .figures import COLOURS, panels
from .friction_map import FORCE, HEIGHT
from .lab import Lab
from .results import STAGE, Drawn, Experiment, Quantity, Result
from .stage_runs import CENTRES_MM, binned, range_flaw, stage_run
from .trials import DIRECTIONS, StageTrial

NAME = "repeatability"
_WHOLE = 0.9  # least share of a bin's samples for the comparison


class Settings(NamedTuple):
    """The two runs in each direction."""

    speed: Annotated[float, Setting("of the stage", "m/s", 1e-4, 0.5)] = 0.050
    low: Annotated[float, Setting("lowest height of the handle", "m", 0.0, 0.3)] = 0.0
    high: Annotated[float, Setting("highest height of the handle", "m", 0.05, 0.36)] = 0.36
    apart: Annotated[
        float, Setting("offset of the second run's start", "m", 0.0, 0.01)
    ] = 0.001

    def flaw(self) -> str:
        """Return what is wrong with too short a way."""
        return range_flaw(self.low, self.high, 0.03)


def run(lab: Lab, settings: Settings) -> Result:
    """Compare two runs up, and two down.

    Data: `centres` [mm]; `up`, `down` [N], shape (2, 142), NaN for bins not measured. Raises the
    errors of `Lab.record`.
    """
    trials: dict[str, StageTrial] = {}
    for direction, sign in DIRECTIONS:
        run = stage_run(sign * float(settings.speed), settings.low, settings.high)
        again = run._replace(start=run.start + sign * settings.apart)
        trials |= {f"{direction}_1": run, f"{direction}_2": again}
    parts = lab.record(NAME, trials, partial(binned, screw=lab.stand.screw))
    data = {"centres": CENTRES_MM}
    quantities: list[Quantity] = []
    for direction, _ in DIRECTIONS:
        first, second = (parts[f"{direction}_{number}"] for number in (1, 2))
        data[direction] = np.array([first["force"], second["force"]])
        fewer = np.minimum(first["count"], second["count"])
        beyond = (second["force"] - first["force"])[fewer > _WHOLE * np.median(fewer)]
        beyond = beyond[np.isfinite(beyond)]
        spread, count = float(beyond.std(ddof=1)), len(beyond)
        noise = float(np.sqrt(np.nanmean(first["error"] ** 2 + second["error"] ** 2)))
        quantities += [
            Quantity(f"deviation_{direction}", spread, spread / np.sqrt(2.0 * (count - 1)), "N",
                     f"standard deviation of the difference, {direction}"),
            Quantity(f"difference_{direction}", float(beyond.mean()), spread / np.sqrt(count), "N",
                     f"mean difference, second minus first, {direction}"),
            Quantity(f"noise_{direction}", noise, np.nan, "N",
                     f"difference that noise makes, {direction}"),
        ]  # fmt: skip
    notes = (
        "On a simulated module friction repeats exactly; only the transducer's noise and zero "
        "differ. On a real module the difference limits the accuracy of every map.",
    )
    return Result(NAME, tuple(quantities), settings._asdict(), notes, data)


def draw(result: Result) -> Drawn:
    """Return figure 5-15, with the difference of the two runs."""
    speed = result.settings["speed"] * 1e3
    centres, (first, second) = result.data["centres"], result.data["up"]
    figure, (above, below) = panels(2, 1, (7.2, 5.4), sharex=True, height_ratios=(3, 1))
    above.plot(centres, first, color=COLOURS[0], label="first run")
    above.plot(centres, second, color=COLOURS[2], linestyle="--", label="second run")
    above.set(ylabel=FORCE, title=f"Fig. 5-15: two runs upward, {speed:g} mm/s")
    above.legend(loc="upper left")
    below.plot(centres, second - first, color=COLOURS[0])
    below.axhline(0.0, color="#888888", linewidth=0.6)
    below.set(xlabel=HEIGHT, ylabel="difference [N]", xlim=(0.0, 355.0))
    return {"5-15": figure}


EXPERIMENT = Experiment(
    NAME, "repeatability of two runs of the stage at one speed, bin by bin (thesis 5.2.4)",
    Settings, run, draw, STAGE,
)  # fmt: skip
