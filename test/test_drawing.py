# SPDX-License-Identifier: Apache-2.0
"""Figures of the handle: force over height with the desired spring, and paths."""

import io

import numpy as np
import pytest

from screw_module_ros.drawing import Path3D, Trace, force_position, path_views
from screw_module_ros.offset import Spring

SPRING = Spring(100.0, 0.18)


def loop(name: str, beyond: float) -> Trace:
    angle = np.linspace(0.0, 4.0 * np.pi, 20_000)
    position = 0.18 + 0.1 * np.sin(angle)
    velocity = 0.08 * np.cos(angle)
    return Trace(name, position, velocity, 100 * (position - 0.18) + beyond * np.sign(velocity))


def test_force_position_curves_with_the_desired_spring():
    traces = [loop("plain", 10.0), loop("better", 2.0)]
    axes = force_position(traces, SPRING).axes[0]
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
    figure = path_views([Path3D("one", points, visited), Path3D("two", -points)])
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
    ("draw", "more"), [(force_position, (SPRING,)), (path_views, ())]
)
def test_nothing_to_draw_is_refused(draw, more):
    with pytest.raises(ValueError, match="to draw"):
        draw([], *more)
