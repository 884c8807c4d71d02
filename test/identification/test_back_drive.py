# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from screw_module_ros.identification import back_drive
from screw_module_ros.identification.back_drive import Settings, Wedge, wedge
from screw_module_ros.identification.figures.analysis import back_drive_figures

DEFAULT = Settings()


@pytest.fixture(scope="module")
def result():
    return back_drive.run(None, DEFAULT)


@pytest.mark.parametrize("degrees", [10.0, 23.0, 40.0])
@pytest.mark.parametrize("friction", [0.015, 0.15])
def test_a_square_thread_is_a_block_on_a_slope(degrees, friction):
    slope, grip = math.radians(degrees), math.atan(friction)
    screw = Wedge(slope, 0.0, friction)
    assert screw.forward_efficiency() == pytest.approx(math.tan(slope) / math.tan(slope + grip))
    assert screw.back_efficiency() == pytest.approx(math.tan(slope - grip) / math.tan(slope))


def test_nothing_is_lost_without_friction():
    screw = wedge(DEFAULT, 0.0)
    assert screw.forward_efficiency() == pytest.approx(1.0)
    assert screw.back_efficiency() == pytest.approx(1.0)


def test_the_limits_are_where_the_efficiencies_vanish():
    screw = wedge(DEFAULT, 0.0)
    for way, limit in (
        ("back_efficiency", screw.back_limit),
        ("forward_efficiency", screw.forward_limit),
    ):
        assert getattr(screw._replace(friction=0.999 * limit), way)() > 0.0
        assert getattr(screw._replace(friction=1.001 * limit), way)() == 0.0


def test_a_screw_of_the_least_lead_just_turns(result):
    lead = result.value("least_lead_plastic")
    # The flank's angle across the thread depends on the lead: keep it, as the thread angle.
    steep = math.atan(lead / (math.pi * DEFAULT.diameter))
    screw = Wedge(steep, result.value("thread_angle"), DEFAULT.plastic)
    assert screw.back_limit == pytest.approx(DEFAULT.plastic)


def test_losses_are_the_papers_when_the_motor_drives(result):
    assert result.value("forward_loss_plastic") == pytest.approx(0.30, abs=0.03)
    assert result.value("forward_loss_roller") < 0.05
    assert result.value("forward_gain") == pytest.approx(0.40, abs=0.02)


def test_the_handle_loses_more_than_the_motor(result):
    assert result.value("back_loss_plastic") > result.value("forward_loss_plastic")
    assert result.value("back_loss_roller") < 0.05


def test_a_screw_that_sticks_loses_everything():
    result = back_drive.run(None, DEFAULT._replace(plastic=0.9))
    assert result.value("back_loss_plastic") == 1.0
    assert math.isinf(result.value("back_gain"))


def test_the_module_evens_the_plane_out(result):
    assert result.value("anisotropy_greatest_laden") < result.value("anisotropy_greatest")
    assert result.value("anisotropy_least_laden") < result.value("anisotropy_least")


def test_the_later_robots_arm_is_too_heavy_for_the_module():
    result = back_drive.run(None, DEFAULT._replace(plane="inmotion2"))
    assert result.value("anisotropy_greatest_laden") < result.value("anisotropy_greatest")
    assert result.value("anisotropy_least_laden") < result.value("anisotropy_least")
    assert result.value("major_axis_laden") > DEFAULT.heaviest
    assert any("100%" in note for note in result.notes)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"plane": "mine"}, "appendix_d"),
        ({"half_depth": 0.4}, "out of reach"),
        ({"lead": 0.0}, "lead"),
    ],
)
def test_settings_that_cannot_be_are_refused(change, said):
    with pytest.raises(ValueError, match=said):
        back_drive.run(None, DEFAULT._replace(**change))


def test_the_figure_draws_arm_module_and_limit_at_every_place(result):
    axes = back_drive_figures(result)["D-3"].axes[0]
    assert len(axes.patches) == 3 * len(result.data["shown_points"])
    assert axes.get_xlabel().endswith("[m]") and axes.get_ylabel().endswith("[m]")
