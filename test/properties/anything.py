# SPDX-License-Identifier: Apache-2.0
"""Strategies for input nobody should send, and settings with which every run tries the same."""

from __future__ import annotations

import math
from dataclasses import astuple, is_dataclass
from typing import Any

from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st

from screw_module_ros.settings import fields

MS = 1_000_000
START_NS = 1_000_000_000_000
ROUNDING = 1e-9

SPECIAL = (0.0, -0.0, 1e-300, -1.0, 1.0, 1e9, -1e9, 1e308, -1e308, math.inf, -math.inf, math.nan)
absurd = st.one_of(st.sampled_from(SPECIAL), st.floats(allow_nan=True, allow_infinity=True))
stamps = st.one_of(st.integers(-3 * MS, MS), st.integers(-(2**62), 2**62))


def near(low: float, high: float, wild: bool = True):
    """Return numbers mostly of a plausible range, now and then anything at all."""
    plausible = st.floats(low, high)
    return st.one_of(plausible, plausible, plausible, absurd) if wild else plausible


def live_changes(kind: type):
    """Return changes of the fields of a settings tuple that may change while a node is active."""
    live = [field for field in fields(kind).values() if field.setting.live]
    return st.one_of(
        *(
            st.tuples(st.just(field.name), st.floats(field.setting.low, field.setting.high))
            for field in live
        )
    )


def fixed(examples: int, steps: int = 50):
    """Return settings: so many examples of so many steps, the same ones in every run."""
    return settings(
        max_examples=examples,
        stateful_step_count=steps,
        phases=(Phase.generate, Phase.shrink),  # to explain costs more than to find
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )


def all_finite(numbers: Any) -> bool:
    """Return whether no number in nested tuples, lists and records is NaN or infinite."""
    if is_dataclass(numbers):
        numbers = astuple(numbers)
    if isinstance(numbers, (tuple, list)):
        return all(map(all_finite, numbers))
    return not isinstance(numbers, float) or math.isfinite(numbers)
