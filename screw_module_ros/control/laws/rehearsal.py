# SPDX-License-Identifier: Apache-2.0
"""One call of each function of somebody else's law, before it is taken.

A function that misspells a field, takes too few arguments or answers with another kind is told at
the start, not when a hand holds the handle. What a law does later is the envelope's to bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ... import plugins
from ..friction import FrictionBranch, FrictionModel
from ..law import Asked, Help, Law, Motion, Robot, Sample

_AT = 0.18  # [m], where the handle stands
_NO_FRICTION = FrictionBranch((0.0,) * 8, (0.0,) * 6, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0)
_ROBOT = Robot(
    FrictionModel(0.0, 360.0, 300.0, 1.0, 19.05, 0.0, 0.0, _NO_FRICTION, _NO_FRICTION), 5.5, 10.0
)


class Flaw(Exception):
    """Says what is wrong with the law."""


def flaw_of_calls(law: Law) -> str:
    """Return what goes wrong when each function is called once, empty if nothing does.

    At its default settings, on a module without friction, in each mode, at rest and not pressed.
    """
    try:
        own = called("own", law.own, law.settings(), _ROBOT)
        for mode in law.variants:
            _rehearse(law, mode, own)
    except Flaw as flaw:
        return str(flaw)
    return ""


def memory_of(law: Any, own: Any) -> Any:
    """Return a law's memory, of the plane too. Raises Flaw, also for what it shows and has not."""
    m = called("memory", law.memory, own)
    if missing := [name for name in law.shown if not called("memory", hasattr, m, name)]:
        raise Flaw(f"it shows {missing[0]}, which its memory has not")
    return m


def _rehearse(law: Law, mode: int, own: Any) -> None:
    m = memory_of(law, own)
    sample = Sample(1e-3, mode, _AT, 0.0, 0.0, 0.0, 0.0, 1.0, False, 0.0)
    foreseen = called("foresee", law.foresee, own, m, sample)
    try:
        math.isfinite(foreseen)
    except (TypeError, ValueError):
        raise unlike("foresee", foreseen, "a number of N is wanted") from None
    motion = Motion(_AT, 0.0, 100.0, 5.0, 0.0, 0.0, foreseen, 0.0, 0.0)
    asked = called("ask", law.ask, own, m, sample, motion)
    if not isinstance(asked, Asked):
        raise unlike("ask", asked, "return pulls(force)")
    helped = called("help", law.help, own, m, sample, motion, 0.0)
    if not isinstance(helped, Help):
        raise unlike("help", helped, "return feeds(force, pressed)")
    called("rest", law.rest, own, m)


def called(name: str, function: Callable, *told: Any) -> Any:
    """Return what a law's function answers. Raises Flaw when it fails."""
    try:
        return function(*told)
    except BaseException as error:  # somebody else's: anything may come out of it
        raise Flaw(f"its {name} fails: {plugins.told(error)}{plugins.where(error)}") from None


def unlike(name: str, answer: Any, wanted: str) -> Flaw:
    """Return what is wrong with an answer of another kind than the one that is wanted."""
    return Flaw(f"its {name} answers {plugins.one_line(called(name, repr, answer))}: {wanted}")
