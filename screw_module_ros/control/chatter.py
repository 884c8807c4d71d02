# SPDX-License-Identifier: Apache-2.0
"""Chatter guard: reduces the force gain when the handle force oscillates (thesis 6.4.3, 7.1).

No force gain is stable against every load on the handle. An oscillation faster than a hand can move
shows the instability: when the rms of the handle force above `CORNER` exceeds the limit for
`LASTING`, which is longer than the jolt of a reversal, the share of the force gain falls to zero
within `FALL`, and the law replaces it by a damper. The share returns within `RETURN`, but only up
to a ceiling, a part of the share at which the oscillation began. The ceiling rises again with the
time constant `FORGET`. So a contact that is unstable at full gain does not oscillate every few
seconds.

An oscillation as slow as a hand's motion trips the guard too when the robot feeds it (`outflow`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..filters import LowpassState, lowpass_coefficients, lowpass_step
from .limits import clamp

CORNER = 6.0  # [Hz] twice first order: of 5 Hz of tremor 41 % pass, of 3 Hz 20 %
WINDOW = 0.05  # [s] of the mean square, exponential
LASTING = 0.2  # [s]
FALL = 0.1  # [s]
RETURN = 3.0  # [s]
FORGET = 60.0  # [s]
KEPT_SHARE = 0.4  # of the share at which shaking began
CLIPPED = 3.0  # of the limit: one jolt is no chatter, however hard
QUIET = 0.5  # of the limit: below it the shaking is over


class GuardState(NamedTuple):
    """Memory of the guard.

    share: of the force gain that remains, 0 to 1; ceiling: largest share to which it may return;
    tripped: the force oscillates now; above: time over the limit, weighted by the excess [s];
    mean_square [N^2]; first, second: low passes whose complement is the high pass.
    """

    share: float
    ceiling: float
    tripped: bool
    above: float
    mean_square: float
    first: LowpassState
    second: LowpassState


QUIET_GUARD = GuardState(
    1.0, 1.0, False, 0.0, 0.0, LowpassState(0.0, 0.0), LowpassState(0.0, 0.0)
)  # fmt: skip


def damper_share(state: GuardState) -> float:
    """Return the weight of the damper: 1 while the share is zero, 0 when it is at the ceiling."""
    if state.share >= state.ceiling:
        return 0.0
    return 1.0 - state.share / state.ceiling


def guarded(share: float) -> str:
    """Return the operator's message for a remaining share of the force gain, 0 to 1."""
    return (
        f"chatter guard: the handle force shakes, {100.0 * share:.0f} % of feedback and friction "
        "model are left, a damper is in their place; hold the handle otherwise, or lower the gain"
    )


def guard_step(
    state: GuardState, force: float, fed: bool, limit: float, dt: float
) -> GuardState:
    """Return the guard after a sample of the handle force [N].

    fed: the robot feeds an oscillation (`outflow.feeds`); limit: rms [N]; dt [s].
    """
    coefficients = lowpass_coefficients(CORNER, dt)
    slow, first = lowpass_step(coefficients, state.first, force)
    slower, second = lowpass_step(coefficients, state.second, force - slow)
    rapid = clamp(force - slow - slower, -CLIPPED * limit, CLIPPED * limit)
    mean_square = state.mean_square
    mean_square += (rapid * rapid - mean_square) * min(1.0, dt / WINDOW)
    rms = math.sqrt(mean_square)
    # A stronger oscillation trips the guard sooner, because an instability must not grow.
    above = state.above + dt * rms / limit if rms > limit else 0.0
    if state.tripped:
        tripped = fed or rms > QUIET * limit or state.share > 0.0
    else:
        tripped = fed or above > LASTING
    ceiling = clamp(state.ceiling + dt / FORGET, 0.0, 1.0)
    if tripped and not state.tripped:
        ceiling = KEPT_SHARE * state.share
    if tripped:
        share = state.share - dt / FALL
    else:
        share = min(state.share + dt / RETURN, ceiling)
    return GuardState(
        clamp(share, 0.0, 1.0), ceiling, tripped, above, mean_square, first, second
    )
