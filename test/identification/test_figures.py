# SPDX-License-Identifier: Apache-2.0
"""One look at the figures of every experiment."""

import pytest
from formula_stand import keep_calibration
from test_kept_results import SETTINGS

from screw_module_ros.identification import figures
from screw_module_ros.identification.experiments import EXPERIMENTS
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.results import load_result

ON_THE_MODULE = {
    "force_position": {"cycles": 1.0},
    "force_gain": {"gains": (0.0, 20.0), "resolution": 5.0, "duration": 4.0},
    "force_error": {"cases": ("small",)},
    "planar_stability": {"seconds": 20.0},
    "delivered_impedance": {"frequencies": (1.0, 8.0)},
    "compensation": {"cycles": 1.0},
    "robustness": {"cases": ("small",)},
    "planar_impedance": {"frequencies": (1.0, 4.0)},
    "requirements": {},
}
"""Experiments that formulas cannot stand in for, with settings for a short time. The others are
drawn by `test_kept_results.py` and `test_stability.py`; `calibration` writes a file."""


def test_every_experiment_is_drawn_by_a_test():
    assert {*EXPERIMENTS} == {*SETTINGS, *ON_THE_MODULE, "stability", "calibration"}


@pytest.mark.long
def test_the_others_draw_what_they_kept(tmp_path, stand):
    """From the files alone; each figure has a title, units, and something in it."""
    keep_calibration(tmp_path, stand.world)
    for name, short in ON_THE_MODULE.items():
        run, settings = EXPERIMENTS[name].run, EXPERIMENTS[name].settings()
        run(Lab(stand, tmp_path), settings._replace(**short)).save(tmp_path)
        drawn = EXPERIMENTS[name].draw(load_result(tmp_path, name))
        assert drawn, name
        for title, figure in drawn.items():
            assert figure.get_suptitle() or figure.axes[0].get_title("left"), (name, title)
            assert all(axes.has_data() or axes.patches for axes in figure.axes), (name, title)
            figure.dpi = 30
            figure.canvas.draw()
    assert figures.save(figure, tmp_path / "figure.png").stat().st_size > 5000
