# SPDX-License-Identifier: Apache-2.0
"""Fit of the thesis's friction model to the measured maps (thesis 5.2.5, figs 5-24 to 5-30).

`friction_refine` does the fit. This module reads maps and weight, makes the model and evaluates it:
share of the maps' cells within 2 N, for the fit and for the thesis's own coefficients.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from ..calibration.module import thesis_friction
from ..control.friction import FrictionBranch, FrictionModel
from ..geometry import SCREW
from ..settings import Setting, validated
from . import friction_map, gravity
from .friction_form import branch_of, friction_along, held_force, speed_factor
from .friction_refine import Fitted, fit_maps
from .lab import Lab
from .results import Quantity, Result
from .trials import DIRECTIONS

NAME = "friction_model"
WITHIN = 2.0  # "in most cases the error is between -2 and +2 N" (5.2.5)


class Settings(NamedTuple):
    """Settings of the fit; the data come from friction_map and gravity."""

    ramp_speed: Annotated[
        float, Setting("the controller's model is linear below this speed", "m/s", 1e-4, 0.02)
    ] = 0.002
    flip_gain: Annotated[
        float, Setting("least reduction of the squared error by a ripple flip", "", 0.0, 1.0)
    ] = 0.1


def run(lab: Lab, settings: Settings) -> Result:
    """Fit the model; needs the results of friction_map and gravity.

    Data: see `friction_model_of`; `centres` [mm], `speeds` [mm/s], `force_up`, `residual_up` and
    the same down [N], shape (speeds, bins). Raises MissingResult, ValueError for maps with too few
    cells.
    """
    validated(settings)
    maps, weighed = lab.result(friction_map.NAME).data, lab.result(gravity.NAME)
    weight = weighed.value("gravity")
    speeds, z = maps["speeds"] * 1e3, maps["centres"]
    friction = {"up": maps["up"] - weight, "down": maps["down"] - weight}
    fitted = fit_maps(z, speeds, friction["up"], friction["down"], settings.flip_gain)
    model = _model(fitted, speeds, weight, settings)
    data = {"centres": z, "speeds": speeds, **_as_data(model)}
    for direction, _ in DIRECTIONS:
        data[f"force_{direction}"] = maps[direction]
        data[f"residual_{direction}"] = beyond(model, data, direction)
    thesis = thesis_friction()
    quantities = _quantities(fitted, model, data, weighed.quantity("gravity"), thesis)
    return Result(NAME, quantities, settings._asdict(), _notes(model, data), data)


def friction_model_of(result: Result) -> FrictionModel:
    """Return the model for the controller from this experiment's result."""
    low, high, fastest, ramp, lead, phase, weight = map(float, result.data["common"])
    branches = (
        FrictionBranch(
            tuple(map(float, result.data[f"{direction}_trend"])),
            tuple(map(float, result.data[f"{direction}_ripple"])),
            *map(float, result.data[f"{direction}_shape"]),
        )
        for direction, _ in DIRECTIONS
    )
    return FrictionModel(low, high, fastest, ramp, lead, phase, weight, *branches)


def _model(
    fitted: Fitted, speeds: np.ndarray, weight: float, settings: Settings
) -> FrictionModel:
    up, down = (branch_of(b, speeds, fitted.low, fitted.high, weight) for b in fitted.branches)
    phase = float(np.angle(np.exp(1j * fitted.phase)))
    ramp, lead = settings.ramp_speed * 1e3, SCREW.lead * 1e3
    return FrictionModel(
        fitted.low, fitted.high, float(speeds.max()), ramp, lead, phase, weight, up, down
    )


def _as_data(model: FrictionModel) -> dict[str, np.ndarray]:
    """Return the model as arrays; `friction_model_of` reads them."""
    data = {"common": np.array(model[:7])}
    for direction, _ in DIRECTIONS:
        trend, ripple, *shape = getattr(model, direction)
        data[f"{direction}_trend"], data[f"{direction}_ripple"] = np.array(trend), np.array(ripple)
        data[f"{direction}_shape"] = np.array(shape)
    return data


def beyond(model: FrictionModel, data: dict[str, np.ndarray], direction: str) -> np.ndarray:
    """Return measured minus modelled force [N] of a model on the maps of this result."""
    velocity = dict(DIRECTIONS)[direction] * data["speeds"]
    return data[f"force_{direction}"] - held_force(model, *np.meshgrid(data["centres"], velocity))


def share_within(residual: np.ndarray) -> float:
    """Return the share of the measured cells whose residual is within 2 N."""
    known = residual[np.isfinite(residual)]
    return float((np.abs(known) <= WITHIN).mean())


def rms(residual: np.ndarray) -> float:
    """Return the root mean square of the measured cells [N]."""
    return float(np.sqrt(np.nanmean(residual**2)))


def _quantities(
    fitted: Fitted,
    model: FrictionModel,
    data: dict[str, np.ndarray],
    weight: Quantity,
    thesis: FrictionModel,
) -> tuple[Quantity, ...]:
    nan = float("nan")
    found = []
    for label, text, judged in (
        ("", "our fit", model),
        ("_thesis", "the thesis's coefficients on this module", thesis),
    ):
        left = {direction: beyond(judged, data, direction) for direction, _ in DIRECTIONS}
        left = {"": np.concatenate(list(left.values())), **left}
        for direction, residual in left.items():
            end = (f"_{direction}" if direction else "") + label
            where = f"{text}, {direction}" if direction else text
            found += [
                Quantity(f"within{end}", share_within(residual), nan, "", f"within 2 N, {where}"),
                Quantity(f"rms{end}", rms(residual), nan, "N", f"rms residual, {where}"),
            ]
    ramped = np.concatenate([_ramped(model, data, direction) for direction, _ in DIRECTIONS])
    found += [
        Quantity("within_ramped", share_within(ramped), nan, "", "within 2 N, as the law uses it"),
        Quantity("gravity", *weight[1:4], "weight that is included in the fit"),
        Quantity("phase", model.phase_rad, fitted.phase_error, "rad", "phase of the ripple"),
    ]
    for direction, _ in DIRECTIONS:
        found += _of_branch(model, data, direction)
    return tuple(found)


def _of_branch(model: FrictionModel, data: dict[str, np.ndarray], direction: str) -> list[Quantity]:
    branch: FrictionBranch = getattr(model, direction)
    nan = float("nan")
    mean = float(np.nanmean(np.abs(data[f"force_{direction}"] - model.gravity_N)))
    slowest, fastest = speed_factor(branch, np.array([data["speeds"][0], data["speeds"][-1]]))
    return [
        Quantity(f"friction_{direction}", mean, nan, "N", f"mean friction, {direction}"),
        Quantity(
            f"viscous_{direction}", branch.high_slope * mean * 1e3, nan, "N s/m",
            f"slope of the line times mean friction, {direction}",
        ),
        Quantity(
            f"factor_slowest_{direction}", float(slowest), nan, "",
            f"Fv at the slowest, {direction}",
        ),
        Quantity(
            f"factor_fastest_{direction}", float(fastest), nan, "",
            f"Fv at the fastest, {direction}",
        ),
        Quantity(
            f"flip_{direction}", branch.flip_below_mm / 1e3, nan, "m",
            f"ripple turns below, {direction}",
        ),
    ]  # fmt: skip


def _ramped(model: FrictionModel, data: dict[str, np.ndarray], direction: str) -> np.ndarray:
    """Return the residual of the controller's model, with its ramp at low speed [N]."""
    velocity = dict(DIRECTIONS)[direction] * data["speeds"] / 1e3
    friction = friction_along(model, *np.meshgrid(data["centres"] / 1e3, velocity))
    return data[f"force_{direction}"] - model.gravity_N - friction


def _notes(model: FrictionModel, data: dict[str, np.ndarray]) -> tuple[str, ...]:
    slow = int((data["speeds"] < model.ramp_speed_mm_s).sum())
    notes = [
        "The residuals are those of the thesis's form, without the controller's ramp to zero below "
        f"{model.ramp_speed_mm_s:g} mm/s ({slow} of {len(data['speeds'])} speeds); within_ramped "
        "includes the ramp.",
        "The form cannot represent the ripple of the rollers, nor friction that falls with speed in"
        " one half of the screw and rises in the other.",
        "Standard errors assume independent residuals, but neighbouring bins are correlated.",
    ]
    for direction, _ in DIRECTIONS:
        if getattr(model, direction).flip_below_mm < 0.0:
            notes.append(f"Direction {direction}: a ripple flip has no benefit and is not used.")
    return tuple(notes)
