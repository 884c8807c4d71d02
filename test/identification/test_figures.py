# SPDX-License-Identifier: Apache-2.0
"""Shared figures, and one look at those of every experiment."""

import io

import numpy as np
import pytest
from formula_bench import keep_calibration
from test_kept_results import SETTINGS

from screw_module_ros.identification import figures
from screw_module_ros.identification.experiments import EXPERIMENTS
from screw_module_ros.identification.figures import Path3D, Trace
from screw_module_ros.identification.force_metric import Spring
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.results import load_result

SPRING = Spring(100.0, 0.18)


def loop(name: str, beyond: float) -> Trace:
    angle = np.linspace(0.0, 4.0 * np.pi, 20_000)
    position = 0.18 + 0.1 * np.sin(angle)
    velocity = 0.08 * np.cos(angle)
    return Trace(name, position, velocity, 100 * (position - 0.18) + beyond * np.sign(velocity))


def test_force_position_curves_with_the_desired_spring():
    traces = [loop("plain", 10.0), loop("better", 2.0)]
    axes = figures.force_position(traces, SPRING).axes[0]
    legend = {text.get_text() for text in axes.get_legend().get_texts()}
    assert legend == {"plain", "better", "desired: 100 N/m about 0.18 m"}
    assert axes.get_xlabel().endswith("[m]") and axes.get_ylabel().endswith("[N]")
    (line,) = [line for line in axes.lines if line.get_label().startswith("desired")]
    position, force = line.get_data()
    assert force == pytest.approx(100.0 * (position - 0.18))
    assert line.get_linestyle() == "--"
    assert line.get_linewidth() > 2 * axes.lines[0].get_linewidth()
    arrows = [text for text in axes.texts if hasattr(text, "arrow_patch")]
    assert len(arrows) >= 2
    for arrow in arrows:
        upward = arrow.xy[0] > arrow.xyann[0]
        above = arrow.xy[1] > 100.0 * (arrow.xy[0] - 0.18)
        assert upward == above  # friction: the patient pushes more on the way up


def test_paths_are_seen_from_above_and_from_the_front():
    way = np.linspace(0.0, 0.1, 50)
    points = np.column_stack([way, 2.0 * way, 3.0 * way])
    visited = [(0.1, 0.0), (0.0, 0.1)]
    figure = figures.path_views([Path3D("one", points, visited), Path3D("two", -points)])
    figure.savefig(io.BytesIO())  # shared axes show only here what they cannot do together
    titles = [axes.get_title("left") for axes in figure.axes]
    assert titles[:2] == ["one", "two"], "no path is drawn over another"
    marks = [axes.collections for axes in figure.axes[:2]]
    assert marks[0][0].get_offsets().tolist() == [list(place) for place in visited]
    assert not marks[1], "a path without targets shows none"
    for axes, upward in ((figure.axes[0], 2), (figure.axes[2], 3)):
        assert axes.get_ylabel().endswith("[m]")
        assert axes.lines[0].get_ydata()[-1] == pytest.approx(0.1 * upward)


@pytest.mark.parametrize(
    ("draw", "more"), [(figures.force_position, (SPRING,)), (figures.path_views, ())]
)
def test_nothing_to_draw_is_refused(draw, more):
    with pytest.raises(ValueError, match="to draw"):
        draw([], *more)


ON_THE_MODULE = {
    "force_position": {"cycles": 1.0},
    "force_gain": {"gains": (0.0, 20.0), "resolution": 5.0, "duration": 4.0},
    "force_error": {"cases": ("small",)},
    "planar_error": {"cases": ("small",)},
    "planar_stability": {"stiffnesses": (1e5, 1e9), "gains": (0.0, 9.0)},
    "delivered_impedance": {"frequencies": (1.0, 8.0)},
    "compensation": {"cycles": 1.0},
    "robustness": {"cases": ("small",)},
    "planar_impedance": {"frequencies": (1.0, 4.0)},
    "back_drive": {},
    "requirements": {},
}
"""Experiments that formulas cannot stand in for, with settings for a short time. The others are
drawn by `test_kept_results.py` and `test_stability.py`; `calibration` writes a file."""


def test_every_experiment_is_drawn_by_a_test():
    assert {*EXPERIMENTS} == {*SETTINGS, *ON_THE_MODULE, "stability", "calibration"}


def test_the_others_draw_what_they_kept(tmp_path, bench):
    """From the files alone; each figure has a title, units, and something in it."""
    keep_calibration(tmp_path, bench.world)
    for name, short in ON_THE_MODULE.items():
        run, settings = EXPERIMENTS[name].run, EXPERIMENTS[name].settings()
        run(Lab(bench, tmp_path), settings._replace(**short)).save(tmp_path)
        drawn = EXPERIMENTS[name].draw(load_result(tmp_path, name))
        assert drawn, name
        for title, figure in drawn.items():
            assert figure.get_suptitle() or figure.axes[0].get_title("left"), (name, title)
            assert all(axes.has_data() or axes.patches for axes in figure.axes), (name, title)
            figure.dpi = 30
            figure.canvas.draw()
    assert figures.save(figure, tmp_path / "figure.png").stat().st_size > 5000
