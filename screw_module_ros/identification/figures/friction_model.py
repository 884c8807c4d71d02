# SPDX-License-Identifier: Apache-2.0
"""Figures of the friction model beside the maps (thesis figs 5-24 to 5-30), and of the weight."""

from __future__ import annotations

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from screw_module_ros.figure_style import COLOURS, DESIRED, STYLE

from ...control.friction import FrictionModel
from ..friction_fit import WITHIN, friction_model_of
from ..friction_form import ripple_phase, speed_factor
from ..results import Result
from .friction_maps import FORCE, HEIGHT, SPEED, axes_for

_RESIDUALS = (("5-27", "up", (5.0, 20.0)), ("5-30", "down", (5.0, 40.0)))  # [mm/s]


def friction_model_figures(result: Result) -> dict[str, Figure]:
    """Return the figures by number."""
    model = friction_model_of(result)
    found = {
        "5-24": _place(result, model, "up", False, "Fig. 5-24: mean over the speeds and its trend"),
        "5-25": _place(result, model, "up", True, "Fig. 5-25: the same with the screw's ripple"),
        "5-26": _factor(result, model, "up", "Fig. 5-26: factor of the speed, upward"),
        "5-28": _place(result, model, "down", True, "Fig. 5-28: mean over the speeds, downward"),
        "5-29": _factor(result, model, "down", "Fig. 5-29: factor of the speed, downward"),
    }
    for number, direction, speeds in _RESIDUALS:
        found[number] = _residuals(result, direction, speeds, number)
    return found


def _place(
    result: Result, model: FrictionModel, direction: str, ripple: bool, title: str
) -> Figure:
    """Draw the mean force over the speeds and the model's dependence on height."""
    branch = getattr(model, direction)
    z = result.data["centres"]
    fine = np.linspace(model.low_mm, model.high_mm, 1000)
    trend = np.polyval(branch.trend, fine)
    amplitude = np.polyval(branch.ripple, fine)
    phase = ripple_phase(fine, model.lead_mm, model.phase_rad, branch.flip_below_mm)
    full = trend + amplitude * phase
    with rc_context(STYLE):
        figure, axes = axes_for(HEIGHT, FORCE)
        axes.plot(z, _levelled(result, model, direction), color=COLOURS[0], label="measured")
        axes.plot(fine, trend, color=DESIRED, linestyle="--", label="trend, 7th order")
        if ripple:
            axes.plot(fine, full, color=COLOURS[2], linestyle="--", label="with ripple")
        if ripple and model.low_mm < branch.flip_below_mm < model.high_mm:
            axes.axvline(branch.flip_below_mm, color="#888888", linewidth=0.8, linestyle=":")
            axes.annotate(
                "ripple turns over", (branch.flip_below_mm, 0.02), xytext=(4, 0), va="bottom",
                xycoords=("data", "axes fraction"), textcoords="offset points", color="#555555",
            )  # fmt: skip
        axes.set_xlim(model.low_mm, model.high_mm)
        axes.set_title(title, loc="left")
        axes.legend(loc="best")
    return figure


def _levelled(result: Result, model: FrictionModel, direction: str) -> np.ndarray:
    """Return the mean over the speeds [N], with the model's factor for missing cells."""
    factor = speed_factor(getattr(model, direction), result.data["speeds"])[:, None]
    friction = result.data[f"force_{direction}"] - model.gravity_N
    share = np.where(np.isfinite(friction), factor, np.nan)
    return np.nansum(friction, axis=0) / np.nansum(share, axis=0) + model.gravity_N


def _factor(result: Result, model: FrictionModel, direction: str, title: str) -> Figure:
    """Draw friction, averaged over the heights and normalised, and the model's factor."""
    branch = getattr(model, direction)
    speeds = result.data["speeds"]
    friction = np.abs(result.data[f"force_{direction}"] - model.gravity_N)
    whole = np.isfinite(friction).all(axis=0)
    level = friction[:, whole].mean(axis=1)
    fine = np.linspace(0.1, speeds[-1], 600)
    with rc_context(STYLE):
        figure, axes = axes_for(SPEED, "friction over its mean over the speeds")
        axes.plot(speeds, level / level.mean(), "o", color=COLOURS[0], label="measured")
        axes.plot(
            fine, speed_factor(branch, fine), "--", color=COLOURS[2],
            label=f"power of {branch.low_exponent:.2f} up to {branch.break_speed_mm_s:.1f} mm/s, "
            f"then {branch.high_slope:.5f} v + {branch.high_offset:.3f}",
        )  # fmt: skip
        axes.set_xlim(0.0, speeds[-1])
        axes.set_title(title, loc="left")
        axes.legend(loc="lower right")
    return figure


def _residuals(result: Result, direction: str, speeds: tuple[float, float], number: str) -> Figure:
    """Draw measured minus modelled force over height at two speeds."""
    with rc_context(STYLE):
        figure = Figure(figsize=(9.6, 4.0), layout="constrained")
        panels = figure.subplots(1, 2, sharey=True)
        for axes, wanted in zip(panels, speeds, strict=True):
            row = int(np.argmin(np.abs(result.data["speeds"] - wanted)))
            left = result.data[f"residual_{direction}"][row]
            axes.axhspan(-WITHIN, WITHIN, color="#eeeeee", zorder=0)
            axes.plot(result.data["centres"], left, color=COLOURS[0])
            axes.set_xlim(0.0, 355.0)
            axes.set_ylim(-4.0, 4.0)
            axes.set_xlabel(HEIGHT)
            axes.text(
                0.02, 0.96, f"{result.data['speeds'][row]:g} mm/s", transform=axes.transAxes,
                va="top",
            )  # fmt: skip
        panels[0].set_ylabel("measured minus modelled force [N]")
        panels[0].set_title(
            f"Fig. {number}: what the model leaves, {direction}ward; grey: within 2 N", loc="left"
        )
    return figure


def gravity_figures(result: Result) -> dict[str, Figure]:
    """Return the figure of the force while the handle crosses the play (ours)."""
    with rc_context(STYLE):
        figure, axes = axes_for("handle against nut [mm]", "force, against gravity positive [N]")
        speeds = sorted({float(row[2]) for row in result.data["crossings"]})
        named = set()
        for name, row in zip(result.data["jobs"], result.data["crossings"], strict=True):
            sign, _, speed, _, _, force, _ = row
            if not np.isfinite(force):
                continue
            gap = result.data[f"gap_{name}"] * 1e3
            number = speeds.index(float(speed))
            axes.plot(
                gap, sign * result.data[f"force_{name}"], ".", markersize=2.0, alpha=0.35,
                color=COLOURS[number % len(COLOURS)],
                label=None if speed in named else f"{speed * 1e3:g} mm/s",
            )  # fmt: skip
            named.add(speed)
        weight = result.value("gravity")
        axes.axhline(weight, color=DESIRED, linestyle="--", label=f"weight, {weight:.2f} N")
        axes.set_title("Weight while the handle crosses the play", loc="left")
        axes.legend(loc="lower right", markerscale=5.0)
    return {"play": figure}
