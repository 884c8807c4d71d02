# SPDX-License-Identifier: Apache-2.0
"""Line / cubic / line is continuous, rises everywhere, and undoes a dead zone (thesis 4.1.1)."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.control.linearization import (
    IDENTITY,
    Line,
    Linearization,
    default_linearization,
    torque_command,
)
from screw_module_ros.settings import validated

DEFAULT = default_linearization()
torques = st.floats(-1.6, 1.6)


def dead_zone(command, width=0.025):
    """An amplifier that swallows the first `width` of a command."""
    return math.copysign(max(0.0, abs(command) - width), command)


@given(torques)
def test_exact_outside_the_cubic_and_within_its_width_inside(torque):
    error = dead_zone(torque_command(DEFAULT, torque)) - torque
    assert abs(error) <= (1e-12 if abs(torque) > 0.025 else 0.0105)


def test_correlation_after_the_fix_is_the_thesis_figure():
    wanted = [1.6 * k / 500 for k in range(-500, 501)]
    made = [dead_zone(torque_command(DEFAULT, torque)) for torque in wanted]
    correlation = sum(w * m for w, m in zip(wanted, made, strict=True)) / math.sqrt(
        sum(w * w for w in wanted) * sum(m * m for m in made)
    )
    assert correlation > 0.99996


@pytest.mark.parametrize("joint", DEFAULT.joints_Nm)
def test_continuous_at_the_joints_with_a_tenth_of_slope_step(joint):
    step = 1e-7
    below, at, above = (torque_command(DEFAULT, joint + d) for d in (-step, 0.0, step))
    assert above - below < 1e-6
    slopes = (at - below) / step, (above - at) / step
    assert min(slopes) / max(slopes) == pytest.approx(0.9, abs=1e-3)


@given(torques, torques)
def test_more_torque_never_needs_less_command(one, other):
    low, high = sorted((one, other))
    assert torque_command(DEFAULT, low) <= torque_command(DEFAULT, high)


@given(torques)
def test_identity_changes_nothing(torque):
    assert torque_command(IDENTITY, torque) == pytest.approx(torque)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"joints_Nm": (-0.025, -0.03)}, "joints_Nm"),
        ({"joints_Nm": (-0.025, math.nan)}, r"joints_Nm\[1\] = nan"),
        ({"lower": Line(0.0, -0.025)}, "lower.slope = 0.0: below"),
        ({"upper": Line(math.inf, 0.025)}, "upper.slope"),
        ({"middle": (-3000.0, 0.0, 2.55, 0.0)}, "middle"),
        ({"middle": (8000.0, 0.0, -2.5, 0.0)}, "middle"),  # falls between rising ends
        ({"middle": (math.nan, 0.0, 2.55, 0.0)}, r"middle\[0\]"),
        ({"lower": Line(1.0, 0.0)}, "lower.offset_Nm"),
        ({"upper": Line(1.0, math.nan)}, "upper.offset_Nm"),
    ],
)
def test_a_broken_map_is_refused_by_field(change, named):
    with pytest.raises(ValueError, match=named):
        validated(DEFAULT._replace(**change))


def lifted(offset):
    """The default map, every command `offset` [Nm] higher."""
    joints, lower, (c3, c2, c1, c0), upper = DEFAULT
    return Linearization(
        joints,
        Line(1.0, lower.offset_Nm + offset),
        (c3, c2, c1, c0 + offset),
        Line(1.0, upper.offset_Nm + offset),
    )


def zone(width, joint):
    """A map that compensates this dead zone [Nm], with joints at +-joint [Nm]."""
    edge = joint + width
    cubic = ((0.9 * joint - edge) / (2.0 * joint**3), 0.0, (3.0 * edge / joint - 0.9) / 2.0, 0.0)
    return Linearization((-joint, joint), Line(1.0, -width), cubic, Line(1.0, width))


def tilted(slope):
    """The default map with another slope of its lines, continuous at the joints."""
    offset = DEFAULT.upper.offset_Nm + (1.0 - slope) * DEFAULT.joints_Nm[1]
    return DEFAULT._replace(lower=Line(slope, -offset), upper=Line(slope, offset))


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (lifted(5.0), "makes the command .* more than 0.1 Nm apart"),
        (lifted(-0.09), "lower: .* more than 0.1 Nm apart"),
        (tilted(1.2), "lower: .*-1.03 Nm for a torque of -0.84 Nm"),
        (zone(0.07, 0.01), "upper.offset_Nm: a dead zone of 0.07 Nm, more than 0.05 Nm"),
        (zone(0.025, 1e-4), "joints_Nm: 0.0001 Nm is less than 8 mNm above"),
    ],
)
def test_a_command_far_from_its_torque_is_refused(other, told):
    """Continuous and rising, and yet the first command would be a blow, or swing for ever."""
    with pytest.raises(ValueError, match=told):
        validated(other)


@pytest.mark.parametrize(
    "other", [lifted(0.07), lifted(-0.07), tilted(1.08), tilted(0.9), zone(0.05, 0.004)]
)
def test_a_map_that_some_amplifier_needs_is_taken(other):
    assert validated(other) is other
