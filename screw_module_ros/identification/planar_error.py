# SPDX-License-Identifier: Apache-2.0
"""Force error in the plane, with and without force feedback. Ours: the thesis has none.

The error is what the hand feels beyond the spring and damper asked for, its true force less
K x + B v of the true handle, over all samples as in `force_error`: in slow, fast and small motion,
reaching, holding still, letting go, with an arm of 30 kg, a tremor, and on walls. The command
`study` has the same trials on rigs drawn by seed.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np

from ..control.planar_settings import STUDIED_GAIN, PlanarSettings
from ..plant.patient import HandPath
from ..settings import Setting
from .figures import error_map
from .force_error import WALLS, wall
from .force_metric import ErrorOf, judged
from .lab import Lab, Part
from .results import HUMAN_ARM, Drawn, Experiment, Quantity, Result
from .trials import Arm, PlanarTrial, Samples

NAME = "planar_error"
KINDS = ("none", "feedback")
_HEAVY = Arm(30.0, 300.0, 30.0)
_WALL_MASS = 6.5  # module and arm, for the damping ratio of a wall [kg]
_ALONG_Y = 0.5 * math.pi
_BETWEEN = 0.25 * math.pi


class Case(NamedTuple):
    """One trial of the list. text; trial: with the settings to be filled in; figures: their names
    in the command `study`; ended: when what could shake has ended [s]."""

    text: str
    trial: PlanarTrial
    figures: str = "rms share"
    ended: float = math.inf


def _sine(amplitude: float, omega: float, tremor: float = 0.0) -> HandPath:
    return HandPath(0.0, 0.0, 0.0, 0.0, amplitude, omega, tremor)


def hand_to(way: float, seconds: float = 1.0, start: float = 0.0, begin: float = 0.0) -> HandPath:
    """Return a minimum-jerk path, from `start` by `way` [m] in so many seconds from `begin` on."""
    return HandPath(start, start + way, begin, seconds, 0.0, 0.0, 0.0)


def _case(
    text: str, path: HandPath, seconds: float, first: float = 0.0, figures: str = "rms share",
    stiffness: float = 100.0, ended: float = math.inf, **more: Any,
) -> Case:  # fmt: skip
    law = PlanarSettings(stiffness=stiffness)
    more = {"direction": _BETWEEN, **more}
    trial = PlanarTrial(law, path=path, duration=seconds, first=first, **more)
    return Case(text, trial, figures, ended)


CASES = {
    "slow_x": _case("0.10 m at 0.8 rad/s along x", _sine(0.10, 0.8), 7.9, direction=0.0),
    "slow_y": _case("0.10 m at 0.8 rad/s along y", _sine(0.10, 0.8), 7.9, direction=_ALONG_Y),
    "fast_x": _case("0.08 m at 3 rad/s along x", _sine(0.08, 3.0), 6.3, direction=0.0),
    "fast_y": _case("0.08 m at 3 rad/s along y", _sine(0.08, 3.0), 6.3, direction=_ALONG_Y),
    "fast_between": _case("0.08 m at 3 rad/s between x and y", _sine(0.08, 3.0), 6.3),
    "small": _case("0.02 m at 1.5 rad/s between x and y", _sine(0.02, 1.5), 8.4),
    "reach": _case("0.25 m in 0.6 s", hand_to(0.25, 0.6, -0.125, 0.2), 1.8),
    "quick_reach": _case("1 m/s, 10 m/s^2", hand_to(0.164, 0.308, -0.082, 0.2), 1.5),
    "tremor": _case("0.05 m at 0.8 rad/s with 8 mm of tremor", _sine(0.05, 0.8, 0.008), 7.9),
    "heavy": _case("an arm of 30 kg, 0.05 m at 0.8 rad/s", _sine(0.05, 0.8), 7.9, arm=_HEAVY),
    "heavy_holding": _case("an arm of 30 kg that holds still", hand_to(0.05), 6.0, 1.0,
                           "chatter shaking", arm=_HEAVY, ended=1.0),
    "holding": _case("a hand that holds still 0.05 m off", hand_to(0.05), 6.0, 3.0,
                     "rms chatter travel shaking", ended=1.0),
    "holding_stiff": _case("a hand on a spring of 2000 N/m", hand_to(0.01), 6.0, 2.0,
                           "chatter shaking", 2000.0, 1.0),
    "released": _case("a hand that holds, and lets go", hand_to(0.05), 9.0, 5.0, "chatter travel",
                      released_after=3.0, ended=3.0),
    "released_stiff": _case("a hand that lets go of 1000 N/m", hand_to(0.03), 8.0, 5.0,
                            "chatter travel", 1000.0, 2.0, released_after=2.0),
    **{
        f"{name}{end}": _case(f"{text}{more}", path, 5.0, first, figures,
                              ended=1.0, arm=wall(stiffness, ratio, _WALL_MASS))
        for name, (text, stiffness, ratio) in WALLS.items()
        for end, more, path, first, figures in (
            ("", "", hand_to(0.05), 1.0, "chatter shaking peak"),
            ("_moved", ", moved by 3 mm", _sine(0.003, 3.0), 0.0, "shaking peak"),
        )
    },
}  # fmt: skip


class Settings(NamedTuple):
    """With and without feedback, and in which trials."""

    kinds: Annotated[tuple[str, ...], Setting("force feedback", choices=KINDS)] = KINDS
    cases: Annotated[
        tuple[str, ...], Setting("trials by name", choices=tuple(CASES))
    ] = tuple(CASES)
    damping: Annotated[float, Setting("of the damper", "Ns/m", 0.0, 200.0)] = 10.0


def run(lab: Lab, settings: Settings) -> Result:
    """Measure every case with and without feedback.

    Raises NotPossible on a real robot, Cancelled.
    """
    trials = {
        (kind, case): trial_of(case, law_of(settings, kind))
        for kind in settings.kinds
        for case in settings.cases
    }
    named = {"_".join(key): trial for key, trial in trials.items()}
    parts = lab.record(NAME, named, reduced)
    found = {key: error_of(parts["_".join(key)]) for key in trials}
    quantities = [
        Quantity(f"rms_{kind}_{name}", error.rms, math.nan, "N",
                 f"rms error, feedback: {kind}, {CASES[name].text}")
        for (kind, name), error in found.items()
    ]  # fmt: skip
    if {(kind, "fast_x") for kind in KINDS} <= set(found):
        ratio = found["none", "fast_x"].rms / found["feedback", "fast_x"].rms
        text = "rms error in fast motion along x, without over with feedback"
        quantities.append(Quantity("gain_fast_x", ratio, math.nan, "", text))
    data = {"_".join(key): np.array(error) for key, error in found.items()}
    return Result(NAME, tuple(quantities), settings._asdict(), _NOTES, data)


_NOTES = (
    "Error: the patient's true force in the plane less K x + B v of the true handle, both axes "
    "together, over all samples. Data of each trial as in force_error; travel, swing and shaking "
    "are those of the worse axis.",
    "500 samples per second, 0.7 ms from a sample to its torque, filters and counts as in `manus`; "
    "buses and processes are left out.",
)


def law_of(settings: Settings, kind: str) -> PlanarSettings:
    """Return the planar law's numbers, with or without feedback (`KINDS`)."""
    law = PlanarSettings(damping=settings.damping, force_gain=STUDIED_GAIN)
    return law if kind == "feedback" else law._replace(force_gain=0.0)


def trial_of(case: str, law: PlanarSettings) -> PlanarTrial:
    """Return one of `CASES` with a law, whose spring is that of the case."""
    trial = CASES[case].trial
    return trial._replace(settings=law._replace(stiffness=trial.settings.stiffness))


def error_of(part: Part) -> ErrorOf:
    """Return the error of both axes together."""
    x, y = (ErrorOf(*map(float, part[axis])) for axis in ("x", "y"))
    together = {name: math.hypot(getattr(x, name), getattr(y, name)) for name in _ADDED}
    worse = {name: max(getattr(x, name), getattr(y, name)) for name in _WORSE}
    return ErrorOf(**together, **worse, share=x.share)


_ADDED = ("mean", "rms", "p99", "rapid")
_WORSE = ("swing", "travel", "shaking")


def reduced(trial: PlanarTrial, samples: Samples) -> Part:
    """Return `ErrorOf` of each axis as an array."""
    period = float(samples.time[1] - samples.time[0])
    law, (position, velocity, force) = trial.settings, samples.felt
    return {
        axis: np.array([*judged(
            period, position[:, column], velocity[:, column], force[:, column], samples.share,
            law.stiffness, law.damping, round(trial.first / period),
        )])
        for column, axis in enumerate(("x", "y"))
    }  # fmt: skip


def draw(result: Result) -> Drawn:
    """Draw the rms error of every trial with and without feedback as a map."""
    cases = list(result.settings["cases"])
    rows = {
        ("force feedback" if kind == "feedback" else "no force feedback"): [
            result.value(f"rms_{kind}_{case}") for case in cases
        ]
        for kind in result.settings["kinds"]
    }
    title = "Force beyond the impedance, in the plane, all samples"
    return {"planar error": error_map(rows, cases, title)}


EXPERIMENT = Experiment(
    NAME, "force error in the plane, with and without force feedback",
    Settings, run, draw, HUMAN_ARM,
)  # fmt: skip
