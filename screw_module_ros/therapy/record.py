# SPDX-License-Identifier: Apache-2.0
"""A trial's result as flat, named values, for the message, the CSV and the replay.

The names are those of TrialResult.msg.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping
from typing import Any

from .definitions import Definition
from .result import TrialResult

NUMBERS = (
    "trial", "block", "circuit", "kind", "assisted", "slot_duration", "side_stiffness",
    "initiated", "reached", "moved", "first", "last", "samples", "missing", "rate",
    "pm2a", "pm2b", "pm3", "pm4",
    "duration", "time_to_start", "mean_speed", "peak_speed", "speed_ratio", "speed_peaks",
    "arrest_ratio", "sparc", "jerk", "log_jerk", "path_error", "path_ratio", "direction_error",
    "reach_error", "robot_share", "patient_work", "robot_work", "independence", "size",
    "hold_deviation", "largest_force", "largest_vertical_force",
)  # fmt: skip
"""Flat fields of a result, in the order of the export."""


def flat(result: TrialResult) -> dict[str, Any]:
    """Return a result's flat fields by name, SI units, NaN if a kind of trial has no value."""
    measures = result.measures._asdict()
    del measures["pm1"]  # is `initiated`
    return {
        "trial": result.plan.number,
        "block": result.plan.block,
        "circuit": result.plan.circuit,
        "kind": result.kind,
        "assisted": result.assisted,
        "slot_duration": result.duration,
        "side_stiffness": result.side_stiffness,
        "initiated": result.initiated,
        "reached": result.reached,
        "moved": result.moved,
        "first": result.first,
        "last": result.last,
        "samples": result.samples,
        "missing": result.missing,
        "rate": result.rate,
        **measures,
        **result.figures._asdict(),
    }


def differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Return the names of the fields with different values; NaN equals NaN."""
    return [name for name in NUMBERS if not _same(one[name], other[name])]


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, float) and isinstance(other, float) and math.isnan(one):
        return math.isnan(other)
    return one == other


def csv_text(rows: Iterable[Mapping[str, Any]], first: tuple[str, ...] = ()) -> str:
    """Return rows as CSV: fields named `first`, then NUMBERS; SI units, empty for NaN.

    Numbers have all digits: reading them gives the same bits.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow((*first, *NUMBERS))
    for row in rows:
        writer.writerow(_cell(row[name]) for name in (*first, *NUMBERS))
    return stream.getvalue()


def definitions_text(definitions: Mapping[str, Definition]) -> str:
    """Return the definitions of the columns as CSV: a value times `factor` is in `unit`."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("column", "label", "factor", "unit", "definition"))
    for name, definition in definitions.items():
        row = (name, definition.label, definition.factor, definition.unit, definition.text)
        writer.writerow(row)
    return stream.getvalue()


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(value)
    return str(value)
