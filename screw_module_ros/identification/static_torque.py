# SPDX-License-Identifier: Apache-2.0
"""Dead zone, torque constant and linearization of the amplifier (thesis 4.1.1, figs 4-2 to 4-4).

The rotor is locked to the transducer. A slow sine of the command gives command over torque, which
is fitted with line, cubic, line. A second sine through that fit shows the residual.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from scipy.optimize import least_squares
from scipy.signal import butter, sosfiltfilt

from ..control.linearization import SMALLEST_JOINT, Line, Linearization, torque_command
from ..geometry import Screw, torque_to_force
from ..settings import Setting, validated
from .figures import COLOURS, axes_for, printed
from .lab import Lab, Part
from .results import (
    LOCKED_ROTOR,
    Drawn,
    Experiment,
    Published,
    Quantity,
    Result,
    beside,
    from_sources,
)
from .trials import Samples, TorqueTrial
from .uncertainty import TRANSDUCER, TRANSDUCER_ERROR, Source, bounded

NAME = "static_torque"
THESIS = {
    "lack": Published("linearized_correlation", 1e-4, computed=4e-5),
    "dead_zone": Published("dead_zone", 0.005, given_to_plant=True),
    "torque_constant": Published("torque_constant", 0.005, given_to_plant=True),
}
_ORDER = 4
_GRID = np.linspace(0.01, 0.06, 11)  # initial values of the joints [Nm]
_REACH = (SMALLEST_JOINT, 0.5)  # smallest joint [Nm], largest as a share of the torque reached
_EVERY = 5  # samples to one dot
_FIRST, _, _THIRD = COLOURS[:3]


class Settings(NamedTuple):
    """The sine and the filter of the torque."""

    amplitude: Annotated[
        float, Setting("torque command, at most the motor's continuous torque", "Nm", 0.1, 0.8)
    ] = 0.42  # thesis: continuous_torque
    omega: Annotated[float, Setting("of the sine", "rad/s", 0.1, 10.0)] = 1.0  # thesis: static_sine
    duration: Annotated[
        float, Setting("of the sine", "s", 2.0, 200.0)
    ] = 7.0  # thesis: static_duration
    cutoff: Annotated[
        float, Setting("zero-phase low pass on the torque, for the fit", "Hz", 1.0, 100.0)
    ] = 20.0
    line_from: Annotated[
        float, Setting("the curve is a line above this torque", "Nm", 0.02, 0.5)
    ] = 0.1
    torque_constant: Annotated[
        float, Setting("published torque constant: command to current", "Nm/A", 1e-3, 10.0)
    ] = 0.16  # thesis: torque_constant

    def flaw(self) -> str:
        """Return what is wrong with a sine that is shorter than a period."""
        period = 2.0 * math.pi / self.omega
        short = f"duration = {self.duration:g} s is less than one period of the sine, {period:.3g}"
        return f"{short} s" if self.duration < period else ""


class Pieces(NamedTuple):
    """The fit: the map, and standard errors of (lower value and slope, upper value and slope at
    the joints) and of the two joints; residual: standard deviation of the command [Nm]."""

    linearization: Linearization
    errors: np.ndarray
    joint_errors: np.ndarray
    residual: float


def run(lab: Lab, settings: Settings) -> Result:
    """Measure, fit, and measure again through the fit. Raises ValueError, Cancelled, NotPossible.

    ValueError: torque does not follow the command.
    """
    trial = TorqueTrial(settings.omega / (2.0 * math.pi), settings.amplitude, settings.duration)
    raw = lab.record(NAME, {"raw": trial}, reduced)["raw"]
    torque, command = _smoothed(raw, settings)
    # About 2 x cutoff of the filtered samples of a second are independent.
    fewer = math.sqrt(max(_rate(raw) / (2.0 * settings.cutoff), 1.0))
    fit = fit_pieces(torque, command, fewer)
    real = lab.real(bounded(TRANSDUCER, TRANSDUCER_ERROR))  # as a share
    again = trial._replace(linearization=fit.linearization)
    linear = lab.record(NAME, {"linearized": again}, reduced)["linearized"]
    desired = desired_torque(fit.linearization, linear["command"])
    curve = np.linspace(raw["torque"].min(), raw["torque"].max(), 401)
    data = {
        "command": raw["command"] / settings.torque_constant,
        "torque": raw["torque"],
        "fit_torque": curve,
        "fit_command": commands(fit.linearization, curve) / settings.torque_constant,
        "linear_desired": desired / settings.torque_constant,
        "linear_torque": linear["torque"],
    }
    quantities = (
        _largest(linear, fit, settings, lab.stand.screw)
        + _asymptotes(torque, command, settings, fewer, real)
        + _check(raw, desired, linear["torque"])
        + _found(fit)
    )
    return Result(NAME, beside(THESIS, quantities), settings._asdict(), _notes(fit, settings), data)


def reduced(trial: TorqueTrial, samples: Samples) -> Part:
    """Return time [s], command [Nm] and torque [Nm]."""
    return {"time": samples.time, "command": samples.command, "torque": samples.torque}


def linearization_of(result: Result) -> Linearization:
    """Return the linearization of a result. Raises KeyError, ValueError if it is damaged."""
    v = result.value
    return validated(
        Linearization(
            (v("lower_joint"), v("upper_joint")),
            Line(v("lower_slope"), v("lower_offset")),
            (v("cubic_3"), v("cubic_2"), v("cubic_1"), v("cubic_0")),
            Line(v("upper_slope"), v("upper_offset")),
        )
    )


def _smoothed(raw: Part, settings: Settings) -> tuple[np.ndarray, np.ndarray]:
    """Return smoothed torque and command [Nm] of whole periods in the middle of the record.

    So a lag has equal effects on rising and falling torque, and the filter's ends do not count. The
    command is filtered as well: its steps of object 6071 are no scatter of the torque.
    """
    time = raw["time"]
    sections = butter(_ORDER, settings.cutoff, fs=_rate(raw), output="sos")
    period = 2.0 * math.pi / settings.omega
    length = time[-1] - time[0]
    spare = 0.5 * (length - math.floor(length / period + 1e-6) * period)
    kept = (time >= time[0] + spare) & (time <= time[-1] - spare)
    torque, command = (sosfiltfilt(sections, raw[name])[kept] for name in ("torque", "command"))
    return torque, command


def _rate(raw: Part) -> float:
    return 1.0 / float(raw["time"][1] - raw["time"][0])


def _asymptotes(
    torque: np.ndarray, command: np.ndarray, settings: Settings, fewer: float,
    real: tuple[Source, ...],
) -> tuple[Quantity, ...]:  # fmt: skip
    """Return torque constant and dead zone from the straight ends of the curve.

    The lines of the three pieces begin where the curve still bends and would give smaller values.
    Torque lags behind the command: a term in proportion to the command's rate of change keeps that
    out of slope, offset and scatter.
    """
    ends, rate = [], np.gradient(command)
    rate = rate / np.abs(rate).max()
    for side in (torque < -settings.line_from, torque > settings.line_from):
        if np.count_nonzero(side) < 10:
            raise ValueError(
                f"line_from = {settings.line_from:g} Nm: too few samples have a larger torque"
            )
        terms = np.column_stack((torque[side], np.ones(np.count_nonzero(side)), rate[side]))
        found, *_ = np.linalg.lstsq(terms, command[side])
        spread = np.std(command[side] - terms @ found) * fewer
        errors = spread * np.sqrt(np.diag(np.linalg.inv(terms.T @ terms)))
        ends.append((*found[:2], *errors[:2]))
    (low, low_offset, low_error, low_at), (high, high_offset, high_error, high_at) = ends
    slope, error = 0.5 * (low + high), 0.5 * math.hypot(low_error, high_error)
    constant = float(settings.torque_constant / slope)
    dead = float(0.5 * (high_offset - low_offset) / slope)
    dead_error = 0.5 * math.hypot(low_at, high_at)

    def sources(value: float, error: float) -> list[Source]:
        scaled = [source._replace(standard=abs(value) * source.standard) for source in real]
        scatter = Source("scatter about the straight ends, smoothed", float(error))
        return [scatter, *scaled]

    return (
        from_sources("torque_constant", constant, sources(constant, constant * error / slope),
                     "Nm/A", "torque per ampere of command beyond the dead zone"),
        from_sources("dead_zone", dead, sources(dead, dead_error / slope), "Nm",
                     "torque lost on each side of zero: between the straight ends"),
    )  # fmt: skip


def _found(fit: Pieces) -> tuple[Quantity, ...]:
    (lower_joint, upper_joint), lower, (c3, c2, c1, c0), upper = fit.linearization
    low, low_slope, high, high_slope = fit.errors
    low_offset = math.hypot(low, low_slope * lower_joint)
    high_offset = math.hypot(high, high_slope * upper_joint)
    return (
        Quantity("lower_joint", lower_joint, fit.joint_errors[0], "Nm", "line meets cubic"),
        Quantity("upper_joint", upper_joint, fit.joint_errors[1], "Nm", "cubic meets line"),
        Quantity("lower_slope", lower.slope, low_slope, "", "of the lower line"),
        Quantity("lower_offset", lower.offset_Nm, low_offset, "Nm", "of the lower line"),
        Quantity("cubic_3", c3, math.nan, "1/Nm^2", "of the cubic between the joints"),
        Quantity("cubic_2", c2, math.nan, "1/Nm", "of the cubic"),
        Quantity("cubic_1", c1, math.nan, "", "of the cubic"),
        Quantity("cubic_0", c0, math.nan, "Nm", "of the cubic"),
        Quantity("upper_slope", upper.slope, high_slope, "", "of the upper line"),
        Quantity("upper_offset", upper.offset_Nm, high_offset, "Nm", "of the upper line"),
    )  # fmt: skip


def _check(raw: Part, desired: np.ndarray, torque: np.ndarray) -> tuple[Quantity, ...]:
    before = float(np.corrcoef(raw["command"], raw["torque"])[0, 1])
    after = float(np.corrcoef(desired, torque)[0, 1])
    slope, offset = np.polyfit(desired, torque, 1)
    left, count = float(np.std(torque - slope * desired - offset)), math.sqrt(len(desired))
    return (
        Quantity("correlation", after, (1.0 - after**2) / count, "",
                 "of torque with desired torque, linearized"),
        Quantity("lack", 1.0 - after, (1.0 - after**2) / count, "",
                 "of that correlation to 1; the thesis has a correlation of 0.99996"),
        Quantity("correlation_raw", before, (1.0 - before**2) / count, "",
                 "of torque with command, as it is"),
        Quantity("slope", float(slope), left / (count * float(np.std(desired))), "",
                 "torque per desired torque, linearized"),
        Quantity("left_over", left, left / math.sqrt(2.0) / count, "Nm",
                 "standard deviation of torque about that line, noise included"),
    )  # fmt: skip


def _largest(
    linear: Part, fit: Pieces, settings: Settings, screw: Screw
) -> tuple[Quantity, ...]:
    torque, command = _smoothed(linear, settings)
    off = float(np.abs(torque - desired_torque(fit.linearization, command)).max())
    return (
        Quantity("largest_left", off, math.nan, "Nm",
                 "largest difference of smoothed torque from desired torque, linearized"),
        Quantity("largest_at_handle", torque_to_force(off, screw), math.nan, "N",
                 "the same as a force at the handle; one step of object 6071 is 0.14 N"),
    )  # fmt: skip


def _notes(fit: Pieces, settings: Settings) -> tuple[str, ...]:
    joints, lower, (c3, c2, c1, _), upper = fit.linearization
    steps = [
        abs((3.0 * c3 * t + 2.0 * c2) * t + c1 - line.slope)
        for t, line in zip(joints, (lower, upper), strict=True)
    ]
    return (
        "The largest error at the handle is the relevant figure: a correlation of 0.9999 still "
        "allows an error of more than a newton.",
        f"For the fits the torque is filtered at {settings.cutoff:g} Hz forwards and backwards: "
        "its noise would reduce the slope of a fit of command over torque.",
        f"The slope steps by {steps[0]:.1%} and {steps[1]:.1%} at the joints (thesis: about 10 %); "
        "the joints are fitted, too, instead of fixed at +-0.025 Nm.",
        "Standard errors come from the scatter about the fit, which includes the misfit of the "
        f"three pieces to the dead zone: {1000.0 * fit.residual:.2g} mNm of command.",
    )


def fit_pieces(torque: np.ndarray, command: np.ndarray, fewer: float = 1.0) -> Pieces:
    """Fit line, cubic, line of command [Nm] over torque [Nm], continuous, by least squares.

    For fixed joints the problem is linear: values and slopes of both lines at their joints, and the
    cubic as the chord between them plus (T - low)(T - high)(p + q T). An outer optimisation finds
    the joints. fewer: factor of the standard errors for samples that are not independent. Raises
    ValueError if the torques do not determine the fit or the command does not increase.
    """
    reach = min(-float(torque.min()), float(torque.max()))
    if reach < 3.0 * _GRID[0]:
        raise ValueError(
            f"torque reached {torque.min():.3g} to {torque.max():.3g} Nm: too little on one side "
            "for a fit in three pieces; is the rotor locked and the drive enabled?"
        )

    def left(joints: np.ndarray) -> np.ndarray:
        return _linear_part(joints, torque, command)[1]

    low, high = _REACH[0], _REACH[1] * reach
    grid = [np.array([-joint, joint]) for joint in _GRID if joint < high]
    start = min(grid, key=lambda joints: float(np.sum(left(joints) ** 2)))
    found = least_squares(
        left, start, bounds=([-high, low], [-low, high]), x_scale=0.01, diff_step=1e-3
    )
    numbers, residual, basis = _linear_part(found.x, torque, command)
    spread, (low, high) = float(np.std(residual)), found.x.tolist()
    lower, lower_slope, upper, upper_slope, p, q = numbers.tolist()
    chord = (upper - lower) / (high - low)
    cubic = np.polyadd(
        np.polymul(np.poly([low, high]), [q, p]), [chord, lower - chord * low]
    )
    return Pieces(
        validated(Linearization(
            (low, high),
            Line(lower_slope, lower - lower_slope * low),
            tuple(cubic.tolist()),
            Line(upper_slope, upper - upper_slope * high),
        )),
        spread * np.sqrt(np.diag(np.linalg.inv(basis.T @ basis)))[:4] * fewer,
        spread * np.sqrt(np.diag(np.linalg.pinv(found.jac.T @ found.jac))) * fewer,
        spread,
    )  # fmt: skip


def _linear_part(
    joints: np.ndarray, torque: np.ndarray, command: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the six coefficients for fixed joints, the residual and the basis."""
    low, high = joints
    share = np.clip((torque - low) / (high - low), 0.0, 1.0)
    inside = (torque > low) & (torque < high)
    bow = np.where(inside, (torque - low) * (torque - high), 0.0)
    basis = np.column_stack(
        [
            1.0 - share,
            np.minimum(torque - low, 0.0),
            share,
            np.maximum(torque - high, 0.0),
            bow,
            bow * torque,
        ]
    )
    numbers = np.linalg.lstsq(basis, command, rcond=None)[0]
    return numbers, basis @ numbers - command, basis


def desired_torque(linearization: Linearization | None, command: np.ndarray) -> np.ndarray:
    """Return the desired torque [Nm] that the linearization maps to `command` [Nm]."""
    if linearization is None:
        return command
    far = 2.0 + float(np.abs(command).max())
    torques = np.concatenate([[-far], np.linspace(*linearization.joints_Nm, 2001), [far]])
    return np.interp(command, commands(linearization, torques), torques)


def commands(linearization: Linearization, torques: np.ndarray) -> np.ndarray:
    """Return the commands [Nm] for torques [Nm]."""
    return np.array([torque_command(linearization, float(torque)) for torque in torques])


def measured_linearization(lab: Lab) -> Linearization:
    """Return the linearization measured in this lab. Raises MissingResult."""
    return linearization_of(lab.result(NAME))


def draw(result: Result) -> Drawn:
    """Return figs 4-2 to 4-4."""
    d, v = result.data, result.value
    first, axes = axes_for("commanded current [A]", "torque [Nm]",
                           "Fig. 4-2: torque against commanded current")  # fmt: skip
    _dots(axes, d["command"], d["torque"], f"measured, correlation {v('correlation_raw'):.5f}")
    zone = THESIS["dead_zone"].value / THESIS["torque_constant"].value
    printed(axes, [-zone, zone], [0.0, 0.0], "dead zone, 4.1.1")
    axes.legend()
    second, axes = axes_for("desired torque [Nm]", "commanded current [A]",
                            "Fig. 4-3: commanded current against desired torque")  # fmt: skip
    closeup = axes.inset_axes((0.62, 0.1, 0.36, 0.4))
    for part, label in ((axes, "measured"), (closeup, "")):
        _dots(part, d["torque"], d["command"], label)
        part.plot(d["fit_torque"], d["fit_command"], color=_THIRD, lw=1.6,
                  label="line, cubic, line")  # fmt: skip
    joints = [v("lower_joint"), v("upper_joint")]
    at = np.interp(joints, d["fit_torque"], d["fit_command"])
    axes.plot(joints, at, "o", color=_THIRD, mfc="white", label="joints", zorder=4)
    axes.legend()
    closeup.set(xlim=(-0.04, 0.04), ylim=(-0.45, 0.45))
    closeup.set_title("near zero", fontsize=9, loc="center")
    closeup.tick_params(labelsize=8)
    third, axes = axes_for("desired current [A]", "torque [Nm]",
                           "Fig. 4-4: torque against current, using the linearization")  # fmt: skip
    _dots(axes, d["linear_desired"], d["linear_torque"],
          f"measured, correlation {v('correlation'):.5f}")  # fmt: skip
    ends = np.array([d["linear_desired"].min(), d["linear_desired"].max()])
    axes.plot(ends, v("slope") * result.settings["torque_constant"] * ends, color=_THIRD,
              label="straight line")  # fmt: skip
    axes.legend()
    return {"4-2": first, "4-3": second, "4-4": third}


def _dots(axes: Axes, x: np.ndarray, y: np.ndarray, label: str) -> None:
    axes.plot(x[::_EVERY], y[::_EVERY], ".", ms=1.5, color=_FIRST, alpha=0.6)
    if label:
        axes.plot([], [], ".", ms=6, color=_FIRST, label=label)


EXPERIMENT = Experiment(
    NAME, "dead zone, torque constant and linearization of the amplifier (thesis 4.1.1)", Settings,
    run, draw, LOCKED_ROTOR,
)  # fmt: skip
