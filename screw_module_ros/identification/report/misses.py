# SPDX-License-Identifier: Apache-2.0
"""All misses as sentences: failures, values not recovered, differences from the thesis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from .rows import Checked, Compared
from .study import Module
from .tables import module_name
from .words import like, value_text


class Miss(NamedTuple):
    """One miss. serious: a criterion failed; else an explained difference from the thesis."""

    text: str
    serious: bool


def misses_of(
    modules: Sequence[Module], rows: list[Compared], checks: list[tuple[Module, Checked]]
) -> Iterator[Miss]:
    """Yield every miss, the serious ones first."""
    yield from _failures(modules)
    yield from _unrecovered(checks)
    yield from _no_better(modules)
    differing = [row for row in rows if row.ours and not row.agrees]
    for row in sorted(differing, key=lambda row: bool(row.published.why)):
        p = row.published
        text = (
            f"{p.experiment}, {row.ours.text}: thesis {like(row.ours, p.value)}, ours "
            f"{value_text(row.ours)}: {p.why or 'no explanation is known'}"
        )
        yield Miss(text, not p.why)


def _failures(modules: Sequence[Module]) -> Iterator[Miss]:
    for module in modules:
        for name, outcome in module.outcomes.items():
            if outcome.failure:
                yield Miss(f"{module_name(module)} module, {name}: {outcome.failure}", True)


def _unrecovered(checks: list[tuple[Module, Checked]]) -> Iterator[Miss]:
    for module, row in checks:
        if row.met or row.ours is None:
            continue
        truth = "" if math.isnan(row.truth) else f", truth {like(row.ours, row.truth)}"
        text = (
            f"{module_name(module)} module, {row.wanted.experiment}, {row.ours.text}: "
            f"{value_text(row.ours)}{truth}, wanted {row.limit_text}"
        )
        yield Miss(text, True)


def _no_better(modules: Sequence[Module]) -> Iterator[Miss]:
    for module in modules:
        result = module.result("compensation")
        if result and result.value("ratio") >= 1.0:
            text = "feed-forward with the identified model is no better than with the default"
            yield Miss(f"{module_name(module)} module: {text}", True)
