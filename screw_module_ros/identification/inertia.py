# SPDX-License-Identifier: Apache-2.0
"""Mass felt at the handle, from back-driven oscillations (thesis 5.3, figs 5-32 to 5-34).

No torque is commanded. The hand swings the handle fast and far. Friction and weight come from
`friction_model`; its speed factor is extrapolated beyond the fastest speed of the maps, as in the
thesis. Force of the hand minus modelled friction and weight should equal mass times acceleration.

The thesis shifts one curve against the other for the least spread of their ratio, and divides
sample by sample. Ours is a robust regression over all samples for the mass and the errors of the
friction model, without division and shift. The errors are a viscous part, a Coulomb part, a
constant, and a part proportional to the load: friction depends on the load (5.2.5), and the hand
pushes harder here than the stage.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.optimize import least_squares
from scipy.signal import oaconvolve

from ..control import modes
from ..control.friction import FrictionModel
from ..control.vertical_settings import VerticalSettings
from ..settings import Setting
from . import friction_model
from .figures import COLOURS, CREDIT, DESIRED, THESIS_RATE, axes_for, filter_figure
from .friction_model import friction_along
from .lab import Lab, Part
from .results import (
    HUMAN_ARM,
    Drawn,
    Experiment,
    Published,
    Quantity,
    Result,
    beside,
    from_sources,
)
from .stage_runs import optimal_lowpass, zero_phase
from .trials import Arm, MotionTrial, Samples
from .uncertainty import TRANSDUCER, TRANSDUCER_ERROR, bounded, jackknifed

NAME = "inertia"
THESIS = {
    "mass": Published("mass", 1.72, given_to_plant=True),
    "mass_thesis": Published("mass", 1.72, given_to_plant=True),
}
_PROJECTED = 2000.0  # the speed factor is extrapolated to this speed [mm/s]
_REGRESSION_HZ = 100.0  # samples per second in the regression: the signals end at 30 Hz
_SHOWN = 4  # every n-th sample is kept for the figures
_STRICT = 1000.0  # 2.5 m/s^2 instead of the printed 2.5 mm/s^2
CUTOFF_HZ = 30.0  # [Hz] thesis: inertia_cutoff
STOP_HZ = 50.0  # [Hz] thesis: inertia_stop
_CENTRE = np.array([0.5, 0.0, -0.5])  # (z[k+1] - z[k-1]) / 2 as a convolution
_EDGE_S = 0.25  # time at each end where the filter uses mirrored samples
_LONG, _SHORT = 4.0, 1.2  # seconds of figs 5-32 and 5-33
_SCALE = 0.2  # ours: of the force, as in fig 5-33
_BEGIN = 2.0  # time after the record's beginning [s]


class Settings(NamedTuple):
    """The oscillations, one record each, and limits of usable samples (thesis 5.3.2)."""

    amplitudes: Annotated[tuple[float, ...], Setting("of the hand", "m", 0.005, 0.16)] = (
        0.12, 0.10, 0.08, 0.06, 0.04,
    )  # fmt: skip
    omegas: Annotated[tuple[float, ...], Setting("of the hand", "rad/s", 0.5, 40.0)] = (
        4.0, 5.0, 6.0, 8.0, 10.0,
    )  # fmt: skip
    centre: Annotated[
        float, Setting("of the oscillation", "m", 0.05, 0.31)
    ] = 0.18  # ours: the centre of 6.1's spring; 5.3.2 prints none
    duration: Annotated[float, Setting("of a record", "s", 2.0, 120.0)] = 12.0
    arm_mass: Annotated[
        float, Setting("of the hand and arm", "kg", 0.1, 20.0)
    ] = 3.0  # thesis: arm_sim_mass
    arm_stiffness: Annotated[float, Setting("of a firm grip", "N/m", 50.0, 5000.0)] = 2000.0
    arm_damping: Annotated[float, Setting("of a firm grip", "Ns/m", 0.0, 500.0)] = 60.0
    least_speed: Annotated[
        float, Setting("slower samples do not count", "m/s", 0.0, 1.0)
    ] = 0.020  # thesis: inertia_least_speed
    least_acceleration: Annotated[
        float, Setting("samples below do not count in the ratio", "m/s^2", 1e-4, 50.0)
    ] = 0.0025  # thesis: inertia_least_acceleration
    widest_shift: Annotated[float, Setting("largest shift of the curves", "s", 0.0, 0.1)] = 0.030

    def flaw(self) -> str:
        """Return what is wrong with lists of different lengths, or without an entry."""
        both = f"amplitudes ({len(self.amplitudes)}) and omegas ({len(self.omegas)})"
        fits = len(self.amplitudes) == len(self.omegas) > 0
        return "" if fits else f"{both} must be lists of one length"


class Motion(NamedTuple):
    """A back-driven record: time [s], position [m], velocity [m/s], acceleration [m/s^2], force of
    the hand [N] and the same filtered like the acceleration; arrays of one length."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    force: np.ndarray
    smooth: np.ndarray


Record = tuple[Motion, np.ndarray]
"""A motion and the model's friction and weight along it [N]."""


class Ratio(NamedTuple):
    """The thesis's result of one record: shift of the acceleration, positive = delayed [s]; mass at
    each sample [kg], NaN for excluded samples."""

    shift: float
    mass: np.ndarray


_LEFT = (
    ("viscous", "N s/m", "viscous friction beyond the model"),
    ("coulomb", "N", "dry friction beyond the model"),
    ("constant", "N", "weight and zero beyond the model"),
    ("load", "", "friction per force beyond that of the maps"),
    ("rms", "N", "rms of the regression's residual"),
)
"""What `regression` returns after the mass: name, unit, text."""


def run(lab: Lab, settings: Settings) -> Result:
    """Identify the mass; needs the result of friction_model.

    Quantity `mass` is by regression, `mass_thesis` by the thesis's ratio. Data: per record n
    `time_n`, `acceleration_n`, `inertial_n` (force minus friction and weight), `ratio_n` (0 for
    excluded samples); `shifts` [s]. Raises ValueError for a handle that hardly moved,
    MissingResult, and the errors of `Lab.record`.
    """
    trials = _trials(settings)
    model = friction_model.friction_model_of(lab.result(friction_model.NAME))
    parts = lab.record(NAME, trials, kept)
    records = [_record(part, model) for part in parts.values()]
    every = max(round(lab.rate / _REGRESSION_HZ), 1)
    mass, *left = regression(records, settings.least_speed, every)
    plain, *_ = regression(records, settings.least_speed, every, loaded=False)
    sources = (
        *jackknifed(
            "scatter of the records, each of which shares the friction model's errors",
            lambda some: regression(list(some), settings.least_speed, every)[:1], records,
        ),
        bounded("friction that grows with the load: the fit with and without it", mass - plain),
        *lab.real(bounded(TRANSDUCER, TRANSDUCER_ERROR * mass)),
    )  # fmt: skip
    ratios, strict = (
        [
            ratio(moved, moved.force - friction, settings.least_speed, least, settings.widest_shift)
            for moved, friction in records
        ]
        for least in (settings.least_acceleration, settings.least_acceleration * _STRICT)
    )
    printed, stricter = (
        _mean_and_deviation(np.concatenate([r.mass for r in found])) for found in (ratios, strict)
    )
    shifts, nan = np.array([r.shift for r in strict]), math.nan
    quantities = (
        from_sources("mass", mass, sources, "kg", "mass at the handle, by regression"),
        Quantity("mass_thesis", *printed, "kg", "mean of the ratio (sd), as printed"),
        Quantity("mass_thesis_strict", *stricter, "kg",
                 "the same, accelerations of 2.5 m/s^2 and more"),
        Quantity("shift", *_mean_and_deviation(shifts), "s", "best time shift of the strict ratio"),
        *(
            Quantity(f"{name}_left", value, nan, unit, text)
            for (name, unit, text), value in zip(_LEFT, left, strict=True)
        ),
        Quantity("fastest", max(float(np.abs(r.velocity).max()) for r, _ in records), nan, "m/s",
                 "fastest sample"),
    )  # fmt: skip
    data = {"shifts": shifts, "mass": np.array([mass, *left])}
    for number, ((record, friction), found) in enumerate(zip(records, strict, strict=True)):
        data |= {
            f"time_{number}": record.time[::_SHOWN],
            f"acceleration_{number}": record.acceleration[::_SHOWN],
            f"inertial_{number}": (record.smooth - friction)[::_SHOWN],
            f"ratio_{number}": np.nan_to_num(found.mass)[::_SHOWN],
        }
    listed = ", ".join(f"{shift * 1e3:.1f}" for shift in shifts if np.isfinite(shift)) or "no"
    notes = (
        "The friction model is extrapolated beyond the fastest speed of the maps, as in 5.3.",
        f"With accelerations from 2.5 mm/s^2, as printed, the ratio is {printed[0]:.2f} kg with a "
        f"standard deviation of {printed[1]:.3g} kg: near zero acceleration the ratio amplifies "
        "any error of the friction. The strict figures use accelerations from 2.5 m/s^2.",
        f"Best shifts of the strict ratio: {listed} ms, positive for a delayed acceleration "
        "(thesis: 8 to 18 ms, regarded as an artifact; our filters have no delay).",
    )
    return Result(NAME, beside(THESIS, quantities), settings._asdict(), notes, data)


def kept(trial: MotionTrial, samples: Samples) -> Part:
    """Reduce a record to time, position and force."""
    return {"time": samples.time, "position": samples.position, "force": samples.force}


def _mean_and_deviation(values: np.ndarray) -> tuple[float, float]:
    """Return both of the finite values (5.3.3), NaN without any."""
    known = values[np.isfinite(values)]
    return (float(known.mean()), float(known.std())) if len(known) else (math.nan, math.nan)


def _trials(settings: Settings) -> dict[str, MotionTrial]:
    arm = Arm(*map(float, (settings.arm_mass, settings.arm_stiffness, settings.arm_damping)))
    still = MotionTrial(
        modes.OFF, VerticalSettings(), arm=arm, centre=float(settings.centre),
        duration=float(settings.duration),
    )  # fmt: skip
    swings = zip(settings.amplitudes, settings.omegas, strict=True)
    return {
        f"record_{number}": still._replace(amplitude=float(amplitude), omega=float(omega))
        for number, (amplitude, omega) in enumerate(swings)
    }


def _record(part: Part, model: FrictionModel) -> Record:
    """Return a record with the friction and weight along it [N]."""
    record = motion(part["time"], part["position"], part["force"])
    projected = model._replace(fastest_mm_s=_PROJECTED)
    return record, friction_along(projected, record.position, record.velocity) + model.gravity_N


def motion(time: np.ndarray, position: np.ndarray, force: np.ndarray) -> Motion:
    """Differentiate a record as in 5.3.2: centre difference, low-pass, and both again.

    time [s], evenly spaced, position [m], force [N]. The result lacks the ends, where the filter
    has only half of its samples.
    """
    period = (time[-1] - time[0]) / (len(time) - 1)
    taps = optimal_lowpass(CUTOFF_HZ, STOP_HZ, 1.0 / period)
    velocity = zero_phase(_centre_difference(position, period), taps)
    acceleration = zero_phase(_centre_difference(velocity, period), taps)
    smooth = zero_phase(zero_phase(force, taps), taps)
    edge = round(_EDGE_S / period)
    record = Motion(time, position, velocity, acceleration, force, smooth)
    return Motion(*(values[edge:-edge] for values in record))


def _centre_difference(values: np.ndarray, period: float) -> np.ndarray:
    inner = oaconvolve(values, _CENTRE / period, mode="valid")
    return np.concatenate((inner[:1], inner, inner[-1:]))


def ratio(
    record: Motion,
    inertial: np.ndarray,
    least_speed: float,
    least_acceleration: float,
    widest_shift: float,
) -> Ratio:
    """Return the thesis's mass: inertial force over acceleration, best shift of the two.

    inertial: force minus friction and weight [N]. The shift, at most widest_shift [s] in either
    direction, gives the ratio's least standard deviation; NaN without usable samples.
    """
    period = (record.time[-1] - record.time[0]) / (len(record.time) - 1)
    widest = round(widest_shift / period)
    middle = slice(widest, len(inertial) - widest)
    fast = np.abs(record.velocity[middle]) >= least_speed
    best, least = Ratio(math.nan, np.full(len(inertial), np.nan)), np.inf
    for shift in range(-widest, widest + 1):
        moved = record.acceleration[widest - shift : len(inertial) - widest - shift]
        use = fast & (np.abs(moved) >= least_acceleration)
        found = inertial[middle][use] / moved[use]
        if len(found) and found.std() < least:
            least = float(found.std())
            mass = np.full(len(inertial), np.nan)
            mass[middle][use] = found
            best = Ratio(shift * period, mass)
    return best


def regression(
    records: list[Record], least_speed: float, every: int, loaded: bool = True
) -> list[float]:
    """Fit F - F_f = M a + b v + c sign(v) + d + l (|F| - |F_f|) sign(v) over all records.

    F is the filtered force. least_speed [m/s]: slower samples do not count; every: use each n-th
    sample, as neighbours are correlated; loaded: False omits the last term, l = 0. Returns mass M
    [kg], then the values of `_LEFT`: errors of the friction model, rms of the residual [N].
    Raises ValueError without samples.
    """
    rows, wanted = [], []
    for record, friction in records:
        use = np.flatnonzero(np.abs(record.velocity) >= least_speed)[::every]
        v = record.velocity[use]
        force, held = record.smooth[use], friction[use]
        leaning = (np.abs(force) - np.abs(held)) * np.sign(v) * loaded
        rows.append((record.acceleration[use], v, np.sign(v), np.ones_like(v), leaning))
        wanted.append(force - held)
    terms, force = np.concatenate(rows, axis=1).T, np.concatenate(wanted)
    if len(force) < 10 * terms.shape[1]:
        raise ValueError("too few samples of the motion are fast enough to determine a mass")
    start, *_ = np.linalg.lstsq(terms, force, rcond=None)
    found = least_squares(
        lambda x: terms @ x - force, start, jac=lambda x: terms.copy(), loss="soft_l1"
    )
    left = terms @ found.x - force
    return [*found.x.tolist(), float(np.sqrt(np.mean(left**2)))]


def draw(result: Result) -> Drawn:
    """Return figs 5-31 to 5-34, from the third record if there is one."""
    record = min(2, len(result.data["shifts"]) - 1)
    names = ("time", "acceleration", "inertial", "ratio")
    time, acceleration, inertial, ratio = (result.data[f"{name}_{record}"] for name in names)
    time = time - time[0] - _BEGIN
    force, swings = "force [N] and acceleration [m/s$^2$]", (acceleration, _ACCELERATION)
    less = {"color": COLOURS[0], "label": "force less friction and weight [N]"}
    scaled = less | {"label": f"{less['label']}, times {_SCALE:g}"}
    last, axes = _over_time(
        time, _LONG, "mass [kg] and acceleration [m/s$^2$]",
        "Fig. 5-34: mass by the ratio, from 2.5 m/s$^2$ on (thesis: 2.5 mm/s$^2$)",
        swings, (ratio, {"color": COLOURS[0], "label": "ratio [kg], 0 = left out"}),
    )  # fmt: skip
    mass, thesis = result.value("mass"), THESIS["mass"]
    axes.axhline(mass, color=COLOURS[3], label=f"by regression, {mass:.2f} kg")
    axes.axhline(thesis.value, color=DESIRED, linestyle=":",
                 label=f"{thesis.value:g} kg of 5.3.3 ({CREDIT})")  # fmt: skip
    axes.legend(loc="upper right", ncols=2)
    return {
        "5-31": filter_figure(optimal_lowpass(CUTOFF_HZ, STOP_HZ, THESIS_RATE),
                              "Fig. 5-31: low-pass of velocity and acceleration"),
        "5-32": _over_time(time, _LONG, force, "Fig. 5-32: force less friction and weight",
                           (inertial, less), swings)[0],
        "5-33": _over_time(time, _SHORT, force, "Fig. 5-33: the same force times 0.2",
                           (_SCALE * inertial, scaled), swings)[0],
        "5-34": last,
    }  # fmt: skip


_ACCELERATION = {"color": COLOURS[2], "linestyle": "--", "label": "acceleration [m/s$^2$]"}


def _over_time(
    time: np.ndarray, length: float, what: str, title: str, *lines: tuple[np.ndarray, dict]
) -> tuple[Figure, Axes]:
    """Draw lines, values with their style, over the first `length` seconds."""
    shown = (time >= 0.0) & (time <= length)
    figure, axes = axes_for("time [s]", what, title)
    for values, style in lines:
        axes.plot(time[shown], values[shown], **style)
    axes.set_xlim(0.0, length)
    axes.margins(y=0.2)
    axes.legend(loc="upper right", ncols=2)
    return figure, axes


EXPERIMENT = Experiment(
    NAME, "mass felt at the handle, from back-driven oscillations (thesis 5.3)", Settings, run,
    draw, HUMAN_ARM, ("friction_model",),
)  # fmt: skip
