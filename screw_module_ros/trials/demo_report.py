# SPDX-License-Identifier: Apache-2.0
"""The demo's table and figures, computed from the bag, beside the thesis's figures."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from rich.table import Table

from screw_module_ros.identification import figures
from screw_module_ros.identification.force_position import MOTION_THRESHOLD, Offsets, Spring
from screw_module_ros.identification.recorded_session import Evaluation, Part, evaluate, read
from screw_module_ros.recording.counts import Counts
from screw_module_ros.recording.records import notes

IMPEDANCE = "impedance (PD)"
FRICTION_COMPENSATION = "friction compensation"
FORCE_FEEDBACK = "force feedback"
IN_TIME = 0.99


class Criterion(NamedTuple):
    """Acceptance of a mode: the thesis's figure, and bounds of the mean offset [N]."""

    thesis: str
    low: float = 0.0
    high: float = float("inf")

    @property
    def text(self) -> str:
        """The bounds as text."""
        if self.high == float("inf"):
            return ""
        return f"{self.low:g} to {self.high:g} N" if self.low else f"below {self.high:g} N"


WANTED = {
    IMPEDANCE: Criterion("about 10 N (fig 6-1)", 7.0, 13.0),
    FRICTION_COMPENSATION: Criterion("better in motion (fig 6-8)"),
    FORCE_FEEDBACK: Criterion("about 2 N (fig 6-10)", high=3.0),
}


class Results(NamedTuple):
    """Results of the demo.

    bag: folder of the recording, None if it was deleted. factor: simulated seconds per second,
    None for a run by wall clock.
    """

    spring: Spring
    parts: list[Part]
    evaluation: Evaluation
    counts: dict[str, Counts]
    bag: Path | None
    files: list[Path]
    factor: float | None = None

    @property
    def accepted(self) -> bool:
        """Whether every figure is within its limits."""
        met = [_met(p.name, o) for p, o in zip(self.parts, self.evaluation.offsets, strict=True)]
        complete = self.factor is None or all(count.complete for count in self.counts.values())
        return all(met) and self._in_time and complete

    @property
    def _in_time(self) -> bool:
        return self.evaluation.timing.in_time >= self._wanted_in_time

    @property
    def _wanted_in_time(self) -> float:
        """Least share of commands in time; all of them in simulated time, which waits for each."""
        return IN_TIME if self.factor is None else 1.0

    def tables(self) -> list[Table | str]:
        """Return the tables and lines to print."""
        bag = f"Bag: {_near(self.bag)}" if self.bag else "Bag: deleted (--drop-bag)"
        return [
            self._offsets(),
            self._timing(),
            *self._gaps(),
            bag,
            "Figures: " + ", ".join(str(_near(file)) for file in self.files),
        ]

    def _offsets(self) -> Table:
        spring = self.spring
        table = Table(
            title=f"Offset from a spring of {spring.stiffness:g} N/m about {spring.centre:g} m",
            caption="mean of |force of the patient - spring| while the handle moves faster than "
            f"{MOTION_THRESHOLD * 1e3:g} mm/s",
        )
        for name in ("mode", "up", "down", "both ways", "thesis", "wanted", ""):
            table.add_column(name, justify="right" if name in ("up", "down", "both ways") else None)
        for part, found in zip(self.parts, self.evaluation.offsets, strict=True):
            wanted = WANTED[part.name]
            verdict = _verdict(_met(part.name, found)) if wanted.text else ""
            newtons = (f"{value:.1f} N" for value in (found.up, found.down, found.mean))
            table.add_row(part.name, *newtons, wanted.thesis, wanted.text, verdict)
        return table

    def _timing(self) -> Table:
        t = self.evaluation.timing
        ticks = t.commands + t.lost
        table = Table(
            title=f"Commands to the vertical drive, {t.duration:.0f} s", show_header=False
        )
        if self.factor is not None:
            table.add_row("simulated time", f"{self.factor:.2f} of real time")
            table.add_row("answered", f"{t.commands} of {ticks} ticks")
        else:
            self._add_latencies(table)
        table.add_row("late", f"{t.late} of {t.commands} commands ({_percent(t.late, t.commands)})")
        table.add_row("lost", f"{t.lost} of {ticks} ticks ({_percent(t.lost, ticks)})")
        table.add_row(
            "inside the deadline of one period",
            f"{_percent(ticks - t.late - t.lost, ticks)}, wanted: at least "
            f"{100 * self._wanted_in_time:g} %: {_verdict(self._in_time)}",
        )
        return table

    def _add_latencies(self, table: Table) -> None:
        """Add the latencies, which exist only by wall clock."""
        t = self.evaluation.timing
        table.add_row("rate", f"{t.rate:.1f} 1/s")
        table.add_row(
            "latency SYNC -> drive write",
            f"p50 {t.p50 * 1e6:.0f} us, p99 {t.p99 * 1e6:.0f} us "
            f"(of each second, the median; worst second's p99 {t.worst_p99 * 1e6:.0f} us)",
        )

    def _gaps(self) -> list[Table | str]:
        messages = sum(count.messages for count in self.counts.values())
        line = f"Recorded: {messages} messages of {len(self.counts)} topics"
        holes = {name: count for name, count in self.counts.items() if not count.complete}
        if not holes:
            return [f"{line}, nothing missing."]
        table = Table(title="Topics with missing messages")
        for name in ("topic", "messages", "ticks lost", "not received", "not written"):
            table.add_column(name, justify=None if name == "topic" else "right")
        for name, count in sorted(holes.items()):
            numbers = (count.messages, count.lost, max(0, count.missed), count.dropped)
            table.add_row(name, *map(str, numbers))
        return [f"{line}.", table]


def evaluated(
    bag: Path,
    parts: Sequence[Part],
    spring: Spring,
    targets: Sequence[tuple[float, float]],
    folder: Path,
    keep_bag: bool = True,
    factor: float | None = None,
) -> Results:
    """Evaluate the bag; write figures and numbers into `folder`.

    factor: simulated seconds per second, None for a run by wall clock. Raises BagError if the
    bag lacks a topic, OSError if a file cannot be written.
    """
    found = evaluate(read(bag), parts, spring)
    counts = {name: Counts(**yaml.safe_load(text)) for name, text in notes(bag)["audit"].items()}
    title = "Simulated patient through a spring, vertical module"
    files = [
        figures.save(
            figures.force_position(found.traces, spring, title), folder / "force_position.png"
        ),
        figures.save(
            figures.path_views(found.paths, np.array(targets), "Path of the handle"),
            folder / "path.png",
        ),
    ]
    results = Results(
        spring, list(parts), found, counts, bag if keep_bag else None, files, factor
    )
    (folder / "results.yaml").write_text(_as_yaml(results), encoding="utf-8")
    if not keep_bag:
        shutil.rmtree(bag)
    return results


def _as_yaml(results: Results) -> str:
    found = results.evaluation
    return yaml.safe_dump(
        {
            "spring": results.spring._asdict(),
            "motion_threshold": MOTION_THRESHOLD,
            "modes": [
                {**part._asdict(), "offset": offsets._asdict()}
                for part, offsets in zip(results.parts, found.offsets, strict=True)
            ],
            "real_time_factor": results.factor,
            "timing": {**found.timing._asdict(), "in_time": found.timing.in_time},
            "recorded": {name: count._asdict() for name, count in results.counts.items()},
        },
        sort_keys=False,
    )


def _met(name: str, found: Offsets) -> bool:
    wanted = WANTED[name]
    return wanted.low <= found.mean <= wanted.high


def _percent(part: int, whole: int) -> str:
    return f"{100 * part / max(1, whole):.3f} %"


def _verdict(met: bool) -> str:
    return "[green]reached[/]" if met else "[bold red]MISSED[/]"


def _near(path: Path) -> Path:
    """Return the path relative to the current folder where it is below it."""
    here = Path.cwd()
    path = path.resolve()
    return path.relative_to(here) if path.is_relative_to(here) else path
