# SPDX-License-Identifier: Apache-2.0
"""Trials of the plane and the force error in them. Ours: the thesis has none.

The error is what the hand feels beyond the spring and damper asked for, its true force less
K x + B v of the true handle, over all samples as in `force_error`: in slow, fast and small motion,
reaching, holding still, letting go, with an arm of 30 kg, a tremor, and on walls. The command
`study --plane` has them on rigs drawn by seed, with and without force feedback.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ..control.planar_settings import PlanarSettings
from ..plant.patient import HandPath
from .force_error import WALLS, wall
from .trials import HEAVY, PlanarTrial

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
    "heavy": _case("an arm of 30 kg, 0.05 m at 0.8 rad/s", _sine(0.05, 0.8), 7.9, arm=HEAVY),
    "heavy_holding": _case("an arm of 30 kg that holds still", hand_to(0.05), 6.0, 1.0,
                           "chatter shaking", arm=HEAVY, ended=1.0),
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
