# SPDX-License-Identifier: Apache-2.0
"""The impedance that a hand gets, over frequency, and the range of impedances that is stable.

What a control engineer asks of a haptic robot, on rigs drawn by seed with their play, delay and
friction, and with the guard as it is shipped: `study --impedance`.

- A firm hand moves the handle in sines. Its force over the handle's velocity is the impedance
  delivered, Z; asked for is B + K / (j w).
- Z-width (colgatebrown1994): for two dampers B and three loads the stiffest spring up to which all
  springs of a ladder are held, and let go, without an oscillation that lasts. *Kept*: and the guard
  leaves more than half of the gain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..control.planar_settings import PlanarSettings
from ..control.vertical_settings import VerticalSettings
from ..plant.patient import RIGID, HandPath, resting
from .carrying import CENTRE
from .figures import COLOURS, DESIRED, panels
from .force_error import wall
from .force_metric import apparent_mass, first_harmonic, lasting, sine
from .rigs import Kind, Rig, drawn, drawn_plane
from .stand import SimulatedStand
from .trials import FIRM, HEAVY, Arm, HandTrial, MotionTrial, PlanarTrial, Samples

FREQUENCIES = (0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)  # [Hz]
DAMPERS = (0.0, 100.0)  # [Ns/m]; a law has at least what it needs
LOADS: dict[str, Arm | None] = {
    "hand": None, "arm of 30 kg": HEAVY, "wall": wall(1e5, 0.1),
}  # fmt: skip
"""What holds the handle: the rig's hand, a heavy arm, a wall of 1e5 N/m."""
SPRINGS = (30.0, 100.0, 300.0, 1000.0, 2000.0, 5000.0)  # [N/m] the ladder
SPRING = 100.0  # [N/m] of the sines
CALM, STILL, KEPT = 0.5, 1e-3, 0.5
"""Most of an oscillation [N rms], of a released handle's way in a second that does not become less
[m], least share."""
_SPEED, _ACCELERATION = 0.3, 10.0  # of a sine [m/s], [m/s^2]
_PUSH, _FAR = 15.0, 0.02  # how hard [N] and far [m] a spring is pressed
_LESS = 0.9
_LET_GO, _END, _SECOND = 2.5, 5.0, 1.0  # [s] of a trial of a spring
_SINES = {f"{hertz:g} Hz": hertz for hertz in FREQUENCIES}
_HELD = {
    f"{load}, damper {damper:g} Ns/m": (load, damper) for load in LOADS for damper in DAMPERS
}
CASES: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(_SINES, ("apart", "resistance", "mass")),
    **dict.fromkeys(_HELD, ("stiffest", "kept")),
}
"""Figures of each case."""
Did = tuple[Samples, float, float]
"""Samples along one direction, spring [N/m] and damper [Ns/m] asked for."""


def measured(
    family: str, seed: int, kind: Kind, name: str, laws: tuple[str, ...] = ()
) -> dict[str, float]:
    """Return the figures of one case of the vertical axis on one rig; laws: of other packages."""
    rig = drawn(family, seed)
    stand = SimulatedStand(rig.world, rig.loop, seed, laws)

    def does(
        spring: float, damper: float, arm: Arm, path: HandPath, seconds: float, released: float
    ) -> Did:
        asked = VerticalSettings(stiffness=spring, damping=damper)
        law = rig.law(kind, asked)
        at = path._replace(start=CENTRE + path.start, target=CENTRE + path.target)
        motion = MotionTrial(
            kind.mode, law, arm=arm, centre=CENTRE, duration=seconds, released_after=released
        )
        grip = rig.grip if arm.mass else RIGID
        found = stand.record(HandTrial(motion, resting(CENTRE), at, grip), lambda share: None)
        return found, law.stiffness, law.damping

    return _found(rig, name, does, CENTRE)


def measured_plane(family: str, seed: int, kind: Kind, name: str) -> dict[str, float]:
    """Return the figures of one case of the plane on one rig, along the rig's direction."""
    rig = drawn_plane(family, seed)
    along = np.array([math.cos(rig.direction), math.sin(rig.direction)])

    def does(
        spring: float, damper: float, arm: Arm, path: HandPath, seconds: float, released: float
    ) -> Did:
        most = min(spring, 2000.0)
        law = rig.plane_law(kind, PlanarSettings(stiffness=most, damping=damper))
        trial = PlanarTrial(
            law, arm=arm, direction=rig.direction, path=path, duration=seconds,
            released_after=released, centre=rig.centre, loop=rig.loop,
            grip=rig.grip if arm.mass else RIGID,
        )  # fmt: skip
        found = SimulatedStand(rig.world, seed=seed).record(trial, lambda share: None)
        one = {
            field: getattr(found, field) @ along
            for field in ("position", "velocity", "force", "handle", "handle_velocity",
                          "true_force")
        }  # fmt: skip
        return found._replace(**one), most, damper

    return _found(rig, name, does, 0.0)


def _found(rig: Rig, name: str, does: Callable[..., Did], centre: float) -> dict[str, float]:
    if name in _SINES:
        return _delivered(_SINES[name], does)
    load, damper = _HELD[name]
    return _width(damper, LOADS[load] or rig.hand, does, centre)


def _delivered(hertz: float, does: Callable[..., Did]) -> dict[str, float]:
    """Return how far the impedance at a frequency is from what was asked for, and its parts."""
    amplitude, omega, seconds = sine(hertz, _SPEED, _ACCELERATION)
    path = HandPath(0.0, 0.0, 0.0, 0.0, amplitude, omega, 0.0)
    samples, spring, damper = does(SPRING, 0.0, FIRM, path, seconds, math.inf)
    position, _, force = samples.felt
    z = first_harmonic(samples.time, position, force, omega)
    mass = float(apparent_mass(np.array(z.imag), np.array(hertz), spring))
    return {
        "apart": abs(z - complex(damper, -spring / omega)), "resistance": z.real, "mass": mass,
    }  # fmt: skip


def _width(damper: float, arm: Arm, does: Callable[..., Did], centre: float) -> dict[str, float]:
    """Return the stiffest spring of the ladder up to which all are stable, and with the gain."""
    stiffest = kept = 0.0
    share = 1.0
    for spring in SPRINGS:
        way = min(_FAR, _PUSH / spring)
        path = HandPath(0.0, way, 0.0, 0.3, 0.0, 0.0, 0.0)
        samples, asked, used = does(spring, damper, arm, path, _END, _LET_GO)
        share = min(share, _rests(samples, asked, used, centre))
        if asked < spring or share < 0.0:
            break
        stiffest = spring
        kept = spring if share > KEPT else kept
    return {"stiffest": stiffest, "kept": kept}


def _rests(samples: Samples, spring: float, damper: float, centre: float) -> float:
    """Return the least share of the gain, -1 if hand or released handle do not come to rest."""
    period = float(samples.time[1] - samples.time[0])
    position, velocity, force = samples.felt
    error = force - spring * (position - centre) - damper * velocity
    held, last = round(_LET_GO / period), round(_SECOND / period)
    calm = all(
        lasting(period, part, len(part) - last) < CALM for part in (error[:held], error[held:])
    )
    before, after = np.ptp(position[-2 * last : -last]), np.ptp(position[-last:])
    if not calm or after > max(STILL, _LESS * before):
        return -1.0
    return float(samples.share[held - last : held].min())


def draw(found: dict[str, Any], kind: Kind, families: dict[str, str]) -> Figure:
    """Draw the impedance of a kind over frequency and its Z-width; found: of the study."""
    figure, (left, right) = panels(1, 2, (9.4, 4.8))
    omega = 2.0 * np.pi * np.array(FREQUENCIES)
    left.plot(FREQUENCIES, SPRING / omega, "--", color=DESIRED, label="asked for: the spring")
    for number, (family, text) in enumerate(families.items()):
        colour, at = COLOURS[number], np.arange(len(_HELD)) + 0.16 * (number - 0.5)
        of = found[family]
        resistance, mass = (_values(of, _SINES, part, kind) for part in ("resistance", "mass"))
        sizes = np.hypot(resistance, omega[:, None] * mass - (SPRING / omega)[:, None])
        left.plot(FREQUENCIES, np.nanmedian(sizes, axis=1), "o-", color=colour, ms=3, label=text)
        left.fill_between(FREQUENCIES, np.nanmin(sizes, axis=1), np.nanmax(sizes, axis=1),
                          color=colour, alpha=0.15, linewidth=0.0)  # fmt: skip
        springs, kept = (
            np.maximum(_values(of, _HELD, part, kind), 10.0) for part in ("stiffest", "kept")
        )
        for y, mark, fill, said in (
            (np.median(springs, axis=1), "o", colour, "stable, median"),
            (springs.min(axis=1), "v", "none", "stable, worst rig"),
            (np.median(kept, axis=1), "x", colour, "gain kept, median"),
        ):
            right.plot(at, y, mark, color=colour, mfc=fill, ms=6, label=f"{text}: {said}")
    left.set(xscale="log", yscale="log", xlabel="frequency [Hz]", title="|Z| at the handle [Ns/m]")
    left.set_xticks(FREQUENCIES, [f"{hertz:g}" for hertz in FREQUENCIES])
    left.minorticks_off()
    right.set(yscale="log", xlabel="load, and damper asked for [Ns/m]", ylim=(8.0, 7e3),
              title="Stiffest stable spring [N/m]; lowest: none")  # fmt: skip
    right.set_xticks(range(len(_HELD)), [
        f"{load}\n{damper:g}".replace(" of ", "\nof ") for load, damper in _HELD.values()
    ])  # fmt: skip
    left.legend()
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.suptitle(
        f"{kind.name}: median and range of the rigs",
        x=0.01, ha="left", fontsize=10,
    )  # fmt: skip
    return figure


def _values(of: dict[str, Any], names: Iterable[str], figure: str, kind: Kind) -> np.ndarray:
    """Return a figure of each case on each rig."""
    return np.array([of[name][figure][kind.name] for name in names])
