# SPDX-License-Identifier: Apache-2.0
"""Fit of the thesis's friction model to the measured maps (thesis 5.2.5, figs 5-24 to 5-30).

`held_force` is the force of 5.2.5 that maintains a speed, gravity included. The fit has the same
degrees of freedom as a `FrictionBranch`, with parameters of similar size: Chebyshev coefficients
over the range of heights instead of powers of millimetres, and a speed factor that is one at
`REFERENCE` and continuous at its knee, so that no parameter is redundant.

A grid search finds phase and flip of the ripple on the means over the speeds; the thesis found them
on these means by eye. Then all cells of both directions are fitted together. Trend and ripple are
linear parameters and are solved for exactly in each step; the optimiser varies only the phase and
the speed factors (variable projection: golub1973).
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.polynomial import Chebyshev, Polynomial
from numpy.polynomial.chebyshev import chebvander
from scipy.optimize import OptimizeResult, least_squares

from ..calibration.module import thesis_friction
from ..control.friction import FrictionBranch, FrictionModel
from ..settings import Setting
from . import friction_map, gravity
from .figures import COLOURS, axes_for, panels, printed
from .friction_map import FORCE, HEIGHT, SPEED
from .lab import Lab
from .results import NOTHING, Drawn, Experiment, Published, Quantity, Result, beside
from .stage_runs import BIN_MM
from .trials import DIRECTIONS

NAME = "friction_model"
# The factors are those of the printed formulas at 150 and 0.5 mm/s; in words the thesis has about
# 1.3, and 0.75 at the lowest speeds (docs/contradictions.md). The viscous value is the middle of
# the printed range, which is one for both directions.
THESIS = {
    "factor_fastest_up": Published("up_high_speed", 0.1, given_to_plant=True, computed=1.301),
    "factor_slowest_up": Published("up_low_speed", 0.1, given_to_plant=True, computed=0.680),
    "factor_fastest_down": Published("down_high_speed", 0.1, given_to_plant=True, computed=1.298),
    "factor_slowest_down": Published("down_low_speed", 0.1, given_to_plant=True, computed=0.730),
    "viscous_up": Published("viscous", 6.0, given_to_plant=True, computed=25.5),
    "viscous_down": Published("viscous", 6.0, given_to_plant=True, computed=25.5),
    "phase": Published("ripple_phase", 0.1, given_to_plant=True),
    "flip_down": Published("down_flip", 0.005, given_to_plant=True, unit="m"),
}
WITHIN = 2.0  # [N] thesis: model_residual
TREND, RIPPLE = 8, 6  # coefficients of the 7th and the 5th order
REFERENCE = 40.0  # speed with a speed factor of one in a fit [mm/s]
NO_FLIP = -1.0  # [mm], as in params/friction_thesis.yaml
PARAMETERS = TREND + RIPPLE + 3
# Lowest and highest: exponent, logarithm of the knee [mm/s], slope [s/mm].
BOUNDS = ((0.0, np.log(1.0), -0.005), (1.0, np.log(20.0), 0.02))
_PHASES = np.arange(36) * (np.pi / 36.0)  # phases beyond pi equal a negative amplitude
_FLIPS = np.arange(20.0, 336.0, BIN_MM)  # [mm]
_FEWEST_BINS = 30  # four turns of the screw; with 20 the fit is off by 20 N between the bins
_FIRST = (0.15, np.log(2.5), 0.003)  # initial exponent, knee and slope, near the thesis's


class Settings(NamedTuple):
    """Settings of the fit; the data come from friction_map and gravity."""

    ramp_speed: Annotated[
        float, Setting("the controller's model is linear below this speed", "m/s", 1e-4, 0.02)
    ] = 0.002
    flip_gain: Annotated[
        float, Setting("least reduction of the squared error by a ripple flip", "", 0.0, 1.0)
    ] = 0.1


class _Cells(NamedTuple):
    """One direction's measured cells: height [mm], speed [mm/s], friction [N]; trend: Chebyshev
    polynomials there, shape (cells, coefficients), the first of them those of the ripple."""

    z: np.ndarray
    speed: np.ndarray
    force: np.ndarray
    trend: np.ndarray


def run(lab: Lab, settings: Settings) -> Result:
    """Fit the model; needs the results of friction_map and gravity.

    Data: see `friction_model_of`; `centres` [mm], `speeds` [mm/s], `force_up`, `residual_up` and
    the same down [N], shape (speeds, bins). Raises MissingResult, ValueError for maps with too few
    cells.
    """
    maps, weighed = lab.result(friction_map.NAME).data, lab.result(gravity.NAME)
    weight = weighed.value("gravity")
    speeds, z = maps["speeds"] * 1e3, maps["centres"]
    friction = (maps["up"] - weight, maps["down"] - weight)
    lead = 1e3 * lab.stand.screw.lead
    model, error = fit_maps(z, speeds, friction, weight, lead, settings)
    data = {"centres": z, "speeds": speeds, **_as_data(model)}
    for direction, _ in DIRECTIONS:
        data[f"force_{direction}"] = maps[direction]
        data[f"residual_{direction}"] = beyond(model, data, direction)
    quantities = _quantities(error, model, data, weighed.quantity("gravity"))
    return Result(NAME, beside(THESIS, quantities), settings._asdict(), _notes(model, data), data)


def friction_model_of(result: Result) -> FrictionModel:
    """Return the model for the controller from this experiment's result."""
    low, high, fastest, ramp, lead, phase, weight = map(float, result.data["common"])
    branches = (
        FrictionBranch(
            tuple(result.data[f"{direction}_trend"].tolist()),
            tuple(result.data[f"{direction}_ripple"].tolist()),
            *map(float, result.data[f"{direction}_shape"]),
        )
        for direction, _ in DIRECTIONS
    )
    return FrictionModel(low, high, fastest, ramp, lead, phase, weight, *branches)


def _as_data(model: FrictionModel) -> dict[str, np.ndarray]:
    """Return the model as arrays; `friction_model_of` reads them."""
    data = {"common": np.array(model[:7])}
    for direction, _ in DIRECTIONS:
        trend, ripple, *shape = getattr(model, direction)
        data[f"{direction}_trend"], data[f"{direction}_ripple"] = np.array(trend), np.array(ripple)
        data[f"{direction}_shape"] = np.array(shape)
    return data


def beyond(
    model: FrictionModel, data: dict[str, np.ndarray], direction: str, ramped: bool = False
) -> np.ndarray:
    """Return measured minus modelled force [N] of a model on the maps of this result.

    ramped: as the controller uses the model, with its ramp at low speed.
    """
    z, velocity = np.meshgrid(data["centres"], dict(DIRECTIONS)[direction] * data["speeds"])
    if ramped:
        force = friction_along(model, z / 1e3, velocity / 1e3) + model.gravity_N
    else:
        force = held_force(model, z, velocity)
    return data[f"force_{direction}"] - force


def share_within(residual: np.ndarray) -> float:
    """Return the share of the measured cells whose residual is within 2 N."""
    known = residual[np.isfinite(residual)]
    return float((np.abs(known) <= WITHIN).mean())


def _quantities(
    phase_error: float, model: FrictionModel, data: dict[str, np.ndarray], weight: Quantity
) -> tuple[Quantity, ...]:
    nan, found = np.nan, []
    for label, text, judged in (
        ("", "our fit", model),
        ("_thesis", "the thesis's coefficients on this module", thesis_friction()),
    ):
        left = {f"_{name}": beyond(judged, data, name) for name, _ in DIRECTIONS}
        for name, residual in {"": np.concatenate([*left.values()]), **left}.items():
            where, rms = f"{text}{name.replace('_', ', ')}", np.sqrt(np.nanmean(residual**2))
            found += [
                Quantity(f"within{name}{label}", share_within(residual), nan, "",
                         f"within 2 N, {where}"),
                Quantity(f"rms{name}{label}", float(rms), nan, "N", f"rms residual, {where}"),
            ]  # fmt: skip
    ramped = np.concatenate([beyond(model, data, name, ramped=True) for name, _ in DIRECTIONS])
    found += [
        Quantity("within_ramped", share_within(ramped), nan, "", "within 2 N, as the law uses it"),
        Quantity("gravity", *weight[1:4], "weight that is included in the fit"),
        Quantity("phase", model.phase_rad, phase_error, "rad", "phase of the ripple"),
    ]
    for name, _ in DIRECTIONS:
        branch: FrictionBranch = getattr(model, name)
        mean = float(np.nanmean(np.abs(data[f"force_{name}"] - model.gravity_N)))
        slowest, fastest = speed_factor(branch, data["speeds"][[0, -1]]).tolist()
        found += [
            Quantity(f"friction_{name}", mean, nan, "N", f"mean friction, {name}"),
            Quantity(f"viscous_{name}", branch.high_slope * mean * 1e3, nan, "N s/m",
                     f"slope of the line times mean friction, {name}"),
            Quantity(f"factor_slowest_{name}", slowest, nan, "", f"Fv at the slowest, {name}"),
            Quantity(f"factor_fastest_{name}", fastest, nan, "", f"Fv at the fastest, {name}"),
            Quantity(f"flip_{name}", branch.flip_below_mm / 1e3, nan, "m",
                     f"ripple turns below, {name}"),
        ]  # fmt: skip
    return tuple(found)


def _notes(model: FrictionModel, data: dict[str, np.ndarray]) -> tuple[str, ...]:
    slow = int((data["speeds"] < model.ramp_speed_mm_s).sum())
    return (
        "The residuals are those of the thesis's form, without the controller's ramp to zero below "
        f"{model.ramp_speed_mm_s:g} mm/s ({slow} of {len(data['speeds'])} speeds); within_ramped "
        "includes the ramp.",
        "The form cannot represent the ripple of the rollers, nor friction that falls with speed in"
        " one half of the screw and rises in the other.",
        "Standard errors assume independent residuals, but neighbouring bins are correlated.",
        *(
            f"Direction {direction}: a ripple flip has no benefit and is not used."
            for direction, _ in DIRECTIONS if getattr(model, direction).flip_below_mm < 0.0
        ),
    )  # fmt: skip


def ripple_phase(z: np.ndarray, lead: float, phase: float, flip_below: float) -> np.ndarray:
    """Return the ripple with amplitude one; its phase is shifted by pi below flip_below [mm]."""
    return np.where(z > flip_below, 1.0, -1.0) * np.sin(2.0 * np.pi / lead * z + phase)


def speed_factor(branch: FrictionBranch, speed: np.ndarray) -> np.ndarray:
    """Return Fv at speeds above zero [mm/s]."""
    speed = np.asarray(speed, float)
    low = branch.low_gain * speed**branch.low_exponent
    return np.where(
        speed <= branch.break_speed_mm_s, low, branch.high_slope * speed + branch.high_offset
    )


def held_force(model: FrictionModel, z: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the force that maintains a velocity, gravity included [N].

    z [mm], velocity [mm/s], not zero, of one shape. Height and speed are clipped to the model's
    range as in `control.friction`; there is no ramp at low speed, as in the thesis.
    """
    z = np.clip(np.asarray(z, float), model.low_mm, model.high_mm)
    velocity = np.asarray(velocity, float)
    speed = np.clip(np.abs(velocity), 1e-9, model.fastest_mm_s)
    force = np.empty(np.broadcast(z, velocity).shape)
    for branch, mine in ((model.up, velocity > 0.0), (model.down, velocity <= 0.0)):
        _, place = _along(model, branch, z)
        held = speed_factor(branch, speed) * (place - model.gravity_N) + model.gravity_N
        force = np.where(mine, held, force)
    return force


def friction_along(model: FrictionModel, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return `control.friction.friction_force` of arrays [N]: position [m], velocity [m/s]."""
    velocity = np.asarray(velocity, float) * 1e3
    sign, speed = np.sign(velocity), np.abs(velocity)
    moving = np.where(velocity > 0.0, 1.0, -1.0) * np.maximum(speed, model.ramp_speed_mm_s)
    force = held_force(model, np.asarray(position, float) * 1e3, moving) - model.gravity_N
    return sign * np.maximum(sign * force, 0.0) * np.minimum(1.0, speed / model.ramp_speed_mm_s)


def fit_factor(numbers: np.ndarray, speed: np.ndarray | float) -> np.ndarray:
    """Return a fit's speed factor at speeds above zero [mm/s]; numbers: exponent, logarithm of the
    knee [mm/s], slope [s/mm]."""
    exponent, knee, slope = numbers[0], np.exp(numbers[1]), numbers[2]
    line = 1.0 + slope * (np.maximum(speed, knee) - REFERENCE)
    return line * np.minimum(speed / knee, 1.0) ** exponent


def _branch(
    place: np.ndarray, sign: float, flip_below: float, numbers: np.ndarray, speeds: np.ndarray,
    reach: tuple[float, float], gravity: float,
) -> FrictionBranch:  # fmt: skip
    """Return a fit in the form of controller and thesis, with powers of millimetres.

    place: trend and ripple; sign: of the ripple; flip_below [mm]; numbers: see `fit_factor`; reach:
    low, high [mm]; gravity [N]. The speed factor has a mean of one over `speeds` [mm/s], so that
    trend and ripple are those of the mean curve, as in the thesis.
    """
    exponent, knee, slope = float(numbers[0]), float(np.exp(numbers[1])), float(numbers[2])
    mean = float(fit_factor(numbers, speeds).mean())
    trend = _powers(place[:TREND] * mean, *reach, TREND)
    trend[-1] += gravity
    return FrictionBranch(
        trend=tuple(trend.tolist()),
        ripple=tuple(_powers(sign * place[TREND:] * mean, *reach, RIPPLE).tolist()),
        flip_below_mm=flip_below,
        break_speed_mm_s=knee,
        low_gain=float(fit_factor(numbers, knee)) / mean / knee**exponent,
        low_exponent=exponent,
        high_slope=slope / mean,
        high_offset=(1.0 - slope * REFERENCE) / mean,
    )


def _powers(coefficients: np.ndarray, low: float, high: float, count: int) -> np.ndarray:
    """Return Chebyshev coefficients as those of powers of z [mm], highest first."""
    plain = Chebyshev(coefficients, domain=[low, high]).convert(kind=Polynomial).coef
    return np.pad(plain, (0, count - len(plain)))[::-1].copy()


def fit_maps(
    z: np.ndarray, speeds: np.ndarray, maps: tuple[np.ndarray, np.ndarray], gravity: float,
    lead: float, settings: Settings,
) -> tuple[FrictionModel, float]:  # fmt: skip
    """Fit both directions together; return the model and the standard error of its phase [rad].

    z: bins [mm]; speeds [mm/s]; maps: friction up and down [N], up the screw positive, (speeds,
    bins), NaN for cells not measured; gravity [N]; lead: of the screw [mm]. Raises ValueError for
    too few cells.
    """
    low, high = reach = _common_range(z, maps, lead)
    inside = (z > low) & (z < high)
    means, cells = [], []
    for (direction, _), whole in zip(DIRECTIONS, maps, strict=True):
        force = whole[:, inside]
        there = np.isfinite(force)
        if there.sum() < 5 * PARAMETERS or there.any(axis=1).sum() < 4:
            raise ValueError(
                f"the map {direction} has too few cells for the model's form: measure more"
            )
        means.append(_cells(z[inside], np.zeros(1), _mean_curve(force)[None, :], reach))
        cells.append(_cells(z[inside], speeds, force, reach))
    phase, flips = _shape(means, lead, settings.flip_gain)
    best, found = flips, _refined(cells, lead, flips, phase)
    for branch, flip in enumerate(flips):
        for near in (flip - BIN_MM, flip + BIN_MM) if flip != NO_FLIP else ():
            other = (near, best[1]) if branch == 0 else (best[0], near)
            tried = _refined(cells, lead, other, phase)
            if tried.cost < found.cost:
                best, found = other, tried
    phase, numbers = float(found.x[0]), np.split(found.x[1:], 2)
    places = [
        _place(c, lead, fit_factor(own, c.speed), phase, flip)[0]
        for c, own, flip in zip(cells, numbers, best, strict=True)
    ]
    # A ripple shifted by half a cycle with negated amplitude is the same ripple: the upward one
    # is positive on average.
    sign = -1.0 if float((cells[0].trend[:, :RIPPLE] @ places[0][TREND:]).mean()) < 0.0 else 1.0
    turned = phase if sign > 0.0 else phase + np.pi
    spare = max(sum(len(c.force) for c in cells) - 2 * PARAMETERS - 1, 1)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * 2.0 * found.cost / spare
    up, down = (
        _branch(place, sign, flip, own, speeds, reach, gravity)
        for place, flip, own in zip(places, best, numbers, strict=True)
    )
    model = FrictionModel(
        low, high, float(speeds.max()), settings.ramp_speed * 1e3, lead,
        float(np.angle(np.exp(1j * turned))), gravity, up, down,
    )  # fmt: skip
    return model, float(np.sqrt(covariance[0, 0]))


def _common_range(
    z: np.ndarray, maps: tuple[np.ndarray, np.ndarray], lead: float
) -> tuple[float, float]:
    """Return the range of heights that was measured in both directions [mm].

    Outside its bins, and in a wide gap between them, a polynomial of 7th order can be anything.
    Raises ValueError for too few bins or a gap of more than a turn of the screw.
    """
    there = [z[np.isfinite(force).any(axis=0)] for force in maps]
    first, last = max(bins[0] for bins in there), min(bins[-1] for bins in there)
    for (direction, _), bins in zip(DIRECTIONS, there, strict=True):
        bins = bins[(bins >= first) & (bins <= last)]
        if len(bins) < _FEWEST_BINS or np.diff(bins).max() > lead:
            raise ValueError(
                f"the map {direction} does not determine the model's form: {len(bins)} bins in the "
                f"range of both maps, {_FEWEST_BINS} are needed, without a gap of more than "
                f"{lead:g} mm: measure more"
            )
    return float(first) - 0.5 * BIN_MM, float(last) + 0.5 * BIN_MM


def _cells(
    z: np.ndarray, speeds: np.ndarray, force: np.ndarray, reach: tuple[float, float]
) -> _Cells:
    there, (low, high) = np.isfinite(force), reach
    height, speed = (grid[there] for grid in np.meshgrid(z, speeds))
    trend = chebvander((2.0 * height - low - high) / (high - low), TREND - 1)
    return _Cells(height, speed, force[there], trend)


def _mean_curve(force: np.ndarray) -> np.ndarray:
    """Return the mean over the speeds, normalised so that missing cells have no effect."""
    level = _mean(force, 1)
    return _mean(force / level[:, None], 0) * float(np.nanmean(level))


def _mean(values: np.ndarray, axis: int) -> np.ndarray:
    """Return the mean over the finite values, NaN without any."""
    count = np.isfinite(values).sum(axis=axis)
    return np.where(count > 0, np.nansum(values, axis=axis) / np.maximum(count, 1), np.nan)


def _shape(
    means: list[_Cells], lead: float, flip_gain: float
) -> tuple[float, tuple[float, float]]:
    """Find phase [rad] and flips [mm] on the mean curves: linear fits over a grid of both."""
    candidates = (NO_FLIP, *_FLIPS)
    errors = np.array(
        [[[_misfit(m, lead, phase, flip) for flip in candidates] for phase in _PHASES]
         for m in means]
    )  # (direction, phase, flip)
    plain, turned = errors[:, :, 0], errors[:, :, 1:].min(axis=2)
    worth = turned.min(axis=1) < (1.0 - flip_gain) * plain.min(axis=1)
    at = int(np.argmin(np.where(worth[:, None], turned, plain).sum(axis=0)))
    up, down = (
        float(_FLIPS[np.argmin(errors[direction, at, 1:])]) if worth[direction] else NO_FLIP
        for direction in (0, 1)
    )
    return float(_PHASES[at]), (up, down)


def _misfit(mean: _Cells, lead: float, phase: float, flip: float) -> float:
    left = _place(mean, lead, np.ones(1), phase, flip)[1]
    return float(left @ left)


def _place(
    cells: _Cells, lead: float, factor: np.ndarray, phase: float, flip: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the best coefficients of trend and ripple for a speed factor, and the residual [N]."""
    ripple = ripple_phase(cells.z, lead, phase, flip)
    terms = np.hstack((cells.trend, cells.trend[:, :RIPPLE] * ripple[:, None]))
    terms *= factor[:, None]
    # Chebyshev polynomials are nearly orthogonal: the normal equations are well conditioned.
    coefficients = np.linalg.solve(terms.T @ terms, terms.T @ cells.force)
    return coefficients, terms @ coefficients - cells.force


def _refined(
    cells: list[_Cells], lead: float, flips: tuple[float, float], phase: float
) -> OptimizeResult:
    """Refine the phase and both speed factors, x = (phase, 3 numbers up, 3 down)."""

    def beyond(x: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [
                _place(c, lead, fit_factor(numbers, c.speed), x[0], flip)[1]
                for c, numbers, flip in zip(cells, np.split(x[1:], 2), flips, strict=True)
            ]
        )

    low, high = ((edge, *own, *own) for edge, own in zip((-9.0, 9.0), BOUNDS, strict=True))
    start = np.array((phase, *_FIRST, *_FIRST))
    return least_squares(beyond, start, bounds=(low, high), x_scale="jac")


def draw(result: Result) -> Drawn:
    """Return the figures by number."""
    model = friction_model_of(result)
    return {
        "5-24": _over_height(result, model, "up", False, "Fig. 5-24: mean and its trend"),
        "5-25": _over_height(result, model, "up", True, "Fig. 5-25: with the ripple"),
        "5-26": _over_speed(result, model, "up", "Fig. 5-26: factor of the speed, upward"),
        "5-28": _over_height(result, model, "down", True, "Fig. 5-28: mean, downward"),
        "5-29": _over_speed(result, model, "down", "Fig. 5-29: factor of the speed, downward"),
        "5-27": _residuals(result, "up", (5.0, 20.0), "5-27"),
        "5-30": _residuals(result, "down", (5.0, 40.0), "5-30"),
    }


def _levelled(result: Result, model: FrictionModel, direction: str) -> np.ndarray:
    """Return the mean over the speeds [N], with the model's factor for missing cells."""
    factor = speed_factor(getattr(model, direction), result.data["speeds"])[:, None]
    friction = result.data[f"force_{direction}"] - model.gravity_N
    share = np.where(np.isfinite(friction), factor, np.nan)
    return np.nansum(friction, axis=0) / np.nansum(share, axis=0) + model.gravity_N


def _residuals(result: Result, direction: str, speeds: tuple[float, float], number: str) -> Figure:
    """Draw measured minus modelled force over height at two speeds [mm/s]."""
    figure, axes = panels(1, 2, (9.6, 4.0), sharey=True)
    for panel, wanted in zip(axes, speeds, strict=True):
        row = int(np.argmin(np.abs(result.data["speeds"] - wanted)))
        panel.axhspan(-WITHIN, WITHIN, color="#eeeeee", zorder=0)
        panel.plot(result.data["centres"], result.data[f"residual_{direction}"][row],
                   color=COLOURS[0])  # fmt: skip
        panel.set(xlabel=HEIGHT, xlim=(0.0, 355.0), ylim=(-4.0, 4.0))
        panel.text(0.02, 0.96, f"{result.data['speeds'][row]:g} mm/s", transform=panel.transAxes,
                   va="top")  # fmt: skip
    axes[0].set(
        ylabel="measured minus modelled force [N]",
        title=f"Fig. {number}: what the model leaves, {direction}ward; grey: within 2 N",
    )
    return figure


def _over_height(
    result: Result, model: FrictionModel, direction: str, ripple: bool, title: str
) -> Figure:
    """Draw the mean force over the speeds and the model's dependence on height."""
    branch = getattr(model, direction)
    fine = np.linspace(model.low_mm, model.high_mm, 1000)
    figure, axes = axes_for(HEIGHT, FORCE, title)
    axes.plot(result.data["centres"], _levelled(result, model, direction), color=COLOURS[0],
              label="measured")  # fmt: skip
    trend, full = _along(model, branch, fine)
    axes.plot(fine, trend, color=COLOURS[3], linestyle="--", label="trend, 7th order")
    if ripple:
        axes.plot(fine, full, color=COLOURS[2], linestyle="--", label="with ripple")
    thesis = thesis_friction()
    shown = np.linspace(thesis.low_mm, thesis.high_mm, 1000)
    levels = _along(thesis, getattr(thesis, direction), shown)
    printed(axes, shown, levels[ripple], "5.2.5", line=True)
    if ripple and model.low_mm < branch.flip_below_mm < model.high_mm:
        axes.axvline(branch.flip_below_mm, color="#888888", linewidth=0.8, linestyle=":")
        axes.annotate(
            "ripple turns over", (branch.flip_below_mm, 0.02), xytext=(4, 0), va="bottom",
            xycoords=("data", "axes fraction"), textcoords="offset points", color="#555555",
        )  # fmt: skip
    axes.set_xlim(model.low_mm, model.high_mm)
    axes.legend(loc="best")
    return figure


def _along(
    model: FrictionModel, branch: FrictionBranch, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the trend at heights z [mm] and the trend with its ripple [N]."""
    trend = np.polyval(branch.trend, z)
    phase = ripple_phase(z, model.lead_mm, model.phase_rad, branch.flip_below_mm)
    return trend, trend + np.polyval(branch.ripple, z) * phase


def _over_speed(result: Result, model: FrictionModel, direction: str, title: str) -> Figure:
    """Draw friction, averaged over the heights and normalised, and the model's factor."""
    branch = getattr(model, direction)
    speeds = result.data["speeds"]
    friction = np.abs(result.data[f"force_{direction}"] - model.gravity_N)
    whole = np.isfinite(friction).all(axis=0)
    level = friction[:, whole].mean(axis=1)
    fine = np.linspace(0.1, speeds[-1], 600)
    figure, axes = axes_for(SPEED, "friction over its mean over the speeds", title)
    axes.plot(speeds, level / level.mean(), "o", color=COLOURS[0], label="measured")
    axes.plot(
        fine, speed_factor(branch, fine), "--", color=COLOURS[2],
        label=f"power of {branch.low_exponent:.2f} up to {branch.break_speed_mm_s:.1f} mm/s, "
        f"then {branch.high_slope:.5f} v + {branch.high_offset:.3f}",
    )  # fmt: skip
    factors = speed_factor(getattr(thesis_friction(), direction), speeds)
    printed(axes, speeds, factors, "Fv of 5.2.5 at the speeds measured")
    axes.set_xlim(0.0, speeds[-1])
    axes.legend(loc="lower right")
    return figure


EXPERIMENT = Experiment(
    NAME, "fit of the thesis's friction model to the measured maps (thesis 5.2.5)", Settings, run,
    draw, NOTHING, ("friction_map", "gravity"),
)  # fmt: skip
