# SPDX-License-Identifier: Apache-2.0
"""The report's figures: paths per target, figures over trials and sessions, assistance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..figure_style import COLOURS, DESIRED
from .hand import AXES, VERTICAL
from .measures import Row
from .recorded import Recorded
from .report_content import SHOWN, has_sides, labelled, reaches, shown, values

_FREE, _ASSISTED, _ROBOT = COLOURS[2], COLOURS[0], COLOURS[3]
_NAMES = {False: "without assistance", True: "with assistance"}
_HUE = {False: _FREE, True: _ASSISTED}
_MARK = {False: "s", True: "o"}  # distinguishable also without colours
_BEST = {
    "path_error": "0 is straight",
    "sparc": "nearer to 0 is smoother",
    "reach_error": "0 is on target",
}
"""What a good value is, of figures that have one."""
_FROM_ZERO = frozenset(SHOWN) - {"sparc"}  # a small spread must not look like a large one
_LEAST_TOP = 0.1  # least upper end of the other axes, in their units
_ROOM = 1.08  # room above the highest mark, which would be cut
_LEAST_SPAN = 0.5  # least span of SPARC, for the same reason
_SMALL = {"font.size": 8.5, "axes.titlesize": 9.0, "legend.fontsize": 8.0}


class Path(NamedTuple):
    """One reach of the hand; points: on the axes of the protocol, shape (samples, axes) [m].

    late: in the last third of the reaches with the same assistance (with or without).
    """

    points: np.ndarray
    target: tuple[float, ...]
    assisted: bool
    late: bool


def outward_paths(recorded: Recorded) -> list[Path]:
    """Return the paths of all outward reaches, from the display of the target to the end."""
    axes, centre = AXES[recorded.protocol.space], recorded.protocol.centre
    rows = [
        row for row in reaches(recorded)
        if all(abs(row["start"][a] - centre[a]) < 1e-9 for a in axes)
    ]  # fmt: skip
    at = {sample.sequence: index for index, sample in enumerate(recorded.samples)}
    found = []
    totals = Counter(row["assisted"] for row in rows)
    numbers: Counter[bool] = Counter()
    for row in rows:
        first = at.get(row["first"], len(recorded.samples))
        last = at.get(row["last"], first + row["samples"])
        points = np.array([
            [sample.position[a] for a in axes]
            for sample in recorded.samples[first : last + 1]
            if sample.time_ns <= row["ended_ns"]
        ])  # fmt: skip
        if len(points) > 1:
            late = numbers[row["assisted"]] >= 2 * totals[row["assisted"]] // 3
            target = tuple(row["target"][a] for a in axes)
            found.append(Path(points, target, row["assisted"], late))
        numbers[row["assisted"]] += 1
    return found


def paths_figure(recorded: Recorded) -> Figure:
    """Draw the outward paths of a session, separately without and with assistance."""
    paths = outward_paths(recorded)
    with rc_context(_SMALL):
        figure = Figure(figsize=(7.4, 2.7), layout="constrained")
        parts = [a for a in (False, True) if any(path.assisted is a for path in paths)] or [False]
        panels = figure.subplots(1, len(parts), sharex=True, sharey=True, squeeze=False)[0]
        for axes, assisted in zip(panels, parts, strict=True):
            kept = [path for path in paths if path.assisted is assisted]
            title = f"{_NAMES[assisted].capitalize()}: {len(kept)} outward reaches"
            axes.set_title(title)
            if recorded.protocol.space == VERTICAL:
                _heights(axes, kept)
            else:
                _plane(axes, kept, recorded.protocol.rules.hit_radius)
        lines = {line.get_label(): line for axes in panels for line in axes.get_lines()}
        if recorded.protocol.space != VERTICAL:
            lines["target"] = Line2D([], [], ls="", marker="o", mfc="none", mec=DESIRED, ms=9)
        shown = {name: lines[name] for name in ("earlier", "last third", "target") if name in lines}
        if shown:
            figure.legend(shown.values(), shown.keys(), loc="outside right upper")
    return figure


def _plane(axes: Axes, paths: Sequence[Path], hit_radius: float) -> None:
    for path in paths:
        colour, zorder = (_ASSISTED, 3) if path.late else ("#b0b0b0", 2)
        label = "last third" if path.late else "earlier"
        axes.plot(*(1e3 * path.points[:, :2].T), color=colour, lw=0.8, zorder=zorder, label=label)
    for x, y, *_ in {path.target for path in paths}:
        angle = np.linspace(0.0, 2.0 * np.pi, 40)
        axes.plot(1e3 * (x + hit_radius * np.cos(angle)), 1e3 * (y + hit_radius * np.sin(angle)),
                  color=DESIRED, lw=1.2, zorder=4, label="target")  # fmt: skip
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("to the patient's right [mm]")
    axes.set_ylabel("away from the patient [mm]")


def _heights(axes: Axes, paths: Sequence[Path]) -> None:
    """Draw heights over the share of the reach's time, as there is no second axis."""
    for path in paths:
        colour = _ASSISTED if path.late else "#b0b0b0"
        label = "last third" if path.late else "earlier"
        share = np.linspace(0.0, 1.0, len(path.points))
        axes.plot(share, 1e3 * path.points[:, 0], color=colour, lw=0.8, label=label)
    for (height,) in {path.target for path in paths}:
        axes.axhline(1e3 * height, color=DESIRED, lw=1.2, label="target")
    axes.set_xlabel("share of the reach's time")
    axes.set_ylabel("height [mm]")


def trials_figure(sessions: Sequence[Recorded]) -> Figure:
    """Draw the figures of `shown` over all trials, session after session."""
    names = shown(sessions)
    with rc_context(_SMALL):
        figure = Figure(figsize=(7.4, 3.5), layout="constrained")
        panels = figure.subplots(2, 3).ravel()
        for axes in panels[len(names) :]:
            axes.remove()
        for axes, name in zip(panels, names, strict=False):
            _figure_over_trials(axes, sessions, name)
        lines = {line.get_label(): line for axes in figure.axes for line in axes.get_lines()}
        drawn = {name: lines[name] for name in _NAMES.values() if name in lines}
        if drawn:
            figure.legend(drawn.values(), drawn.keys(), loc="outside lower center", ncols=3)
    return figure


def _figure_over_trials(axes: Axes, sessions: Sequence[Recorded], name: str) -> None:
    offset = 0
    for number, recorded in enumerate(sessions):
        rows = reaches(recorded)
        for assisted in (False, True):
            kept = [row for row in rows if row["assisted"] is assisted]
            at, found = values(kept, name)
            label = _NAMES[assisted] if at.size else None
            axes.plot(at + offset, found, _MARK[assisted], ms=2.5, mfc="none", mew=0.6,
                      color=_HUE[assisted], label=label, alpha=0.8)  # fmt: skip
            _medians(axes, kept, name, offset, assisted)
        offset += max((row["trial"] for row in recorded.trials), default=0)
        if number + 1 < len(sessions):
            axes.axvline(offset + 0.5, color=DESIRED, lw=0.8, ls=":")
    _scale(axes, name)
    best = f": {_BEST[name]}" if name in _BEST else ""
    axes.set_title(labelled(name) + best)
    axes.set_xlabel("trial")
    axes.locator_params(axis="x", integer=True)


def _scale(axes: Axes, name: str) -> None:
    low, high = axes.get_ylim()
    if name in _FROM_ZERO:
        axes.set_ylim(0.0, max(_ROOM * high, _LEAST_TOP))
    elif high - low < _LEAST_SPAN:
        middle = (low + high) / 2.0
        axes.set_ylim(middle - _LEAST_SPAN / 2.0, middle + _LEAST_SPAN / 2.0)


def _medians(axes: Axes, rows: Sequence[Row], name: str, offset: int, assisted: bool) -> None:
    """Draw the median of each block as a line."""
    for block in sorted({row["block"] for row in rows}):
        at, found = values([row for row in rows if row["block"] == block], name)
        if at.size:
            ends = (offset + at[0] - 0.5, offset + at[-1] + 0.5)
            axes.plot(ends, [np.median(found)] * 2, color=_HUE[assisted], lw=2.2,
                      solid_capstyle="butt", zorder=5)  # fmt: skip


def assistance_figure(sessions: Sequence[Recorded]) -> Figure:
    """Draw duration and stiffness of the side walls after each change of the assistance."""
    found = {"duration": "time allowed for a reach [s]"}
    if has_sides(sessions):
        found["side_stiffness"] = "stiffness of the side walls [N/m]"
    with rc_context(_SMALL):
        figure = Figure(figsize=(7.4, 1.5), layout="constrained")
        panels = figure.subplots(1, len(found), squeeze=False)[0]
        for axes, (name, title) in zip(panels, found.items(), strict=True):
            _steps(axes, sessions, name, title)
    return figure


def _steps(axes: Axes, sessions: Sequence[Recorded], name: str, title: str) -> None:
    offset = 0
    for number, recorded in enumerate(sessions):
        changes = recorded.changes
        if changes:
            at = offset + np.arange(len(changes) + 1)
            found = [changes[0][f"{name}_before"], *(change[name] for change in changes)]
            axes.plot(at, found, "o-", ms=3, color=_ROBOT, drawstyle="steps-post")
            offset += len(changes) + 1
            if number + 1 < len(sessions):
                axes.axvline(offset - 0.5, color=DESIRED, lw=0.8, ls=":")
    axes.margins(y=0.2)
    axes.locator_params(axis="x", integer=True)
    axes.set_title(title)
    axes.set_xlabel("change")
