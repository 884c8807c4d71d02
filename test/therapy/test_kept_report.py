# SPDX-License-Identifier: Apache-2.0
"""Reports of recorded and simulated sessions: every word of the page, every mark of the figures."""

from __future__ import annotations

import functools
import hashlib
import re
from pathlib import Path

import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from simulated_patient import FEEBLE, HEALTHY, brief, recorded, short

from screw_module_ros.therapy.protocol_file import load_protocol
from screw_module_ros.therapy.recorded import Recorded, read_sessions
from screw_module_ros.therapy.replay import replayed
from screw_module_ros.therapy.report import write_report
from screw_module_ros.therapy.report_figures import assistance_figure, paths_figure, trials_figure

BAG = next((Path(__file__).parents[1] / "data" / "bags").glob("P-7K3QX_*"))
CLOCK, ELEVATOR = map(load_protocol, ("clock_adaptive", "elevator"))
_IMAGE = re.compile(r"data:image/png;base64,[\w+/=]+")
_DATE = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d")  # local time of who recorded it


@functools.cache
def bag() -> list[Recorded]:
    return read_sessions(BAG)


@functools.cache
def plane() -> list[Recorded]:
    """Two sessions in the plane, the second one ended early."""
    first, second = (recorded(HEALTHY, short(CLOCK), *k) for k in ((1, 0), (2, 2)))
    return [first, second._replace(trials=second.trials[:6], acts=second.acts[:-1])]


@functools.cache
def unaided() -> list[Recorded]:
    """Somebody who reaches nothing, without adaptation."""
    protocol = short(CLOCK, rules=CLOCK.rules._replace(give_up=2.0), adaptation=None)
    return [recorded(FEEBLE._replace(reach=0.3), protocol, 1)]


@functools.cache
def evaluation() -> list[Recorded]:
    """What is not a reach."""
    return [recorded(HEALTHY, brief(load_protocol("evaluation"), 1.0, 1), 1)]


@functools.cache
def vertical() -> list[Recorded]:
    """Nothing of the sides: a path up and down has no error, and there are no side walls."""
    return [recorded(HEALTHY, short(ELEVATOR), 1)]


@functools.cache
def vertical_unadapted() -> list[Recorded]:
    """The same, with fixed assistance."""
    return [recorded(HEALTHY, short(ELEVATOR, adaptation=None), 1)]


def ended_at_once() -> list[Recorded]:
    """Nothing was moved: the report drew empty axes, and was "sampled at no samples"."""
    (whole, _) = plane()
    return [whole._replace(trials=[], acts=whole.acts[:1], changes=[])]


DRAWN = (bag, plane, unaided, evaluation, vertical, vertical_unadapted)


def marks(figure: Figure) -> list[dict]:
    """Return what is on each panel: texts, limits, and each line by colour and rounded points."""
    return [
        {
            "title": axes.get_title(loc="left"),
            "labels": [axes.get_xlabel(), axes.get_ylabel()],
            "limits": [f"{value:.5g}" for value in (*axes.get_xlim(), *axes.get_ylim())],
            "lines": [
                f"{line.get_label() if not line.get_label().startswith('_') else '-'} "
                f"{to_hex(line.get_color())} {line.get_marker()} {line.get_linestyle()} "
                f"{_digest(' '.join(f'{v:.6g}' for xy in line.get_xydata() for v in xy))}"
                for line in axes.get_lines()
            ],
            "legend": [text.get_text() for legend in figure.legends for text in legend.texts],
        }
        for axes in figure.axes
    ]


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]


@pytest.mark.parametrize("made", [*DRAWN, ended_at_once], ids=lambda made: made.__name__)
def test_the_page_is_the_kept_one(made, kept, tmp_path):
    sessions = made()
    file = write_report(tmp_path / "page.html", sessions, [replayed(each) for each in sessions])
    text = _DATE.sub("DATE", _IMAGE.sub("IMAGE", file.read_text("utf-8")))
    body = text.partition("<body")[2].partition("<dl")[0]
    words = re.sub(r"\s*<[^>]*>\s*", "\n", body)
    kept([line.strip() for line in words.splitlines() if line.strip()])


@pytest.mark.parametrize("made", DRAWN, ids=lambda made: made.__name__)
def test_its_figures_are_the_kept_ones(made, kept):
    sessions = made()
    figures = [paths_figure(sessions[-1]), trials_figure(sessions), assistance_figure(sessions)]
    kept([marks(figure) for figure in figures])
