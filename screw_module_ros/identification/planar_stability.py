# SPDX-License-Identifier: Apache-2.0
"""What the plane's structure bears of the force gain: its first mode by a sweep, and the gains.

The encoders stand at the joints, the force sensor at the handle; between them links, bearings and
flange bend (`plant.planar`). The motors push the handle with a swept sine, along x and along y,
while a hand keeps it moving, so that the joints slide. G, the force of the hand that the law sees
over the push, holds the hand, the structure, the amplifiers and all delays. With the law's low pass
C a gain k oscillates where an eigenvalue of k C G passes 1 (Nyquist), so the largest one is read
from the measured G, without a model of the arm. Where G does not yet rise to the mode it is the
hand's share of all masses, g: any heavier arm has at most 1 / g times as much of G there, and
somewhat more at the mode (`_HEAVIER`).

A robot whose motors cannot be swept, as on the live graph, has a mode that was measured otherwise
(`first_mode`, by a tap with an accelerometer on the free handle): then the gains are those of the
linear loop (`planar_sampled_loop`), the smaller ones of both sets of joint inertias that are known.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from scipy import signal

from ..calibration import plane_limits
from ..calibration.plane_version import plane_law_version
from ..control.laws.plane_impedance import PLANE_IMPEDANCE
from ..control.planar_settings import PlanarSettings
from ..plant.patient import HandPath
from ..plant.planar import INERTIAS
from ..plant.settings import load_world
from ..settings import Setting, validated
from ..software import version
from .calibration import date_now, own_serial, write_sealed
from .figures import COLOURS, DESIRED, panels
from .lab import Lab, Part
from .planar_sampled_loop import MOST, Plane, first_modes, largest_gain
from .results import DERIVED, HUMAN_ARM, MEASURED, Drawn, Experiment, Quantity, Result
from .stability import ENVIRONMENTS as LOADS
from .trials import PLANE, SWEPT, PlanarTrial, PlaneLoop, Samples

NAME = "planar_stability"
FILE = "plane_gain_limits.yaml"
_AXES = {"x": 0.0, "y": 0.5 * math.pi}
_SLIDES = HandPath(0.0, 0.0, 0.0, 0.0, 0.03, 3.0, 0.0)  # path of a hand faster than friction sticks
_BETWEEN = 0.25 * math.pi
_SEGMENT_S = 4.0
_BELOW = (6.0, 10.0)  # [Hz] where hand and arm move as one
_WINDOW_HZ = 2.0 / _SEGMENT_S  # half of the width that one frequency has in a segment (Hann)
_HELD = 0.02  # share by which hand and damping move it; 3.3 % at most on 24 drawn modules; ours
_HEAVIER = 0.7  # ours: with up to 0.4 of module and hand as the arm's own inertia
_LIMITS = {"hand": "the hand that held it", "any_arm": "an arm of any mass"}


class Settings(NamedTuple):
    """The sweep, and what stands for it on a robot without one."""

    serial: Annotated[str, Setting("serial number of the plane")] = "SIM-0001"
    amplitude: Annotated[float, Setting("of the push", "N", 0.5, 20.0)] = 5.0
    seconds: Annotated[float, Setting("of a sweep", "s", 20.0, 600.0)] = 60.0
    damping: Annotated[float, Setting("of the law's damper", "Ns/m", 0.0, 200.0)] = 10.0
    first_mode: Annotated[
        float, Setting("without a sweep: the lowest, handle free", "Hz", 1.0, 1000.0)
    ] = 76.0
    damping_ratio: Annotated[
        float, Setting("without a sweep: of the module on the structure", "", 0.001, 1.0)
    ] = 0.02


def run(lab: Lab, settings: Settings) -> Result:
    """Find the gains and write their file into the lab's folder.

    Data of a sweep: `frequency` [Hz], `response`: G, `loci`: eigenvalues of C G. Raises ValueError,
    Cancelled.
    """
    validated(settings)
    serial = own_serial(lab, settings.serial)
    law = PlanarSettings(damping=settings.damping)
    data: dict[str, np.ndarray] = {}
    stand: Any = lab.stand
    if PLANE in stand.offers:
        loop = stand.plane
        trials = {
            axis: PlanarTrial(
                law, direction=_BETWEEN, path=_SLIDES, duration=settings.seconds, loop=loop,
                sweep=settings.amplitude, pushed=pushed,
            )
            for axis, pushed in _AXES.items()
        }  # fmt: skip
        parts = lab.record(NAME, trials, reduced)
        data = _data(parts, loop.rate, law)
        mode, gains, kind, by = *_of_sweep(data), MEASURED, "sweep"
        apart = math.hypot(_WINDOW_HZ, _HELD * mode)
    else:
        loop = PlaneLoop()
        mode, kind, by = settings.first_mode, DERIVED, "linear model of a mode that was given"
        apart = math.nan
        gains = _of_model(settings, law, loop)
    quantities = [Quantity("first_mode", mode, apart, "Hz", "of the structure", kind)]
    for name, gain in gains.items():
        text = f"largest stable gain, {_LIMITS[name]}"
        quantities.append(Quantity(f"limit_{name}", gain, math.nan, "", text, kind))
    content = {
        "format": plane_limits.FORMAT, "version": plane_limits.VERSION, "serial": serial,
        "date": date_now(), "software": version(),
        "law": plane_law_version(PLANE_IMPEDANCE), "rate": loop.rate,
        "force_cutoff": law.force_cutoff, "found_by": by, "first_mode_Hz": round(mode, 1),
        "largest_gains_on": {
            name: math.floor(100.0 * min(gain, MOST)) / 100.0 for name, gain in gains.items()
        },
    }  # fmt: skip
    write_sealed(lab.folder / FILE, content)
    return Result(NAME, tuple(quantities), settings._asdict(), _NOTES, data)


_NOTES = (
    "The feedback is an integral of the force below its cut-off w: it meets the first mode W with "
    "the gain k w / W, and the mode answers with 1 / (2 zeta). So stiffness and damping of the "
    "structure bound the gain; with a stiff one the delay does. In a soft grip its damping does, "
    "of which a sweep in a firm hand knows nothing.",
)


def reduced(trial: PlanarTrial, samples: Samples) -> Part:
    """Return the hand's force that the law sees over the push, x and y, over the frequency."""
    rate = 1.0 / float(samples.time[1] - samples.time[0])
    count = round(_SEGMENT_S * rate)
    how = {"fs": rate, "nperseg": count, "noverlap": 3 * count // 4}
    frequency, power = signal.welch(samples.command, **how)
    crossed = [signal.csd(samples.command, column, **how)[1] for column in samples.force.T]
    kept = (frequency > 1.3 * SWEPT[0] * rate) & (frequency < 0.96 * SWEPT[1] * rate)
    return {
        "frequency": frequency[kept], "response": (np.array(crossed) / power).T[kept],
    }  # fmt: skip


def _data(parts: dict[str, Part], rate: float, law: PlanarSettings) -> dict[str, np.ndarray]:
    """Return frequencies, G and the eigenvalues of C G, each in a column that has no jumps."""
    frequency = parts["x"]["frequency"]
    response = np.stack([parts[axis]["response"] for axis in _AXES], axis=2)
    z = np.exp(2j * np.pi * frequency / rate)
    kept = math.exp(-2.0 * math.pi * law.force_cutoff / rate)
    lowpass = 0.5 * (1.0 - kept) * (1.0 + 1.0 / z) / (1.0 - kept / z)
    loci = np.linalg.eigvals(response) * lowpass[:, None]
    for before, now in zip(loci, loci[1:], strict=False):
        if np.abs(now - before).sum() > np.abs(now[::-1] - before).sum():
            now[:] = now[::-1].copy()
    return {"frequency": frequency, "response": response, "loci": loci}


def _of_sweep(data: dict[str, np.ndarray]) -> tuple[float, dict[str, float]]:
    """Return the first mode [Hz] and the largest gains."""
    frequency, loci = data["frequency"], data["loci"]
    size = np.linalg.svd(data["response"], compute_uv=False)[:, 0]
    above = frequency > _BELOW[1]
    low = size[(frequency > _BELOW[0]) & (frequency < _BELOW[1])]
    imaginary, real = loci.imag, loci.real
    crosses = np.diff(np.sign(imaginary), axis=0) != 0
    part = imaginary[:-1] / np.where(crosses, imaginary[:-1] - imaginary[1:], 1.0)
    passed = np.where(crosses, real[:-1] + part * np.diff(real, axis=0), 0.0).max()
    hand = min(1.0 / max(passed, 1e-9), MOST)
    mode = float(frequency[above][np.argmax(size[above])])
    return mode, {"hand": hand, "any_arm": _HEAVIER * min(float(np.median(low)), 1.0) * hand}


def _of_model(settings: Settings, law: PlanarSettings, loop: PlaneLoop) -> dict[str, float]:
    """Return the largest gains of the linear loop whose lowest mode is the one that is given."""
    found: dict[str, list[float]] = {"hand": [], "any_arm": []}
    for inertia in INERTIAS:
        robot = load_world().planar._replace(
            inertia=inertia, structure_damping_ratio=settings.damping_ratio
        )
        scale = (settings.first_mode / first_modes(Plane(robot))[0]) ** 2
        bent = robot._replace(structure_stiffness=scale * robot.structure_stiffness)
        for name, load in (("hand", "hand"), ("any_arm", "heavy_arm")):
            found[name].append(largest_gain(Plane(bent, LOADS[load][1]), loop, law))
    return {name: min(*gains, MOST) for name, gains in found.items()}


def draw(result: Result) -> Drawn:
    """Draw the size of G over the frequency, and the loci whose way past 1 limits the gain."""
    if not result.data:
        return {}
    figure, (left, right) = panels(1, 2, (8.6, 4.4))
    size = np.linalg.svd(result.data["response"], compute_uv=False)
    for column, colour in enumerate(COLOURS[:2]):
        left.plot(result.data["frequency"], size[:, column], color=colour)
        locus = result.value("limit_hand") * result.data["loci"][:, column]
        right.plot(locus.real, locus.imag, color=colour)
    left.axvline(result.value("first_mode"), color=DESIRED, linewidth=0.8, linestyle="--")
    left.set(xscale="log", yscale="log", xlabel="frequency [Hz]",
             title="Force of the hand over push, largest and least")  # fmt: skip
    right.plot([1.0], [0.0], "x", color=DESIRED)
    right.set(xlabel="real", ylabel="imaginary", title="Loci at the largest gain, which pass 1")
    return {"planar stability": figure}


EXPERIMENT = Experiment(
    NAME, "first mode of the plane's structure, largest stable force gain, and their file",
    Settings, run, draw, HUMAN_ARM,
)  # fmt: skip
