# SPDX-License-Identifier: Apache-2.0
"""Checks that the soak's samples do not grow: robust slopes against bounds; table and figure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from rich.table import Table
from scipy.stats import theilslopes

from screw_module_ros.figure_style import COLOURS, STYLE, save
from screw_module_ros.recording.verify import Report

WARM_UP_S = 60.0
_SHARE_OF_WARM_UP = 0.2  # of a short run
_LEAST = 5  # samples for a slope
_PAGES = 2.0  # MiB; normal variation of a heap, also in a short run


class Bound(NamedTuple):
    """Allowed growth of a quantity over the run: a share of its median, but at least `least`.

    per_hour: `least` is per hour, not per run.
    """

    unit: str
    share: float
    least: float
    per_hour: bool = False


# Memory: the recorder keeps an index of the open file, and Python's heap varies. Counts must not
# grow at all: a leak adds at least one. Latency depends on the machine's load.
BOUNDS = {
    "memory": Bound("MiB", 0.0, 12.0, per_hour=True),
    "handles": Bound("", 0.0, 0.5),
    "threads": Bound("", 0.0, 0.5),
    "shared": Bound("", 0.0, 0.5),
    "latency p50": Bound("us", 0.1, 50.0),
    "latency p99": Bound("us", 0.25, 200.0),
    "waiting": Bound("messages", 0.0, 1000.0),
}


class Sample(NamedTuple):
    """Sample at a time [s] since the start; values by (process or "robot", quantity)."""

    time: float
    values: dict[tuple[str, str], float]


class Trend(NamedTuple):
    """Trend of one quantity; growth: of the Theil-Sen line over the run.

    low, high: 95 % interval of the growth. bound: allowed growth. All in the quantity's unit.
    """

    of: str
    quantity: str
    first: float
    last: float
    growth: float
    low: float
    high: float
    bound: float

    @property
    def flat(self) -> bool:
        """Whether the growth is within the bound, or not significant."""
        return self.growth <= self.bound or self.low <= 0.0


class Line(NamedTuple):
    """One check: its name, whether it passed, and the figures."""

    text: str
    good: bool
    detail: str


def trends(samples: Sequence[Sample]) -> list[Trend]:
    """Return the trend of every quantity after the warm-up that has enough samples."""
    if not samples:
        return []
    duration = samples[-1].time - samples[0].time
    begin = samples[0].time + min(WARM_UP_S, _SHARE_OF_WARM_UP * duration)
    kept = [sample for sample in samples if sample.time >= begin]
    names = dict.fromkeys(name for sample in kept for name in sample.values)
    return [found for name in names if (found := _trend(name, kept)) is not None]


def _trend(name: tuple[str, str], samples: Sequence[Sample]) -> Trend | None:
    seen = [(sample.time, sample.values.get(name, math.nan)) for sample in samples]
    points = [point for point in seen if math.isfinite(point[1])]
    if len(points) < _LEAST:
        return None
    times, values = np.array(points).T
    span = float(times[-1] - times[0])
    fit = theilslopes(values, times, 0.95)
    bound = BOUNDS[name[1]]
    least = bound.least * span / 3600.0 if bound.per_hour else bound.least
    allowed = max(bound.share * float(np.median(values)), least)
    allowed = max(allowed, _PAGES) if bound.unit == "MiB" else allowed
    third = max(1, len(values) // 3)
    first, last = float(np.median(values[:third])), float(np.median(values[-third:]))
    return Trend(*name, first, last, *(float(s) * span for s in (fit[0], fit[2], fit[3])), allowed)


def verdicts(
    found: Sequence[Trend], audit: Report, recorder: dict[str, int], stops: Sequence[str]
) -> list[Line]:
    """Return the checks of the soak; recorder: its last `dropped` and `missed` counts."""
    lines = []
    for quantity, bound in BOUNDS.items():
        these = [trend for trend in found if trend.quantity == quantity]
        if not these:
            continue
        worst = max(these, key=lambda trend: trend.growth - trend.bound)
        detail = (
            f"worst: {worst.of} {worst.first:.4g} to {worst.last:.4g} {bound.unit}, "
            f"grew {worst.growth:+.2g} (allowed {worst.bound:.2g})"
        )
        lines.append(Line(f"{quantity} flat", all(trend.flat for trend in these), detail))
    counts = audit.topics.values()
    messages = sum(count.messages for count in counts)
    missed = sum(max(0, count.missed) for count in counts)
    dropped = sum(count.dropped for count in counts)
    # The first check counts the gaps in the tick numbers that the recorder caused.
    skipped = {n: c.lost - max(0, c.missed) for n, c in audit.topics.items()}
    skipped = {name: number for name, number in skipped.items() if number > 0}
    lost = sum(skipped.values())
    reported = f"it reported {recorder.get('missed', 0)} and {recorder.get('dropped', 0)}"
    lines.append(
        Line("recorder lost nothing", not missed + dropped,
             f"of {messages} messages {missed} not received, {dropped} not written ({reported})")
    )  # fmt: skip
    share = lost / (messages + missed + lost) if lost else 0.0
    where = ", ".join(f"{name} {number}" for name, number in skipped.items())
    text = f"{lost} tick numbers ({share:.3%}) were skipped by the robot" if lost else "0 skipped"
    lines.append(Line("zero lost samples", not lost, f"{text}{': ' if where else ''}{where}"))
    other = [p for p in audit.problems if not _only_lost(p)]
    lines.append(Line("bag sound", not other, "; ".join(other[:3]) or "hashes and counts fit"))
    lines.append(Line("torque stayed on", not stops, "; ".join(stops[:3]) or "no stop"))
    return lines


def _only_lost(problem: str) -> bool:
    """Whether a problem is only about lost messages, which have their own line."""
    return ": of " in problem and " messages " in problem and "out of order" not in problem


def table(lines: Sequence[Line]) -> Table:
    """Return the checks as a table."""
    made = Table(title="Soak", title_justify="left")
    for column in ("wanted", "", "figures"):
        made.add_column(column)
    for line in lines:
        made.add_row(line.text, "yes" if line.good else "MISSED", line.detail)
    return made


def content(
    samples: Sequence[Sample], found: Sequence[Trend], lines: Sequence[Line], **more: Any
) -> dict[str, Any]:
    """Return the content of the JSON file."""
    return {
        **more,
        "verdicts": [line._asdict() for line in lines],
        "bounds": {name: bound._asdict() for name, bound in BOUNDS.items()},
        "trends": [{**trend._asdict(), "flat": trend.flat} for trend in found],
        "samples": [
            {"time": sample.time, **{" ".join(n): v for n, v in sample.values.items() if v == v}}
            for sample in samples
        ],
    }


def draw(samples: Sequence[Sample], file: Path) -> Path:
    """Draw memory, handles, latency if it was sampled, and the recorder's queue over time."""
    noted = {quantity for sample in samples for _, quantity in sample.values}
    panels = [panel for panel in (
        ("memory of each process [MiB]", ("memory",)),
        ("file handles of each process", ("handles",)),
        ("latency, SYNC to drive write [us]", ("latency p50", "latency p99")),
        ("messages waiting for the disk", ("waiting",)),
    ) if noted.intersection(panel[1])]  # fmt: skip
    with rc_context(STYLE):
        figure = Figure(figsize=(8.0, 2.25 * len(panels)), layout="constrained")
        axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for axis, (title, quantities) in zip(axes, panels, strict=True):
            names = dict.fromkeys(n for s in samples for n in s.values if n[1] in quantities)
            for number, name in enumerate(names):
                style = "-" if number < len(COLOURS) else "--"
                axis.plot(
                    [sample.time / 60.0 for sample in samples],
                    [sample.values.get(name, math.nan) for sample in samples],
                    style, color=COLOURS[number % len(COLOURS)],
                    label=name[0] if len(quantities) == 1 else name[1],
                )  # fmt: skip
            axis.set_title(title, loc="left")
            axis.set_ylim(bottom=0.0)
            if len(names) > 1:
                axis.legend(ncols=2, loc="center left", bbox_to_anchor=(1.0, 0.5))
        axes[-1].set_xlabel("time [min]")
    return save(figure, file)
