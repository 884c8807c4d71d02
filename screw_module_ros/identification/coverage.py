# SPDX-License-Identifier: Apache-2.0
"""How often the 95 % intervals that the experiments state hold a hidden value.

A simulated module knows its values, an experiment does not. Over many perturbed modules an honest
interval holds 95 % of them: fewer say that a source of uncertainty is missing, and errors that are
always far inside say that the interval tells less than the trials do.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from scipy.stats import binom

from ..settings_file import parse
from .report import WANTED, Checked, like
from .uncertainty import PER_INTERVAL

FILE = "coverage.yaml"
FIRST_SEED = 301  # no choice was made on these; windows and sources were on 101 to 120
HOLDS, TOO_NARROW, TOO_WIDE = "holds", "TOO NARROW", "TOO WIDE"
HEAD = ("experiment", "quantity", "held", "rms of error / sigma", "largest", "sigma", "verdict")
HIDDEN = tuple(dict.fromkeys(row.experiment for row in WANTED if row.truth))
"""Experiments that recover a hidden value."""
LEFT_OUT: dict[str, dict[str, Any]] = {
    "friction_map": {"inverted_speeds": ()}, "torque_response": {"slow_rate": 0.0},
}  # fmt: skip
"""Settings that save half of the time: trials which no hidden value needs."""
_CHANCE = 0.025  # chance that an honest interval is called too narrow
_FAR_INSIDE = 0.5
"""Share of half the interval: all of 20 honest errors lie so near in 1 of 2700 cases."""


class Covered(NamedTuple):
    """A hidden value over all modules.

    experiment, quantity: names; held: modules whose truth lies in the interval; of: modules; rms,
    largest: of the errors in stated standard deviations; sigma: their median, as text.
    """

    experiment: str
    quantity: str
    held: int
    of: int
    rms: float
    largest: float
    sigma: str

    @property
    def verdict(self) -> str:
        """HOLDS, TOO_NARROW or TOO_WIDE."""
        if self.held < least(self.of):
            return TOO_NARROW
        return TOO_WIDE if self.largest < _FAR_INSIDE * PER_INTERVAL else HOLDS


def least(count: int) -> int:
    """Return how many of `count` 95 % intervals must hold: an honest one holds fewer in 2.5 %."""
    return int(binom.ppf(_CHANCE, count, 0.95))


def covered(checked: Iterable[Checked]) -> list[Covered]:
    """Return each hidden value over the modules on which it was identified."""
    found: dict[tuple[str, str], list[Checked]] = {}
    for row in checked:
        if row.wanted.truth:
            found.setdefault((row.wanted.experiment, row.ours.name), []).append(row)
    return [
        _covered(experiment, quantity, rows) for (experiment, quantity), rows in found.items()
    ]


def _covered(experiment: str, quantity: str, rows: Sequence[Checked]) -> Covered:
    off = np.array([abs(row.sigmas) for row in rows])
    off[np.isnan(off)] = math.inf  # no value, or no uncertainty: nothing that could hold
    stated = float(np.median([row.ours.uncertainty for row in rows]))
    return Covered(
        experiment, quantity, int((off <= PER_INTERVAL).sum()), len(rows),
        float(np.sqrt(np.mean(off**2))), float(off.max()), like(rows[0].ours, stated),
    )  # fmt: skip


def coverage_rows(rows: Iterable[Covered]) -> list[tuple[str, ...]]:
    """Return the cells of the table."""
    return [
        (row.experiment, row.quantity, f"{row.held} of {row.of}", f"{row.rms:.2f}",
         f"{row.largest:.1f}", row.sigma, row.verdict)
        for row in rows
    ]  # fmt: skip


def save(folder: Path, rows: Iterable[Covered]) -> None:
    """Write the rows into a folder, for the report. Raises OSError."""
    text = yaml.safe_dump([row._asdict() for row in rows], sort_keys=False)
    (folder / FILE).write_text(text, encoding="utf-8")


def load(folder: Path) -> list[Covered]:
    """Return the rows that a run left in a folder, none without one. Raises ValueError, OSError."""
    file = folder / FILE
    if not file.exists():
        return []
    try:
        return [Covered(**row) for row in parse(file.read_bytes().decode(), str(file))]
    except TypeError as error:
        raise ValueError(f"{file}: not the coverage of a run: {error}; remove it") from error
