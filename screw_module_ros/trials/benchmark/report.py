# SPDX-License-Identifier: Apache-2.0
"""Tables of `bench` with measured figures and limits, and the content of its JSON file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table

from screw_module_ros.identification.speed import Speed

from .figures import PAGE, PARTS, TIMING, UNITS, WANTED, Case, Run, Spread, spreads, verdict

WANTED_FACTOR = 200.0
LEGEND = (
    "answer: SYNC to reception of the encoder's answer (bus and device). own: from there "
    "(composed), or from reception of the command (separate), to the drive write."
)
_SUM = "all"

Measured = Mapping[Case, Sequence[Run]]


def timing_table(measured: Measured) -> Table:
    """Return latencies and shares of each case: median (range) and limit."""
    table = Table(title="SYNC to drive write, median (range) of the runs", title_justify="left")
    for name in ("processes", "rate", "figure", "found", "wanted", ""):
        table.add_column(name, justify="left" if name in ("processes", "figure") else "right")
    for case, runs in measured.items():
        found = spreads([run.figures for run in runs])
        names = (*TIMING, *PARTS, *((PAGE,) if case.page else ()))
        for name in names:
            limit = WANTED.get((case.processes, case.rate), {}).get(name)
            unit = UNITS.get(name, "us")
            table.add_row(
                case.title,
                f"{case.rate} Hz",
                name,
                f"{_spread_text(found[name], unit)} {unit}",
                "" if limit is None else f"{limit:g} {unit}",
                verdict(case, name, found[name].median),
                end_section=name == names[-1],
            )
    return table


def page_table(measured: Measured) -> Table | None:
    """Return what bridge and page change, beside how much the runs without differ; None without."""
    title = "web_bridge and one page: medians of runs in turn, (range) of those without"
    table = Table(title=title, title_justify="left")
    for name in ("processes", "rate", "figure", "without", "with", "difference", "within range"):
        table.add_column(name, justify="left" if name in ("processes", "figure") else "right")
    for case, runs in measured.items():
        bare = measured.get(case._replace(page=False), ())
        if not (case.page and bare):
            continue
        without, found = (spreads([run.figures for run in each]) for each in (bare, runs))
        for name in TIMING:
            unit, before, after = UNITS.get(name, "us"), without[name], found[name].median
            table.add_row(
                case.processes, f"{case.rate} Hz", name,
                f"{_spread_text(before, unit)} {unit}", f"{_number_text(after, unit)} {unit}",
                f"{_number_text(after - before.median, unit, '+')} {unit}",
                "yes" if after <= before.high else "ABOVE", end_section=name == TIMING[-1],
            )  # fmt: skip
    return table if table.row_count else None


def processor_table(measured: Measured) -> Table:
    """Return the processor time of each process, and the machine's load before the runs."""
    title = "Processor time, % of one core, median (range)"
    table = Table(title=title, title_justify="left")
    table.add_column("process")
    for case in measured:
        table.add_column(f"{case.title} {case.rate} Hz", justify="right")
    shares = {case: spreads([_with_sum(run.processor) for run in runs])
              for case, runs in measured.items()}
    names = dict.fromkeys(name for found in shares.values() for name in found if name != _SUM)
    for name in (*names, _SUM):
        cells = (
            _spread_text(found[name], "cpu") if name in found else "" for found in shares.values()
        )
        table.add_row(name, *cells)
    loads = (spreads([{"load": run.load} for run in runs])["load"] for runs in measured.values())
    table.add_row("load average before", *(_spread_text(load, "%") for load in loads))
    enabled = (f"{sum(run.enabled for run in runs)} of {len(runs)}" for runs in measured.values())
    table.add_row("runs enabled throughout", *enabled)
    return table


def loop_table(found: list[Speed]) -> Table:
    """Return the table of the in-process loop."""
    table = Table(title="In-process loop, 2 kHz samples, substeps of 50 us", title_justify="left")
    for name in ("trial", "cores", "x real time", "range", f"wanted {WANTED_FACTOR:g} on one core"):
        table.add_column(name, justify="left" if name == "trial" else "right")
    for speed in found:
        low, high = speed.factors[0], speed.factors[-1]
        note = "" if speed.cores > 1 else "yes" if speed.median >= WANTED_FACTOR else "MISSED"
        table.add_row(
            speed.trial, str(speed.cores), f"{speed.median:.0f}", f"{low:.0f}..{high:.0f}", note
        )
    return table


def content_of(measured: Measured, seconds: float, loop: list[Speed]) -> dict[str, Any]:
    """Return the content of the JSON file; an infinite latency becomes null."""
    graph = [
        {
            **case._asdict(),
            "seconds": seconds,
            "wanted": WANTED.get((case.processes, case.rate), {}),
            "median_low_high": {
                name: [_finite(value) for value in spread]
                for name, spread in spreads([run.figures for run in runs]).items()
            },
            "processor_median_low_high": spreads([_with_sum(run.processor) for run in runs]),
            "runs": [
                {**run._asdict(), "figures": {n: _finite(v) for n, v in run.figures.items()}}
                for run in runs
            ],
        }
        for case, runs in measured.items()
    ]
    return {
        "graph": graph,
        "in_process_loop": [{**speed._asdict(), "median": speed.median} for speed in loop],
    }


def _with_sum(processor: Mapping[str, float]) -> dict[str, float]:
    return {**processor, _SUM: sum(processor.values())}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _spread_text(spread: Spread, unit: str) -> str:
    middle, low, high = (_number_text(value, unit) for value in spread)
    return f"{middle} ({low}..{high})"


def _number_text(value: float, unit: str, sign: str = "") -> str:
    return f"{value:{sign}.{2 if unit == '%' else 0}f}"
