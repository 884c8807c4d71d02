# SPDX-License-Identifier: Apache-2.0
"""Versions of the plane's law and of its arm, which every recording has."""

from __future__ import annotations

import functools

from ..control.arms import FUNCTIONS, Arm
from ..control.plane_envelope import enveloped, initial_state
from ..control.plane_law import PlaneLaw
from .source_version import source_version


@functools.cache
def plane_law_version(law: PlaneLaw) -> str:
    """Return the version of a law in its envelope; see `source_version`."""
    functions = (law.needs, law.ask, law.help, law.rest, law.memory, law.own)
    return source_version(functions, law.settings, (enveloped, initial_state))


@functools.cache
def arm_version(arm: Arm) -> str:
    """Return the version of an arm; see `source_version`."""
    return source_version(tuple(getattr(arm, name) for name in FUNCTIONS), arm.settings)
