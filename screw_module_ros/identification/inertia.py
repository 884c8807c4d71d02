# SPDX-License-Identifier: Apache-2.0
"""Mass felt at the handle, from back-driven oscillations (thesis 5.3, figs 5-32 to 5-34).

No torque is commanded. The hand swings the handle fast and far. Friction and weight come from the
model of friction_fit; its speed factor is extrapolated beyond the fastest speed of the maps, as in
the thesis. There are two estimates, the thesis's ratio and our regression: see `mass_estimates`.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from ..control import modes
from ..control.friction import FrictionModel
from ..control.vertical_settings import VerticalSettings
from ..settings import Setting, validated
from . import friction_fit
from .friction_form import friction_along
from .lab import Job, Lab, Part
from .mass_estimates import Ratio, Record, jackknife, motion, ratio, regression
from .results import Quantity, Result
from .trials import Arm, MotionTrial, Samples

NAME = "inertia"
_PROJECTED = 2000.0  # the speed factor is extrapolated to this speed [mm/s]
_REGRESSION_HZ = 100.0  # samples per second in the regression: the signals end at 30 Hz
_SHOWN = 4  # every n-th sample is kept for the figures
_STRICT = 1000.0  # 2.5 m/s^2 instead of the printed 2.5 mm/s^2


class Settings(NamedTuple):
    """The oscillations, one record each, and limits of usable samples (thesis 5.3.2)."""

    amplitudes: Annotated[tuple[float, ...], Setting("of the hand", "m", 0.005, 0.16)] = (
        0.12, 0.10, 0.08, 0.06, 0.04,
    )  # fmt: skip
    omegas: Annotated[tuple[float, ...], Setting("of the hand", "rad/s", 0.5, 40.0)] = (
        4.0, 5.0, 6.0, 8.0, 10.0,
    )  # fmt: skip
    centre: Annotated[float, Setting("of the oscillation", "m", 0.05, 0.31)] = 0.18
    duration: Annotated[float, Setting("of a record", "s", 2.0, 120.0)] = 12.0
    arm_mass: Annotated[float, Setting("of the hand and arm", "kg", 0.1, 20.0)] = 3.0
    arm_stiffness: Annotated[float, Setting("of a firm grip", "N/m", 50.0, 5000.0)] = 2000.0
    arm_damping: Annotated[float, Setting("of a firm grip", "Ns/m", 0.0, 500.0)] = 60.0
    least_speed: Annotated[float, Setting("slower samples do not count", "m/s", 0.0, 1.0)] = 0.020
    least_acceleration: Annotated[
        float, Setting("samples below do not count in the ratio", "m/s^2", 1e-4, 50.0)
    ] = 0.0025
    widest_shift: Annotated[float, Setting("largest shift of the curves", "s", 0.0, 0.1)] = 0.030


def run(lab: Lab, settings: Settings) -> Result:
    """Identify the mass; needs the result of friction_model.

    Quantity `mass` is by regression, `mass_thesis` by the thesis's ratio. Data: per record n
    `time_n`, `acceleration_n`, `inertial_n` (force minus friction and weight), `ratio_n` (0 for
    excluded samples); `shifts` [s]. Raises ValueError for inconsistent settings or a handle that
    hardly moved, MissingResult, and the errors of `Lab.run`.
    """
    jobs = _jobs(settings)
    model = friction_fit.friction_model_of(lab.result(friction_fit.NAME))
    parts = lab.run(NAME, jobs)
    records = [_record(parts[job.name], model) for job in jobs]
    every = max(round(lab.rate / _REGRESSION_HZ), 1)
    fit = regression(records, settings.least_speed, every)
    plain = regression(records, settings.least_speed, every, loaded=False)
    error = math.hypot(jackknife(records, settings.least_speed, every), fit.mass - plain.mass)
    ratios = [_ratio(record, settings, 1.0) for record in records]
    strict = [_ratio(record, settings, _STRICT) for record in records]
    mean, deviation = pooled(ratios)
    strict_mean, strict_deviation = pooled(strict)
    nan = float("nan")
    quantities = (
        Quantity("mass", fit.mass, error, "kg", "mass at the handle, by regression"),
        Quantity("mass_thesis", mean, deviation, "kg", "mean of the ratio (sd), as printed"),
        Quantity(
            "mass_thesis_strict", strict_mean, strict_deviation, "kg",
            "the same, accelerations of 2.5 m/s^2 and more",
        ),
        Quantity("shift", *_shift(strict), "s", "best time shift of the strict ratio"),
        Quantity("viscous_left", fit.viscous, nan, "N s/m", "viscous friction beyond the model"),
        Quantity("coulomb_left", fit.coulomb, nan, "N", "dry friction beyond the model"),
        Quantity("constant_left", fit.constant, nan, "N", "weight and zero beyond the model"),
        Quantity("load_left", fit.load, nan, "", "friction per force beyond that of the maps"),
        Quantity("rms_left", fit.rms, nan, "N", "rms of the regression's residual"),
        Quantity(
            "fastest", max(float(np.abs(r.velocity).max()) for r, _ in records), nan, "m/s",
            "fastest sample",
        ),
    )  # fmt: skip
    data = {"shifts": np.array([r.shift for r in strict]), "mass": np.array(fit)}
    for number, ((record, friction), found) in enumerate(zip(records, strict, strict=True)):
        data[f"time_{number}"] = record.time[::_SHOWN]
        data[f"acceleration_{number}"] = record.acceleration[::_SHOWN]
        data[f"inertial_{number}"] = (record.smooth - friction)[::_SHOWN]
        data[f"ratio_{number}"] = np.nan_to_num(found.mass)[::_SHOWN]
    return Result(NAME, quantities, settings._asdict(), _notes(ratios, strict), data)


def kept(trial: MotionTrial, samples: Samples) -> Part:
    """Reduce a record to time, position and force; for `Job`."""
    return {"time": samples.time, "position": samples.position, "force": samples.force}


def pooled(ratios: list[Ratio]) -> tuple[float, float]:
    """Return mean and standard deviation of all samples of all records [kg] (5.3.3).

    NaN when no record has a usable sample.
    """
    masses = np.concatenate([r.mass[np.isfinite(r.mass)] for r in ratios])
    if not len(masses):
        return float("nan"), float("nan")
    return float(masses.mean()), float(masses.std())


def _shift(ratios: list[Ratio]) -> tuple[float, float]:
    """Return mean and standard deviation of the shifts [s] of the records that have one."""
    shifts = [r.shift for r in ratios if np.isfinite(r.shift)]
    return (float(np.mean(shifts)), float(np.std(shifts))) if shifts else (float("nan"),) * 2


def _jobs(settings: Settings) -> list[Job]:
    validated(settings)
    if len(settings.amplitudes) != len(settings.omegas) or not settings.omegas:
        raise ValueError(
            f"amplitudes ({len(settings.amplitudes)}) and omegas ({len(settings.omegas)}) must be "
            "lists of one length"
        )
    arm = Arm(
        float(settings.arm_mass), float(settings.arm_stiffness), float(settings.arm_damping)
    )
    return [
        Job(
            f"record_{number}",
            MotionTrial(
                modes.OFF,
                VerticalSettings(),
                arm=arm,
                centre=float(settings.centre),
                amplitude=float(amplitude),
                omega=float(omega),
                duration=float(settings.duration),
            ),
            kept,
        )
        for number, (amplitude, omega) in enumerate(
            zip(settings.amplitudes, settings.omegas, strict=True)
        )
    ]


def _record(part: Part, model: FrictionModel) -> Record:
    """Return a record with the friction and weight along it [N]."""
    record = motion(part["time"], part["position"], part["force"])
    projected = model._replace(fastest_mm_s=_PROJECTED)
    return record, friction_along(projected, record.position, record.velocity) + model.gravity_N


def _ratio(record: Record, settings: Settings, times: float) -> Ratio:
    moved, friction = record
    return ratio(
        moved,
        moved.force - friction,
        settings.least_speed,
        settings.least_acceleration * times,
        settings.widest_shift,
    )


def _notes(ratios: list[Ratio], strict: list[Ratio]) -> tuple[str, ...]:
    mean, deviation = pooled(ratios)
    shifts = ", ".join(f"{r.shift * 1e3:.1f}" for r in strict if np.isfinite(r.shift)) or "no"
    return (
        "The uncertainty of the mass includes the effect of the load term and the spread of a "
        "jackknife over the records, but not an error of the sensor's gain.",
        "The friction model is extrapolated beyond the fastest speed of the maps, as in 5.3.",
        f"With accelerations from 2.5 mm/s^2, as printed, the ratio is {mean:.2f} kg with a "
        f"standard deviation of {deviation:.3g} kg: near zero acceleration the ratio amplifies any "
        "error of the friction. The strict figures use accelerations from 2.5 m/s^2.",
        f"Best shifts of the strict ratio: {shifts} ms, positive for a delayed acceleration "
        "(thesis: 8 to 18 ms, regarded as an artifact; our filters have no delay).",
    )
