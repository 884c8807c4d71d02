# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from screw_module_ros.identification import figures
from screw_module_ros.identification.figures.force_position import Path3D, Trace
from screw_module_ros.identification.force_position import Spring

SPRING = Spring(100.0, 0.18)


def loop(name: str, beyond: float, samples: int = 20_000) -> Trace:
    angle = np.linspace(0.0, 4.0 * np.pi, samples)
    position = 0.18 + 0.1 * np.sin(angle)
    velocity = 0.08 * np.cos(angle)
    return Trace(name, position, velocity, 100 * (position - 0.18) + beyond * np.sign(velocity))


def words(axes) -> set[str]:
    return {text.get_text() for text in axes.get_legend().get_texts()}


def test_force_position_names_every_line_and_its_units():
    axes = figures.force_position([loop("plain", 10.0), loop("better", 2.0)], SPRING).axes[0]
    assert words(axes) == {"plain", "better", "desired: 100 N/m about 0.18 m"}
    assert axes.get_xlabel().endswith("[m]")
    assert axes.get_ylabel().endswith("[N]")


def test_the_desired_spring_goes_through_its_centre_and_is_dotted():
    axes = figures.force_position([loop("plain", 10.0)], SPRING).axes[0]
    (line,) = [line for line in axes.lines if line.get_label().startswith("desired")]
    position, force = line.get_data()
    assert force == pytest.approx(100.0 * (position - 0.18))
    assert line.get_linestyle() == "--"
    assert line.get_linewidth() > 2 * axes.lines[0].get_linewidth()


def test_arrows_point_the_way_the_handle_goes():
    axes = figures.force_position([loop("plain", 10.0)], SPRING).axes[0]
    arrows = [text for text in axes.texts if hasattr(text, "arrow_patch")]
    assert len(arrows) >= 2
    for arrow in arrows:
        upward = arrow.xy[0] > arrow.xyann[0]
        above = arrow.xy[1] > 100.0 * (arrow.xy[0] - 0.18)
        assert upward == above  # friction: the patient pushes more on the way up


def test_long_records_are_thinned():
    axes = figures.force_position([loop("plain", 10.0, 200_000)], SPRING).axes[0]
    assert len(axes.lines[0].get_xdata()) < 10_000


def test_a_handle_at_rest_can_be_drawn():
    still = Trace("still", np.full(50, 0.18), np.zeros(50), np.zeros(50))
    figures.force_position([still], SPRING)


def test_paths_are_seen_from_above_and_from_the_front():
    way = np.linspace(0.0, 0.1, 50)
    points = np.column_stack([way, 2.0 * way, 3.0 * way])
    figure = figures.path_views([Path3D("all", points)], targets=np.array([[0.1, 0.0], [0.0, 0.1]]))
    above, front = figure.axes
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["targets", "all"]
    for axes, upward in ((above, 2), (front, 3)):
        assert axes.get_xlabel().endswith("[m]")
        assert axes.get_ylabel().endswith("[m]")
        assert axes.lines[0].get_ydata()[-1] == pytest.approx(0.1 * upward)


@pytest.mark.parametrize(
    "draw", [lambda: figures.force_position([], SPRING), lambda: figures.path_views([])]
)
def test_nothing_to_draw_is_refused(draw):
    with pytest.raises(ValueError, match="to draw"):
        draw()


def test_saved_as_png(tmp_path):
    file = figures.save(figures.force_position([loop("plain", 1.0)], SPRING), tmp_path / "a.png")
    assert file.read_bytes().startswith(b"\x89PNG")


def test_an_unwritable_place_is_an_os_error(tmp_path):
    with pytest.raises(OSError, match="nowhere"):
        figures.save(figures.force_position([loop("p", 1.0)], SPRING), tmp_path / "nowhere/a.png")
