# SPDX-License-Identifier: Apache-2.0
"""Dead zone, torque constant and linearization of the amplifier (thesis 4.1.1, figs 4-2 to 4-4).

The rotor is locked to the transducer. A slow sine of the command gives command over torque, which
is fitted with line, cubic, line. A second sine through that fit shows the residual.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from scipy.signal import butter, sosfiltfilt

from ..control.linearization import Line, Linearization
from ..geometry import torque_to_force
from ..settings import Setting, validated
from .lab import Job, Lab, Part
from .linearization_fit import Pieces, commands, desired_torque, fit_pieces
from .results import Quantity, Result
from .trials import Samples, TorqueTrial

NAME = "static_torque"
_ORDER = 4


class Settings(NamedTuple):
    """The sine and the filter of the torque."""

    amplitude: Annotated[
        float, Setting("torque command, at most the motor's continuous torque", "Nm", 0.1, 0.8)
    ] = 0.42
    omega: Annotated[float, Setting("of the sine", "rad/s", 0.1, 10.0)] = 1.0
    duration: Annotated[float, Setting("of the sine", "s", 2.0, 200.0)] = 7.0
    cutoff: Annotated[
        float, Setting("zero-phase low pass on the torque, for the fit", "Hz", 1.0, 100.0)
    ] = 20.0
    line_from: Annotated[
        float, Setting("the curve is a line above this torque", "Nm", 0.02, 0.5)
    ] = 0.1
    torque_constant: Annotated[
        float, Setting("published torque constant: command to current", "Nm/A", 1e-3, 10.0)
    ] = 0.16


def run(lab: Lab, settings: Settings) -> Result:
    """Measure, fit, and measure again through the fit. Raises ValueError, Cancelled, NotPossible.

    ValueError: the sine is shorter than a period, or torque does not follow the command.
    """
    if settings.duration * settings.omega < 2.0 * math.pi:
        raise ValueError(
            f"duration = {settings.duration:g} s is less than one period of the sine, "
            f"{2.0 * math.pi / settings.omega:.3g} s"
        )
    trial = TorqueTrial(settings.omega / (2.0 * math.pi), settings.amplitude, settings.duration)
    raw = lab.run(NAME, [Job("raw", trial, reduced)])["raw"]
    torque, command = _smoothed(raw, settings)
    fit = _fit(torque, command, _fewer(raw, settings))
    again = trial._replace(linearization=fit.linearization)
    linear = lab.run(NAME, [Job("linearized", again, reduced)])["linearized"]
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
        _largest(linear, fit, settings)
        + _asymptotes(torque, command, settings, _fewer(raw, settings))
        + _check(raw, desired, linear["torque"])
        + _found(fit)
    )
    return Result(NAME, quantities, settings._asdict(), _notes(fit, settings), data)


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

    So a lag has equal effects on rising and falling torque, and the filter's ends do not count.
    """
    time = raw["time"]
    sections = butter(_ORDER, settings.cutoff, fs=_rate(raw), output="sos")
    period = 2.0 * math.pi / settings.omega
    length = time[-1] - time[0]
    spare = 0.5 * (length - math.floor(length / period + 1e-6) * period)
    kept = (time >= time[0] + spare) & (time <= time[-1] - spare)
    return sosfiltfilt(sections, raw["torque"])[kept], raw["command"][kept]


def _rate(raw: Part) -> float:
    return 1.0 / float(raw["time"][1] - raw["time"][0])


def _fewer(raw: Part, settings: Settings) -> float:
    """Return the factor of the standard errors for the correlation of filtered samples.

    About 2 x cutoff samples per second are independent.
    """
    return math.sqrt(max(_rate(raw) / (2.0 * settings.cutoff), 1.0))


def _fit(torque: np.ndarray, command: np.ndarray, fewer: float) -> Pieces:
    fit = fit_pieces(torque, command)
    return fit._replace(errors=fit.errors * fewer, joint_errors=fit.joint_errors * fewer)


def _asymptotes(
    torque: np.ndarray, command: np.ndarray, settings: Settings, fewer: float
) -> tuple[Quantity, ...]:
    """Return torque constant and dead zone from the straight ends of the curve.

    The lines of the three pieces begin where the curve still bends and would give smaller values.
    """
    ends = []
    for side in (torque < -settings.line_from, torque > settings.line_from):
        if np.count_nonzero(side) < 10:
            raise ValueError(
                f"line_from = {settings.line_from:g} Nm: too few samples have a larger torque"
            )
        (slope, offset), covariance = np.polyfit(torque[side], command[side], 1, cov="unscaled")
        off = command[side] - slope * torque[side] - offset
        ends.append((slope, offset, *(np.std(off) * fewer * np.sqrt(np.diag(covariance)))))
    (low, low_offset, low_error, low_at), (high, high_offset, high_error, high_at) = ends
    slope, error = 0.5 * (low + high), 0.5 * math.hypot(low_error, high_error)
    constant = float(settings.torque_constant / slope)
    return (
        Quantity("torque_constant", constant, float(constant * error / slope), "Nm/A",
                 "torque per ampere of command beyond the dead zone"),
        Quantity("dead_zone", float(0.5 * (high_offset - low_offset) / slope),
                 float(0.5 * math.hypot(low_at, high_at) / slope), "Nm",
                 "torque lost on each side of zero: between the straight ends"),
    )  # fmt: skip


def _found(fit: Pieces) -> tuple[Quantity, ...]:
    (lower_joint, upper_joint), lower, (c3, c2, c1, c0), upper = fit.linearization
    low, low_slope, high, high_slope = fit.errors
    low_offset = math.hypot(low, low_slope * lower_joint)
    high_offset = math.hypot(high, high_slope * upper_joint)
    nan = math.nan
    return (
        Quantity("lower_joint", lower_joint, fit.joint_errors[0], "Nm", "line meets cubic"),
        Quantity("upper_joint", upper_joint, fit.joint_errors[1], "Nm", "cubic meets line"),
        Quantity("lower_slope", lower.slope, low_slope, "", "of the lower line"),
        Quantity("lower_offset", lower.offset_Nm, low_offset, "Nm", "of the lower line"),
        Quantity("cubic_3", c3, nan, "1/Nm^2", "of the cubic between the joints"),
        Quantity("cubic_2", c2, nan, "1/Nm", "of the cubic"),
        Quantity("cubic_1", c1, nan, "", "of the cubic"),
        Quantity("cubic_0", c0, nan, "Nm", "of the cubic"),
        Quantity("upper_slope", upper.slope, high_slope, "", "of the upper line"),
        Quantity("upper_offset", upper.offset_Nm, high_offset, "Nm", "of the upper line"),
    )  # fmt: skip


def _check(raw: Part, desired: np.ndarray, torque: np.ndarray) -> tuple[Quantity, ...]:
    before = float(np.corrcoef(raw["command"], raw["torque"])[0, 1])
    after = float(np.corrcoef(desired, torque)[0, 1])
    slope, offset = np.polyfit(desired, torque, 1)
    left = float(np.std(torque - slope * desired - offset))
    error = left / (math.sqrt(len(desired)) * float(np.std(desired)))
    count = math.sqrt(len(desired))
    return (
        Quantity("correlation", after, (1.0 - after**2) / count, "",
                 "of torque with desired torque, linearized (thesis 0.99996)"),
        Quantity("correlation_raw", before, (1.0 - before**2) / count, "",
                 "of torque with command, as it is"),
        Quantity("slope", float(slope), error, "", "torque per desired torque, linearized"),
        Quantity("left_over", left, left / math.sqrt(2.0) / count, "Nm",
                 "standard deviation of torque about that line, noise included"),
    )  # fmt: skip


def _largest(linear: Part, fit: Pieces, settings: Settings) -> tuple[Quantity, ...]:
    torque, command = _smoothed(linear, settings)
    off = np.abs(torque - desired_torque(fit.linearization, command))
    return (
        Quantity("largest_left", float(off.max()), math.nan, "Nm",
                 "largest difference of smoothed torque from desired torque, linearized"),
        Quantity("largest_at_handle", torque_to_force(float(off.max())), math.nan, "N",
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
