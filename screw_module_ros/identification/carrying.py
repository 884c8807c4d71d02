# SPDX-License-Identifier: Apache-2.0
"""Trials of the support: an arm that hangs on the handle, moves, lets go, or loses the torque.

They are the acceptance of `control.support`, in every mode that feeds the force back. The command
`study --support` carries them out on rigs drawn by seed, and on the thesis's module. A limp arm has
a tenth of 300 N/m towards where it was (`plant.patient`), and the robot a spring of 100 N/m. A hand
that moves or holds has 800 N/m and 80 Ns/m, and no spring of the robot. Nothing is calibrated.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..control import modes
from ..control.vertical_settings import VerticalSettings
from ..plant.patient import ArmForce, HandPath, resting
from .force_error import with_damping
from .trials import Arm, CarryTrial, MotionTrial, Part, Samples

CENTRE = 0.18
"""Where the arm is carried, and the spring's set point [m]."""
_HIGH = 0.25  # height from which it falls [m]
_LIMP, _ABLE = Arm(3.0, 30.0, 10.0), Arm(3.0, 800.0, 80.0)
_SPRING, _NONE = VerticalSettings(stiffness=100.0), VerticalSettings(stiffness=0.0)
_DAMPED = _NONE._replace(damping=6.0)
_AGAIN_S, _REACHES = 2.0, 6  # time from reach to reach, their number
_MEAN_S, _FALL_S = 1.0, 0.5
_KEPT = 0.95  # share of the support that is no loss


class Case(NamedTuple):
    """One trial, in a mode and with a grip that are given later.

    figures: their names, of `study.FIGURES`, with first: from when they count [s].
    """

    figures: tuple[str, ...]
    trial: CarryTrial
    first: float = 0.0

    def made(self, mode: int, grip: ArmForce) -> CarryTrial:
        """Return the trial in a mode, with the grip of a hand."""
        motion = self.trial.motion
        law = with_damping(motion.settings, mode)
        return self.trial._replace(motion=motion._replace(mode=mode, settings=law), grip=grip)

    def judged(self, samples: Samples) -> dict[str, float]:
        """Return the figures of its samples."""
        period = float(samples.time[1] - samples.time[0])
        first, last = round(self.first / period), round(_MEAN_S / period)
        (handle, velocity, force), wish = samples.felt, self.trial.parts[-1].support
        z, rest = handle[first:], handle[-last:].mean() - self.trial.motion.centre
        found = {
            "sunk": -1e3 * rest,
            "off": 1e3 * abs(rest),
            "rest": abs(force[-last:].mean() + wish),
            "error": float(np.sqrt(np.mean((force[first:] + wish) ** 2))),
            "flown": 1e3 * float((np.sign(wish) * (z - z[0])).max()),
            "flying": float(np.abs(velocity[first:]).max()),
            "lost": period * int((np.abs(samples.support[first:]) < _KEPT * abs(wish)).sum()),
            "fallen": 1e3 * float(z[0] - z[min(round(_FALL_S / period), len(z) - 1)]),
        }
        return {name: float(found[name]) for name in self.figures}


def _trial(
    law: VerticalSettings, arm: Arm, weight: float, *parts: Part, centre: float = CENTRE
) -> CarryTrial:
    """Return the trial of an arm of a weight [N] about a centre [m]."""
    return CarryTrial(MotionTrial(modes.OFF, law, arm=arm, centre=centre), weight, parts)


def _hanging(weight: float, support: float, *figures: str) -> Case:
    return Case(figures, _trial(_SPRING, _LIMP, weight, Part(8.0, resting(CENTRE), support)))


def _to(start: float, end: float, seconds: float) -> HandPath:
    return HandPath(CENTRE + start, CENTRE + end, 0.0, seconds, 0.0, 0.0, 0.0)


def _released(support: float, law: VerticalSettings) -> Case:
    """Return a case in which the hand lets go of a handle that carries or loads it."""
    weight, arm = (support, _LIMP) if support > 0.0 else (0.0, _ABLE)
    held = Part(3.0, resting(CENTRE), support)
    gone = held._replace(seconds=2.0, there=False)
    return Case(("flown", "flying"), _trial(law, arm, weight, held, gone), held.seconds)


def _reaching(support: float, seconds: float) -> Case:
    """Return six reaches of 0.24 m up and down, after one to where they begin."""
    ends = [0.0, *(0.12 if turn % 2 == 0 else -0.12 for turn in range(_REACHES + 1))]
    ways = zip(ends, ends[1:], strict=False)
    parts = (Part(_AGAIN_S, _to(start, end, seconds), support) for start, end in ways)
    return Case(("lost",), _trial(_DAMPED, _ABLE, 20.0, *parts), _AGAIN_S)


def _without_torque(braked: bool) -> Case:
    held = Part(3.0, resting(_HIGH), 20.0)
    off = held._replace(seconds=_FALL_S + 0.1, powered=False, braked=braked)
    return Case(("fallen",), _trial(_SPRING, _LIMP, 20.0, held, off, centre=_HIGH), held.seconds)


CASES = {
    "hangs, 20 N, not carried": _hanging(20.0, 0.0, "sunk"),
    "hangs, 12 N, carried": _hanging(12.0, 12.0, "off", "rest"),
    "hangs, 20 N, carried": _hanging(20.0, 20.0, "off", "rest"),
    "held still by a hand, +20 N": Case(
        ("rest",), _trial(_NONE, _ABLE, 20.0, Part(4.0, _to(-0.05, 0.05, 1.0), 20.0))
    ),
    "moved, 0.1 m/s, +20 N": Case(
        ("error",), _trial(_NONE, _ABLE, 20.0,
                           Part(15.0, HandPath(CENTRE, CENTRE, 0.0, 0.0, 0.12, 0.84, 0.0), 20.0)),
    ),
    **{
        f"let go, {support:+g} N, {word}": _released(support, law)
        for support in (20.0, -20.0)
        for word, law in (("spring of 100 N/m", _SPRING), ("no spring", _DAMPED))
    },
    **{
        f"reaches of 0.24 m in {seconds:g} s, {support:+g} N": _reaching(support, seconds)
        for seconds in (0.6, 0.7, 1.1)
        for support in (20.0, 10.0, -10.0, -20.0)
    },
    **{
        f"torque off, 20 N, drive {word}": _without_torque(braked)
        for word, braked in (("coasts", False), ("brakes", True))
    },
}  # fmt: skip
"""By name."""
