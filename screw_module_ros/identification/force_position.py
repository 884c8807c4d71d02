# SPDX-License-Identifier: Apache-2.0
"""Force against position for every controller mode and gain (thesis chapter 6).

The hand moves the handle slowly through the commanded spring. The offset is its force minus the
spring's. Figures 6-1, 6-2 (PD), 6-5 (negative damping), 6-8, 6-9 (friction model), 6-10 (force
feedback), 6-12, 6-13 (the thesis's simulation).

`compensation` shows what the identified model is worth (6.4.2): the hand moves through the spring
of 100 N/m as in figure 6-8, once with the thesis's printed model (friction of 5.2.5, 10 N of
gravity, dead zone of 0.025 Nm) and once with the model identified on this module; also without
feed-forward, and with additional force feedback (6.4.4). On the nominal simulated module the
printed model is the plant's own polynomial: what it is worth on a module that it was not made for
is seen on a perturbed one.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ..control import modes
from ..control.vertical_settings import VerticalSettings
from ..drawing import Trace, force_position
from ..offset import Spring, offsets, spring_force
from ..settings import Setting
from . import friction_model, gravity, static_torque
from .figures import COLOURS, DESIRED, axes_for
from .lab import Lab, Part
from .results import HUMAN_ARM, Drawn, Experiment, Published, Quantity, Result, beside
from .trials import Arm, MotionTrial, Samples

NAME = "force_position"
# Without compensation the offset is the friction of 5.2, which the plant has been given.
THESIS = {
    "offset_pd_100": Published("offset_pd", 3.0, given_to_plant=True),
    "offset_pd_1000": Published("offset_pd_stiff", 3.0, given_to_plant=True),
    "offset_feedback_5": Published("offset_feedback", 1.0),
    "offset_simulated_pd": Published("simulated_reduction", 3.0, given_to_plant=True, part=0),
    "offset_simulated_feedback_5": Published("simulated_reduction", 1.0, part=1),
}
_EVERY = 8  # samples to one point of a curve


class Curve(NamedTuple):
    """One curve: its name, the thesis's figure, the law's mode and gains, the hand.

    stiffness [N/m], damping [Ns/m], gain: Kf.
    """

    name: str
    figure: str
    mode: int
    stiffness: float = 100.0
    damping: float = 0.0
    gain: float = 0.0
    firm: bool = False
    simulated: bool = False


_CURVES = (
    Curve("pd_100", "6-1", modes.IMPEDANCE),
    Curve("pd_1000", "6-2", modes.IMPEDANCE, stiffness=1000.0, firm=True),
    Curve("damping_-25", "6-5", modes.IMPEDANCE, damping=-25.0),
    Curve("damping_-50", "6-5", modes.IMPEDANCE, damping=-50.0),
    Curve("friction_model", "6-8", modes.FRICTION_COMPENSATION),
    Curve("feedback_1", "", modes.FORCE_FEEDBACK, gain=1.0),
    Curve("feedback_2", "", modes.FORCE_FEEDBACK, gain=2.0),
    Curve("feedback_5", "6-10", modes.FORCE_FEEDBACK, gain=5.0),
    Curve("feedback_8", "", modes.FORCE_FEEDBACK, gain=8.0),
    Curve("combined_5", "6.4.4", modes.COMBINED, gain=5.0),
    Curve("simulated_pd", "6-12", modes.IMPEDANCE, simulated=True),
    Curve("simulated_feedback_5", "6-13", modes.FORCE_FEEDBACK, gain=5.0, simulated=True),
)
CURVES = {curve.name: curve for curve in _CURVES}
_TITLES = {
    "6-1": (("pd_100",), "Fig. 6-1: PD, 100 N/m"),
    "6-2": (("pd_1000",), "Fig. 6-2: PD, 1000 N/m; above, its downward limit acts"),
    "6-5": (("pd_100", "damping_-25", "damping_-50"), "Fig. 6-5: negative damping"),
    "6-8": (("pd_100", "friction_model"), "Fig. 6-8: PD, and the plant's own friction model"),
    "6-10": (("pd_100", "feedback_5"), "Fig. 6-10: PD, and with force feedback, gain 5"),
    "6-12": (("simulated_pd",), "Fig. 6-12: the thesis's simulation, PD"),
    "6-13": (("simulated_feedback_5",), "Fig. 6-13: the thesis's simulation, force feedback 5"),
    "gains": (
        ("feedback_1", "feedback_2", "feedback_5", "feedback_8", "combined_5"),
        "Force feedback gains, and the friction model with gain 5 (6.4.4)",
    ),
}
_LABELS = {
    "pd_100": "PD",
    "pd_1000": "PD",
    "damping_-25": "damping -25 Ns/m",
    "damping_-50": "damping -50 Ns/m",
    "friction_model": "the plant's own friction polynomial fed forward",
    "feedback_1": "gain 1",
    "feedback_2": "gain 2",
    "feedback_5": "gain 5",
    "feedback_8": "gain 8",
    "combined_5": "friction model and gain 5",
    "simulated_pd": "PD",
    "simulated_feedback_5": "force feedback, gain 5",
}
_COLUMNS = ("position", "velocity", "force")


class Settings(NamedTuple):
    """Motion of the hand, and selection of the curves."""

    centre: Annotated[float, Setting("centre of the spring", "m", 0.1, 0.25)] = 0.18
    amplitude: Annotated[float, Setting("of the virtual hand", "m", 0.02, 0.15)] = 0.14
    omega: Annotated[float, Setting("of the hand: slowly", "rad/s", 0.05, 3.0)] = 0.5
    cycles: Annotated[float, Setting("of the hand per curve", "", 1.0, 20.0)] = 2.0
    firm_stiffness: Annotated[
        float, Setting("of the hand against the spring of 1000 N/m", "N/m", 300.0, 5000.0)
    ] = 2000.0
    curves: Annotated[
        tuple[str, ...], Setting("names of the curves to measure", choices=tuple(CURVES))
    ] = tuple(CURVES)


def run(lab: Lab, settings: Settings) -> Result:
    """Measure the curves. Raises Cancelled, NotPossible."""
    chosen = [CURVES[name] for name in settings.curves]
    trials = {curve.name: trial_of(curve, settings) for curve in chosen}
    parts = lab.record(NAME, trials, reduced)
    labels = [f"{c.name}, fig {c.figure}" if c.figure else c.name for c in chosen]
    quantities = _offsets(parts, labels)
    notes = _SIMULATED if any(curve.simulated for curve in chosen) else ()
    return Result(NAME, beside(THESIS, quantities), settings._asdict(), notes, _drawn(parts))


_SIMULATED = (
    "Figures 6-12 and 6-13 use the thesis's arm and virtual trajectory, but this plant, which has "
    "backlash; the thesis's simulation had none.",
)


def _drawn(parts: dict[str, Part]) -> dict[str, np.ndarray]:
    """Return the curves of the trials, by `NAME/COLUMN`."""
    return {f"{name}/{column}": part[column] for name, part in parts.items() for column in _COLUMNS}


def _offsets(parts: dict[str, Part], labels: list[str]) -> list[Quantity]:
    return [
        Quantity(f"offset_{name}", float(part["offset"]), float(part["spread"]), "N",
                 f"mean offset from the spring in motion ({label})")
        for (name, part), label in zip(parts.items(), labels, strict=True)
    ]  # fmt: skip


def trial_of(curve: Curve, settings: Settings) -> MotionTrial:
    """Return the trial of one curve; the simulated ones move as the thesis's simulation (6.4.3)."""
    law = VerticalSettings(
        stiffness=curve.stiffness, damping=curve.damping, force_gain=curve.gain
    )
    omega = 0.8 if curve.simulated else settings.omega
    return MotionTrial(
        curve.mode,
        law,
        arm=Arm(stiffness=settings.firm_stiffness) if curve.firm else Arm(),
        centre=settings.centre,
        amplitude=0.15 if curve.simulated else settings.amplitude * (0.8 if curve.firm else 1.0),
        omega=omega,
        duration=settings.cycles * 2.0 * math.pi / omega,
    )


def reduced(trial: MotionTrial, samples: Samples) -> Part:
    """Return every eighth sample of the curve, and the offset from the spring over all samples.

    Samples at which the law's force limits act on spring and gravity (the bulge of fig 6-2) have no
    offset. Its standard error comes from its scatter over eight parts.
    """
    law, spring = trial.settings, Spring(trial.settings.stiffness, trial.centre)
    pull = law.gravity - spring_force(samples.position, spring)
    free = (pull > -law.force_down) & (pull < law.force_up)
    position, velocity, force = (
        values[free] for values in (samples.position, samples.velocity, samples.force)
    )
    beyond = np.abs(force - spring_force(position, spring))
    means = [part.mean() for part in np.array_split(beyond, 8)]
    return {
        "position": samples.position[::_EVERY],
        "velocity": samples.velocity[::_EVERY],
        "force": samples.force[::_EVERY],
        "offset": np.array(offsets(position, velocity, force, spring).mean),
        "spread": np.array(np.std(means) / math.sqrt(len(means))),
    }


def draw(result: Result) -> Drawn:
    """Return the figures of the measured curves by number."""
    found = {}
    for number, (names, title) in _TITLES.items():
        measured = [name for name in names if f"{name}/position" in result.data]
        if measured:
            spring = Spring(CURVES[measured[0]].stiffness, result.settings["centre"])
            traces = [_trace(result, name, _LABELS[name]) for name in measured]
            found[number] = force_position(traces, spring, title)
    if {"pd_100/position", "friction_model/position"} <= result.data.keys():
        found["6-9"] = _reversal(result)
    return found


def _reversal(result: Result) -> Figure:
    """Draw a close-up of the upper reversal, where feed-forward has no benefit (fig 6-9)."""
    figure, axes = axes_for("handle height z [m]", "force of the patient on the robot [N]",
                            "Fig. 6-9: closeup of the upper reversal")  # fmt: skip
    traces = [_trace(result, name, _LABELS[name]) for name in ("pd_100", "friction_model")]
    for trace, colour in zip(traces, COLOURS, strict=False):
        axes.plot(trace.position, trace.force, color=colour, label=trace.name)
    top = max(trace.position.max() for trace in traces)
    ends = np.array([top - 0.03, top + 0.002])
    axes.plot(
        ends, 100.0 * (ends - result.settings["centre"]), color=DESIRED, linestyle=":",
        linewidth=3.0, label="desired",
    )  # fmt: skip
    axes.set_xlim(*ends)
    axes.legend(loc="lower left")
    return figure


def _trace(result: Result, name: str, label: str) -> Trace:
    return Trace(label, *(result.data[f"{name}/{column}"] for column in _COLUMNS))


EXPERIMENT = Experiment(
    NAME, "force against position for every controller mode and gain (thesis chapter 6)", Settings,
    run, draw, HUMAN_ARM,
)  # fmt: skip


# What the identified model is worth ---------------------------------------------------------

_MODES = {
    "pd": modes.IMPEDANCE,
    "feed_forward": modes.FRICTION_COMPENSATION,
    "combined": modes.COMBINED,
}
_STIFFNESS = 100.0  # [N/m] thesis: usual_spring


class CompensationSettings(NamedTuple):
    """Motion of the hand, and gains."""

    amplitude: Annotated[float, Setting("of the virtual hand", "m", 0.02, 0.15)] = 0.15
    omega: Annotated[float, Setting("of the hand", "rad/s", 0.05, 3.0)] = 0.8
    cycles: Annotated[float, Setting("of the hand", "", 1.0, 20.0)] = 3.0
    fraction: Annotated[
        float, Setting("share of the modelled friction that is fed forward", "", 0.0, 1.0)
    ] = 0.9
    force_gain: Annotated[float, Setting("of the combined law", "", 0.0, 10.0)] = 5.0


def compensate(lab: Lab, settings: CompensationSettings) -> Result:
    """Measure with both models. Raises MissingResult without the module's results, Cancelled."""
    identified: dict[str, Any] = {
        "friction": friction_model.friction_model_of(lab.result(friction_model.NAME)),
        "linearization": static_torque.measured_linearization(lab),
    }
    own_gravity = lab.result(gravity.NAME).value("gravity")
    trials: dict[str, MotionTrial] = {}
    both = {"default": (10.0, {}), "identified": (own_gravity, identified)}
    for model, (weight, options) in both.items():
        law = VerticalSettings(
            stiffness=_STIFFNESS, gravity=weight, friction_fraction=settings.fraction,
            force_gain=settings.force_gain,
        )  # fmt: skip
        still = MotionTrial(
            modes.OFF, law, amplitude=settings.amplitude, omega=settings.omega,
            duration=settings.cycles * 2.0 * math.pi / settings.omega, **options,
        )  # fmt: skip
        trials |= {f"{name}_{model}": still._replace(mode=mode) for name, mode in _MODES.items()}
    parts = lab.record("compensation", trials, reduced)
    quantities = _offsets(parts, [f"{name.replace('_', ', ')} model" for name in parts])
    before, after = (q for q in quantities if q.name.startswith("offset_feed_forward"))
    ratio = after.value / before.value
    error = np.hypot(before.uncertainty / before.value, after.uncertainty / after.value)
    text = "offset with the identified model over that with the thesis's default"
    quantities.append(Quantity("ratio", ratio, ratio * float(error), "", text))
    return Result("compensation", tuple(quantities), settings._asdict(), (), _drawn(parts))


def draw_compensation(result: Result) -> Drawn:
    """Draw feed-forward with the thesis's model and with the identified one."""
    names = {
        "pd_default": "PD",
        "feed_forward_default": "thesis's model fed forward",
        "feed_forward_identified": "identified model fed forward",
    }
    traces = [_trace(result, name, label) for name, label in names.items()]
    spring = Spring(_STIFFNESS, 0.18)
    return {"compensation": force_position(traces, spring, "Benefit of the identified model")}


COMPENSATION = Experiment(
    "compensation",
    "benefit of the identified model: feed-forward with it and with the thesis's (6.4.2)",
    CompensationSettings, compensate, draw_compensation, HUMAN_ARM,
    ("static_torque", "gravity", "friction_model"),
)  # fmt: skip
