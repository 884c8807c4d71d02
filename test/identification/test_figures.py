# SPDX-License-Identifier: Apache-2.0
"""Shared figures, and one look at those of every experiment."""

import io

import numpy as np
import pytest
from friction_bench import FakeBench
from test_kept_results import SETTINGS

from screw_module_ros.identification import figures
from screw_module_ros.identification.experiments import EXPERIMENTS
from screw_module_ros.identification.figures import Path3D, Trace
from screw_module_ros.identification.force_metric import Spring
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.results import load_result

SPRING = Spring(100.0, 0.18)
ON_THE_MODULE = [
    name for name in EXPERIMENTS if name not in {*SETTINGS, "stability", "calibration"}
]
"""Experiments that formulas cannot stand in for. `test_kept_results.py` and `test_stability.py`
draw the others, and `calibration` writes a file."""


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


def test_paths_are_seen_from_above_and_from_the_front():
    way = np.linspace(0.0, 0.1, 50)
    points = np.column_stack([way, 2.0 * way, 3.0 * way])
    figure = figures.path_views([Path3D("one", points), Path3D("two", -points)],
                                targets=np.array([[0.1, 0.0], [0.0, 0.1]]))  # fmt: skip
    figure.savefig(io.BytesIO())  # shared axes show only here what they cannot do together
    titles = [axes.get_title("left") for axes in figure.axes]
    assert titles[:2] == ["one", "two"], "no path is drawn over another"
    above, _, front, _ = figure.axes
    for axes, upward in ((above, 2), (front, 3)):
        assert axes.get_ylabel().endswith("[m]")
        assert axes.lines[0].get_ydata()[-1] == pytest.approx(0.1 * upward)


@pytest.mark.parametrize(
    "draw", [lambda: figures.force_position([], SPRING), lambda: figures.path_views([])]
)
def test_nothing_to_draw_is_refused(draw):
    with pytest.raises(ValueError, match="to draw"):
        draw()


@pytest.fixture(scope="module")
def kept(tmp_path_factory, bench):
    """Results of these experiments for a short time, and of what they need."""
    folder = tmp_path_factory.mktemp("kept")
    formulas, simulated = Lab(FakeBench(), folder), Lab(bench, folder)
    speeds = (0.005, 0.010, 0.020, 0.030, 0.050, 0.100, 0.150)
    changes = {
        "static_torque": (simulated, {}),
        "friction_map": (formulas, {"speeds": speeds, "inverted_speeds": speeds[::3]}),
        "force_position": (simulated, {"cycles": 1.0}),
        "force_gain": (simulated, {"gains": (0.0, 20.0), "resolution": 5.0, "duration": 4.0}),
        "force_error": (simulated, {"cases": ("small",)}),
        "planar_error": (simulated, {"cases": ("small",)}),
        "delivered_impedance": (simulated, {"frequencies": (1.0, 8.0)}),
        "compensation": (simulated, {"cycles": 1.0}),
        "robustness": (simulated, {"cases": ("small",)}),
    }
    results = {}
    wanted = {need for name in ON_THE_MODULE for need in EXPERIMENTS[name].needs} | {"friction_map"}
    wanted.remove("stability")  # without it a certificate permits no gain
    for experiment in EXPERIMENTS.values():
        if experiment.name in wanted.union(ON_THE_MODULE):
            lab, settings = changes.get(experiment.name, (formulas, {}))
            result = experiment.run(lab, experiment.settings()._replace(**settings))
            result.save(folder)
            results[experiment.name] = load_result(folder, experiment.name)
    return results


def test_they_draw_what_they_kept(kept, tmp_path):
    """From the files alone; each figure has a title, units, and something in it."""
    for name in ON_THE_MODULE:
        result = kept[name]
        drawn = EXPERIMENTS[name].draw(result)
        assert drawn, name
        for title, figure in drawn.items():
            assert figure.get_suptitle() or figure.axes[0].get_title("left"), (name, title)
            for axes in figure.axes:
                assert axes.has_data() or axes.patches, (name, title)
            file = figures.save(figure, tmp_path / f"{name}-{title.replace(' ', '_')}.png")
            assert file.stat().st_size > 5000, (name, title)
