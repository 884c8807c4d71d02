# SPDX-License-Identifier: Apache-2.0
"""The progress of a patient as one page: eleven small plots, and what is said of them."""

from __future__ import annotations

import io
import math
from pathlib import Path

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..figure_style import COLOURS, DESIRED
from ..files import replace
from .progress import Line, Progress
from .report import STATEMENT, rendered

_SMALL = {"font.size": 8.0, "axes.titlesize": 8.0, "svg.hashsalt": "progress"}


def write_progress(file: Path, found: Progress) -> Path:
    """Write the page as HTML for its owner alone; return its path. Raises OSError."""
    stream = io.StringIO()
    with rc_context(_SMALL):
        progress_figure(found).savefig(stream, format="svg", metadata={"Date": None})
    drawn = stream.getvalue()[stream.getvalue().index("<svg") :]
    page = rendered("progress.html.jinja", found=found, figure=drawn, statement=STATEMENT)
    replace(file, page, private=True)
    return file


def progress_figure(found: Progress) -> Figure:
    """Draw each line over weeks: the first session hollow, the error of measurement grey."""
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    panels = list(figure.subplots(3, 4).flat)
    for axes, line in zip(panels, found.lines, strict=False):
        _draw(axes, found.weeks, line)
    for axes in panels[len(found.lines) :]:
        axes.set_axis_off()
    return figure


def _draw(axes: Axes, weeks: list[float], line: Line) -> None:
    axes.set_title(line.label)
    if not any(math.isfinite(point.value) for point in line.points):
        axes.set(xticks=[], yticks=[])
    if line.base is not None:
        base = line.points[line.base].value
        axes.axhspan(base - line.error * abs(base), base + line.error * abs(base), color="#e4e4e4")
    face = "white"
    for week, point in zip(weeks, line.points, strict=True):
        if math.isfinite(point.low):
            axes.plot([week, week], [point.low, point.high], color=DESIRED, lw=0.8)
        axes.plot(week, point.value, "o", ms=4, color=COLOURS[0], markerfacecolor=face)
        face = COLOURS[0] if math.isfinite(point.value) else face
