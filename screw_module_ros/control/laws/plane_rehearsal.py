# SPDX-License-Identifier: Apache-2.0
"""One call of each function of somebody else's law of the plane, before it is taken."""

from __future__ import annotations

import math
from typing import Any

from ..planar_settings import PlanarSettings
from ..plane_law import Needs, PlaneLaw, PlaneMotion, PlaneSample
from .rehearsal import Flaw, called, memory_of, unlike


def flaw_of_plane_calls(law: PlaneLaw) -> str:
    """Return what goes wrong when each function is called once, as `flaw_of_calls` does."""
    try:
        own = called("own", law.own, law.settings(), PlanarSettings())
        m = memory_of(law, own)
        sample = PlaneSample(2e-3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False, 0.0, 0.0, 0.0)
        needs = called("needs", law.needs, own, m, sample, 100.0)
        if not isinstance(needs, Needs):
            raise unlike("needs", needs, "return Needs(damper, in_slot, 1.0)")
        motion = PlaneMotion(0.0, 0.0, 0.0, 0.0, 100.0, 10.0)
        _two("ask", called("ask", law.ask, own, m, sample, motion))
        told = own, m, sample, motion, (0.0, 0.0), (1.0, 1.0)
        _two("help", called("help", law.help, *told))
        called("rest", law.rest, own, m)
    except Flaw as flaw:
        return str(flaw)
    return ""


def _two(name: str, answer: Any) -> None:
    try:
        x, y = answer
        math.isfinite(x), math.isfinite(y)
    except (TypeError, ValueError):
        raise unlike(name, answer, "two numbers of N are wanted") from None
