# SPDX-License-Identifier: Apache-2.0
"""What the supervisor tells the person at the terminal: each stop once, in one line, and its end.

One cause has several reasons, which come within a quarter of a second: the sample that is missing,
the drives that stop for it, the node that is lost. So a change is told when it has settled.
"""

from __future__ import annotations

from typing import NamedTuple

from .supervision import NOT_SEEN, OK, STOPPED, WAITING, Decision

_SETTLED_NS = {OK: 500_000_000, STOPPED: 500_000_000, WAITING: 2_000_000_000}
"""A decision that is unchanged for so long is told. At the end of the whole robot nodes are missing
for less than the time of WAITING, and that is nothing to tell."""
_LATEST_NS = 1_000_000_000  # a stop whose reasons go on changing


class Announced(NamedTuple):
    """Memory of what was told.

    level: of the last line. reasons: all that were told since that level began. last: level and
    reasons of the newest decision; since_ns: since when they are these; untold_ns: since when there
    is something to tell of this level [ns].
    """

    level: int = WAITING
    reasons: frozenset[str] = frozenset()
    last: tuple[int, tuple[str, ...]] = (WAITING, ())
    since_ns: int = 0
    untold_ns: int | None = None


def announce(
    state: Announced, decision: Decision, latched: bool, now_ns: int
) -> tuple[Announced, str]:
    """Return the next state, and the line to tell now, empty for none; call it at 10 Hz.

    latched: a reset is wanted. A node that was not seen yet is no reason here: its own log says
    what it waits for.
    """
    reasons = tuple(reason for reason in decision.reasons if not reason.endswith(NOT_SEEN))
    if decision.level != state.last[0]:
        state = state._replace(untold_ns=None)
    if (decision.level, reasons) != state.last:
        state = state._replace(last=(decision.level, reasons), since_ns=now_ns)
    known = state.reasons if decision.level == state.level else frozenset()
    if decision.level == state.level and known.issuperset(reasons):
        return state._replace(untold_ns=None), ""
    untold_ns = now_ns if state.untold_ns is None else state.untold_ns
    state = state._replace(untold_ns=untold_ns)
    late = decision.level == STOPPED and now_ns - untold_ns >= _LATEST_NS
    if not late and now_ns - state.since_ns < _SETTLED_NS[decision.level]:
        return state, ""
    line = _line(state, decision.level, reasons, latched)
    told = known.union(reasons)
    return state._replace(level=decision.level, reasons=told, untold_ns=None), line


def _line(state: Announced, level: int, reasons: tuple[str, ...], latched: bool) -> str:
    if level == OK:
        return "motion permitted again" if state.reasons else "motion permitted"
    text = "; ".join(reasons) or "nodes that were not seen yet"
    if level == WAITING:
        return f"motion not permitted: {text}"
    then = "; when the cause is gone: ~/reset, then enable the drives" if latched else ""
    return f"stopped: {text}{then}"
