# SPDX-License-Identifier: Apache-2.0
"""Predicted largest stable force gain, its limiting factor, and the onset in simulation.

7.1 of the thesis asks for tools of this kind; this one is ours.

The linear sampled loop (`sampled_loop`) predicts the force feedback that mass, contact, support,
delay, rate, filters and the hand allow, with the law that the robot executes. The effect of each
limiting factor is the gain without it. On a simulated module without play the experiment also
raises the gain until the handle chatters, for comparison with the prediction.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np

from ..calibration.gain_limits import Loop, conditions_of
from ..calibration.version import law_version
from ..control import modes
from ..control.law import Law
from ..control.laws import LAWS, margin_of, modes_of_gains, settings_of
from ..control.laws.thesis import THESIS as THESIS_LAW
from ..control.vertical_settings import VerticalSettings
from ..settings import Setting, validated
from . import gravity, inertia, torque_response
from .figures import COLOURS, DESIRED, panels
from .force_gain import onset, reduced, rows_of
from .lab import Lab, MissingResult
from .results import DERIVED, HUMAN_ARM, Drawn, Experiment, Quantity, Result
from .sampled_loop import MOST, LawInMode, Mechanism, Sampling, largest_gain
from .trials import HEAVY, TRUTH, Arm, MotionTrial

NAME = "stability"
ENVIRONMENTS = {
    "hand": ("a hand of 3 kg, 300 N/m, 5 Ns/m", Arm()),
    "heavy_arm": ("an arm of 30 kg, 300 N/m, 30 Ns/m", HEAVY),
    "wall": ("a wall of 1e5 N/m, half of critical damping", Arm(0.0, 1e5, 740.0)),
    "light_wall": ("1 kg against a wall of 1e5 N/m, 30 Ns/m", Arm(1.0, 1e5, 30.0)),
    "soft_grip": ("0.45 kg of a hand with a grip of 1e4 N/m, 30 Ns/m", Arm(0.45, 1e4, 30.0)),
}
PLAIN = "observer_plain"
"""Curve of the observer without the mass that it carries. The controller lets it carry less the
lighter the hand is; the linear loop of the observer carries all of it, this one none."""
SIMULATED, IDENTIFIED, NOMINAL = "of the simulated module", "identified", "of the settings"
_RAISED = (0.3, 0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0, 3.0)  # multiples of the predicted gain
_MOST = 50.0  # what the law allows
_GRAVITY = 9.81  # [m/s^2]
RIGID = 1e12
"""A support of this stiffness [N/m] changes no gain."""
_LEAST_NUT, _LEAST_HANDLE = 0.1, 0.05  # [kg]
_SHOWN = 1.0  # least gain of the figure
_CHATTER = 0.2  # [N] rms above 30 Hz, as in force_gain
_WIDTH, _WIDEST = 1.1, 4.0  # the widest line lies under another one, where they are equal
_LABELS = {"feedback": "force feedback", PLAIN: "observer, carrying no mass"}
_SIMULATED = "feedback"  # the gain whose onset is also simulated


class Settings(NamedTuple):
    """The loop and the mechanism; a simulated module overrides them, identified masses the two."""

    rate: Annotated[float, Setting("samples per second", "Hz", 50.0, 10_000.0)] = 1000.0
    delay: Annotated[
        float, Setting("from a sample to the current's answer", "s", 0.0, 0.02)
    ] = 1.26e-3
    nut_mass: Annotated[float, Setting("turning with the screw", "kg", _LEAST_NUT, 50.0)] = 4.4666
    handle_mass: Annotated[float, Setting("beyond the play", "kg", _LEAST_HANDLE, 50.0)] = 1.0234
    contact_stiffness: Annotated[float, Setting("nut to handle", "N/m", 1e4, 1e9)] = 20e6
    contact_damping: Annotated[float, Setting("nut to handle", "Ns/m", 0.0, 1e5)] = 3000.0
    film_damping: Annotated[float, Setting("nut to handle", "Ns/m", 0.0, 1e4)] = 700.0
    support_stiffness: Annotated[
        float, Setting("axial, of the screw; assumed, measure it", "N/m", 1e5, RIGID)
    ] = 1e7
    support_damping_ratio: Annotated[
        float, Setting("of the screw on its axial support; assumed", "", 0.0, 2.0)
    ] = 0.05
    screw_mass: Annotated[float, Setting("moving on the axial support", "kg", 0.01, 50.0)] = 0.6
    cutoff: Annotated[float, Setting("of the force filter", "Hz", 1.0, 400.0)] = 30.0
    velocity_cutoff: Annotated[float, Setting("of the velocity filter", "Hz", 0.1, 1000.0)] = 30.0
    simulated: Annotated[bool, Setting("also find the onset in simulation")] = True


def run(lab: Lab, settings: Settings) -> Result:
    """Predict the gains; simulate on a simulated module. Raises ValueError, Cancelled."""
    mechanism, sampling, velocity_cutoff = _of(lab, settings)
    usual = law_of(lab)._replace(force_cutoff=settings.cutoff)
    looped = judged(usual, velocity_cutoff, lab.stand.laws, lab.stand.law_settings)
    quantities: list[Quantity] = []
    data: dict[str, Any] = {}
    support = mechanism.support_stiffness
    notes = [f"The screw's axial support, assumed and not measured: {support:g} N/m. {_NOTE}"]
    for name, (text, environment) in ENVIRONMENTS.items():
        given = (mechanism, environment, sampling)
        for law_name, law in looped.items():
            gain, where = largest_gain(*given, law), f"{law_name}, {text}"
            half = 0.005 * gain if 0.0 < gain < math.inf else math.nan  # of the last interval
            what = f"largest stable gain predicted, {where}"
            if gain <= 0.0:
                notes.append(f"{where}: no gain is stable.")
            elif math.isfinite(gain):
                costs = limits(*given, law)
                data[f"limits_{law_name}_{name}"] = np.array(list(costs.values()))
                listed = ", ".join(f"{cost} x{factor:.2g}" for cost, factor in costs.items())
                notes.append(f"{where}: limited by {max(costs, key=costs.__getitem__)}; {listed}.")
            else:
                what += f"; none up to {MOST:g} is unstable"
                notes.append(f"{where}: no gain up to {MOST:g} is unstable.")
            quantities.append(Quantity(f"{law_name}_{name}", gain, half, "", what, DERIVED))
        found = {quantity.name: quantity.value for quantity in quantities}
        predicted = min(found[f"{_SIMULATED}_{name}"], _MOST)
        by_hand = hand_formula(*given, settings.cutoff)
        if not math.isnan(by_hand):  # it applies
            what = f"largest stable gain by the hand formula, feedback, {text}"
            quantities.append(Quantity(f"formula_{name}", by_hand, math.nan, "", what, DERIVED))
        if settings.simulated and TRUTH in lab.stand.offers and environment.mass > 0.0:
            quantities.append(_onset(lab, name, text, environment, predicted, settings.cutoff))
    carrying = looped["observer"]
    plain = carrying._replace(settings=carrying.settings._replace(observer_inertia=0.0))
    data |= _curves(mechanism, sampling, looped | {PLAIN: plain})
    loop = Loop(*sampling, velocity_cutoff)
    conditions = {
        law.name: conditions_of(law, usual, _own(lab, law, usual), loop)
        for law in lab.stand.laws if law.judged
    }  # fmt: skip
    # A simulated module has its own loop.
    in_force = settings._asdict() | conditions[THESIS_LAW.name]
    in_force |= {name: getattr(mechanism, name) for name in in_force if hasattr(mechanism, name)}
    identified = NOMINAL if _identified(lab) is None else IDENTIFIED
    masses = SIMULATED if TRUTH in lab.stand.offers else identified
    in_force |= {"laws": {law.name: law_version(law) for law in lab.stand.laws}, "masses": masses}
    in_force |= {"conditions": conditions}
    return Result(NAME, tuple(quantities), in_force, tuple(notes), data)


_NOTE = (
    "The law is that of this version, by differences of its step. Factor of each limit: largest "
    "gain without this limit over the largest gain with it. The linear loop has neither friction, "
    "which stabilises, nor play, which destabilises. The hand formula models the environment as a "
    "mass and does not apply to walls. The figure's observer carries all of its mass; the "
    "controller carries less for a light hand, so its limit lies between that curve and the one "
    "without a carried mass."
)


def judged(
    usual: VerticalSettings,
    velocity_cutoff: float,
    laws: Iterable[Law] = LAWS,
    own: Mapping[str, Any] = {},
) -> dict[str, LawInMode]:
    """Return the gains that the linear model judges: each law in the first mode with the gain.

    By the name of the gain in results. own: settings of laws of others, by the laws' names.
    """
    return {
        margin_of(law, gain).name: LawInMode(
            mode, usual, velocity_cutoff, law, own.get(law.name), gain
        )
        for law in laws if law.judged
        for gain, mode in modes_of_gains(law).items()
    }  # fmt: skip


def _own(lab: Lab, law: Law, usual: VerticalSettings) -> Any:
    """Return the settings of a law on the lab's stand."""
    return settings_of(law, usual, lab.stand.law_settings.get(law.name))


def limits(
    mechanism: Mechanism, environment: Arm, sampling: Sampling, law: LawInMode
) -> dict[str, float]:
    """Return the largest gain without each limit over the largest gain with it, by name.

    Raises ValueError if no gain is stable.
    """
    now = largest_gain(mechanism, environment, sampling, law)
    if now <= 0.0:
        raise ValueError("no gain is stable: its limits cannot be determined")
    firm = mechanism._replace(contact_stiffness=30.0 * mechanism.contact_stiffness,
                              contact_damping=5.0 * mechanism.contact_damping)  # fmt: skip
    quick = mechanism._replace(amplifier=2e4, transducer=2e4)
    # The delay stays constant when the period changes.
    without = {
        "the delay": (mechanism, environment, sampling._replace(delay=1e-6)),
        "the sampling rate": (mechanism, environment, sampling._replace(rate=4.0 * sampling.rate)),
        "the contact": (firm, environment, sampling),
        "the support": (mechanism._replace(support_stiffness=RIGID), environment, sampling),
        "amplifier and transducer": (quick, environment, sampling),
        "the environment's mass": (mechanism, environment._replace(mass=0.0), sampling),
        "the environment's stiffness": (mechanism, environment._replace(stiffness=0.0), sampling),
    }
    return {name: min(largest_gain(*loop, law, 1000.0), 1000.0) / now
            for name, loop in without.items()}  # fmt: skip


def hand_formula(
    mechanism: Mechanism, environment: Arm, sampling: Sampling, cutoff: float
) -> float:
    """Return the largest gain by the hand formula, from the phase of 180 degrees at wp.

    Kf = (M + me) / me sqrt(1 + (wp / wf)^2) (1 - (wp / wr)^2) with atan(wp / wf) + wp tau = pi; tau
    is the delay, plus the amplifier's lag, plus half a period; wr is the resonance of contact and
    axial support in series. NaN if it is below wp, if the environment has no mass, or if its
    spring, delayed by filter and delay, exceeds its damper: then the loop oscillates on that spring
    at a much smaller gain.
    """
    if environment.mass <= 0.0:
        return math.nan
    corner = 2.0 * math.pi * cutoff
    tau = sampling.delay + 0.5 / sampling.rate + 0.5 / (math.pi * mechanism.amplifier)
    if environment.stiffness * (1.0 / corner + tau) > environment.damping:
        return math.nan
    low, high = 0.0, math.pi / tau
    for _ in range(60):
        middle = 0.5 * (low + high)
        past = math.atan(middle / corner) + middle * tau > math.pi
        low, high = (low, middle) if past else (middle, high)
    outer = mechanism.handle_mass + environment.mass
    bending = 1.0 / mechanism.contact_stiffness + 1.0 / mechanism.support_stiffness
    resonance = math.sqrt((1.0 / mechanism.nut_mass + 1.0 / outer) / bending)
    if low >= resonance:
        return math.nan
    mass = mechanism.nut_mass + outer
    gain = mass / environment.mass * math.sqrt(1.0 + (low / corner) ** 2)
    return gain * (1.0 - (low / resonance) ** 2)


def _of(lab: Lab, settings: Settings) -> tuple[Mechanism, Sampling, float]:
    """Return mechanism, sampling and cut-off of the velocity filter [Hz].

    A simulated module has its own. Raises ValueError for identified masses out of range.
    """
    if TRUTH not in lab.stand.offers:
        settings = _weighed(lab, settings)
        sampling = Sampling(settings.rate, settings.delay)
        return Mechanism(**_shared(settings)), sampling, settings.velocity_cutoff
    module: Any = lab.stand  # a simulated one, which offers TRUTH
    world, loop = module.world, module.loop
    mechanism = Mechanism(
        world.vertical.turning_mass, world.vertical.moving_mass,
        amplifier=world.amplifier.bandwidth, transducer=world.sensor.bandwidth,
        **_shared(world.vertical),
    )  # fmt: skip
    delay = loop.command_delay + world.amplifier.delay
    return mechanism, Sampling(loop.rate, delay), loop.cutoff


def _shared(record: tuple) -> dict[str, float]:
    """Return what a record has of the mechanism's fields, under the same names."""
    return {name: getattr(record, name) for name in Mechanism._fields if hasattr(record, name)}


def _identified(lab: Lab) -> tuple[float, float] | None:
    """Return weight [N] and mass [kg] of the lab's module, None unless both were identified."""
    try:
        weight = lab.result(gravity.NAME).value("gravity")
        return weight, lab.result(inertia.NAME).value("mass")
    except MissingResult:
        return None


def _weighed(lab: Lab, settings: Settings) -> Settings:
    """Return the settings with the lab's masses: only the handle's side has a weight.

    A counterbalanced handle has none: then it counts with the least mass that the settings permit.
    """
    if (found := _identified(lab)) is None:
        return settings
    weight, mass = found
    handle = max(_LEAST_HANDLE, weight / _GRAVITY)
    nut = max(_LEAST_NUT, mass - handle)
    return validated(settings._replace(nut_mass=nut, handle_mass=handle))


def law_of(lab: Lab) -> VerticalSettings:
    """Return the law as a controller has it with the lab's calibration, else with the defaults."""
    found = _identified(lab)
    if not found:
        return VerticalSettings()
    try:
        delay = lab.result(torque_response.NAME).value("loop_delay")
    except (MissingResult, KeyError):  # of an earlier version
        delay = 0.0
    return VerticalSettings().calibrated(*found, delay)


def _onset(
    lab: Lab, name: str, text: str, environment: Arm, predicted: float, cutoff: float
) -> Quantity:
    """Return the gain at which the simulated module without play chatters, if one does."""
    trials = {
        f"{name}_{gain:.3g}": MotionTrial(
            modes.FORCE_FEEDBACK,
            VerticalSettings(force_gain=gain, force_cutoff=cutoff, chatter_limit=_MOST),
            arm=environment, amplitude=0.05, duration=8.0, preloaded=True,
        )
        for gain in (share * predicted for share in _RAISED) if gain <= _MOST
    }  # fmt: skip
    low, high = onset(rows_of(lab.record(NAME, trials, reduced), trials), _CHATTER)
    if math.isinf(high):
        what = f"largest gain tried on the simulated module; it did not chatter, {text}"
        return Quantity(f"simulated_{name}", low, math.nan, "", what)
    what = f"gain at which the simulated module without play chatters, {text}"
    return Quantity(f"simulated_{name}", 0.5 * (low + high), 0.5 * (high - low), "", what)


def _curves(
    mechanism: Mechanism, sampling: Sampling, laws: dict[str, LawInMode]
) -> dict[str, np.ndarray]:
    """Return the largest gain over the delay and over the environment's mass, for a figure.

    0 where no gain is stable.
    """
    delays, masses, hand = np.linspace(0.1e-3, 4e-3, 14), np.geomspace(0.3, 50.0, 14), Arm()
    found = {"delays": delays, "masses": masses}
    for name, law in laws.items():
        found[f"delay_{name}"] = np.array(
            [largest_gain(mechanism, hand, sampling._replace(delay=d), law) for d in delays]
        )
        found[f"mass_{name}"] = np.array(
            [largest_gain(mechanism, hand._replace(mass=m), sampling, law) for m in masses]
        )
    return found


def curves_of(result: Result) -> list[str]:
    """Return the names of the figure's curves."""
    return [name.removeprefix("mass_") for name in result.data if name.startswith("mass_")]


def draw(result: Result) -> Drawn:
    """Draw the largest stable gain over the delay and over the mass of the arm at the handle."""
    data = result.data
    figure, (left, right) = panels(1, 2, (8.6, 4.6), sharey=True)
    for number, name in enumerate(curves_of(result)):
        colour = COLOURS[number % len(COLOURS)]
        style = {"color": colour, "label": _LABELS.get(name, name.replace("_", " ")),
                 "marker": "o", "markersize": 2.5, "zorder": 2.5 - 0.1 * number,
                 "linewidth": _WIDEST if name == PLAIN else _WIDTH}  # fmt: skip
        for axes, x, gains in (
            (left, 1e3 * data["delays"], data[f"delay_{name}"]),
            (right, data["masses"], data[f"mass_{name}"]),
        ):
            axes.plot(x, np.where(gains >= _SHOWN, gains, np.nan), **style)
            if (low := gains < _SHOWN).any():
                axes.plot(x[low], np.full(low.sum(), 1.1 * _SHOWN), "v", color=colour,
                          markerfacecolor="none", markersize=5)  # fmt: skip
    for axes in (left, right):
        axes.axhline(5.0, color=DESIRED, linewidth=0.8, linestyle="--")
        axes.set_yscale("log")
    left.set(title="A hand of 3 kg", xlabel="delay from sample to current [ms]",
             ylabel="largest stable force gain", ylim=(0.9 * _SHOWN, None))  # fmt: skip
    right.set(title="The loop's own delay", xlabel="mass of the arm at the handle [kg]",
              xscale="log")  # fmt: skip
    if any((gains < _SHOWN).any() for key, gains in data.items() if key.startswith("mass_")):
        said = right.text(
            0.98, 0.97, "triangles: less than 1, or none.\nThe force that carries the mass\n"
            "lags by its filter and swings a\nlight arm; the controller\ncarries less for one.",
            transform=right.transAxes, fontsize=8, ha="right", va="top",
        )  # fmt: skip
        said.set_in_layout(False)
    figure.suptitle(
        "Largest force gain of the linear loop; dashed: the thesis's 5", x=0.01, ha="left"
    )
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return {"stability": figure}


EXPERIMENT = Experiment(
    NAME, "predicted largest stable force gain, its limiting factor, and the onset in simulation",
    Settings, run, draw, HUMAN_ARM,
)  # fmt: skip
