# SPDX-License-Identifier: Apache-2.0
"""Friction and linearization as files of their own: read as written, and refused by key."""

import re
from pathlib import Path

import pytest

from screw_module_ros.calibration.module import load_friction_model, load_linearization
from screw_module_ros.calibration.selection import file_identity
from screw_module_ros.control.linearization import default_linearization, torque_command
from screw_module_ros.settings import SettingError

FRICTION = re.sub(  # without comments, so that lines can be replaced together
    r" *#.*", "", (Path(__file__).parents[2] / "params" / "friction_thesis.yaml").read_text()
)
LINEARIZATION = """
format: screw_module_ros/linearization
version: 1
joints_Nm: [-0.025, 0.025]
lower: {slope: 1.0, offset_Nm: -0.025}
middle: [-880.0, 0.0, 2.55, 0.0]
upper: {slope: 1.0, offset_Nm: 0.025}
"""


def refusal(load, path, text, old, new) -> str:
    """Return the sentence with which a file is refused after a replacement."""
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(SettingError) as caught:
        load(path)
    told = str(caught.value)
    assert told.startswith(str(path))
    assert "\n" not in told
    return told


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("high_mm: 355.0", "", "high_mm is missing"),
        ("high_mm: 355.0", "high_mm: tall", "high_mm = 'tall': a finite number is wanted"),
        ("high_mm: 355.0", "high_mm: .nan", "high_mm = nan: a finite"),
        ("high_mm: 355.0", "high_mm: .inf", "high_mm = inf: a finite"),
        ("high_mm: 355.0", "high_mm: true", "high_mm = True: a finite"),
        ("high_mm: 355.0", "high_mm: 1e2", "write 1.0e-4, not 1e-4"),
        ("high_mm: 355.0", "high_mm: -5.0", "high_mm: -5 is not above low_mm"),
        ("high_mm: 355.0", "high_mm: 355.0\nhigh_mm: 300.0", "'high_mm' is written twice in line"),
        ("lead_mm: 19.05", "lead_mm: 0.0", "lead_mm = 0.0 mm: below the smallest allowed, 0.1 mm"),
        ("ramp_speed_mm_s: 2.0", "ramp_speed_mm_s: 0.0", "ramp_speed_mm_s = 0.0 mm/s: below"),
        ("ramp_speed_mm_s: 2.0", "ramp_speed_mm_s: 1500.0", "ramp_speed_mm_s: 1500 is above fast"),
        ("13.6820]", "]", "up.trend = "),
        ("13.6820]", ".nan]", "up.trend[7] = nan"),
        ("13.6820]", "1368.2]", "up: 1.14e+03 N of friction"),
        ("-0.0038]", "-0.0038, 1.0]", "a list of 6 is wanted"),
        # 200 N at 140 mm/s, where neither the slowest nor the fastest speed shows it
        ("break_speed_mm_s: 2.5\n  low_gain: 0.754\n  low_exponent: 0.15",
         "break_speed_mm_s: 140.0\n  low_gain: 0.001\n  low_exponent: 2.0", "and 0.140 m/s"),
        ("high_slope: 0.00296\n  high_offset: 0.857", "high_slope: -0.06\n  high_offset: 10.0",
         "and 0.003 m/s"),
        ("gravity_N: 10.0", "gravity_N: 10.0\ncolour: red", "colour is unknown; known are low_mm"),
        ("low_gain: 0.754", "low_gain: 0.754\n  extra: 1", "up.extra is unknown"),
        ("up:", "up: 3\nupward:", "upward is unknown"),
        ("version: 1", "version: 2", "version = 2"),
        ("screw_module_ros/friction", "screw_module_ros/linearization", "format = "),
    ],
)
def test_a_wrong_friction_file_is_refused_by_key(tmp_path, old, new, named):
    told = refusal(load_friction_model, tmp_path / "friction.yaml", FRICTION, old, new)
    assert named in told


def test_a_linearization_file_gives_the_default_map(tmp_path):
    path = tmp_path / "amplifier.yaml"
    path.write_text(LINEARIZATION)
    loaded = load_linearization(path)
    for torque in (-1.0, -0.02, 0.0, 0.01, 0.5):
        wanted = torque_command(default_linearization(), torque)
        assert torque_command(loaded, torque) == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("middle: [-880.0, 0.0, 2.55, 0.0]", "middle: [1.0, 2.0]", "middle = [1.0, 2.0]: a list"),
        ("offset_Nm: 0.025", "offset_Nm: 0.1", "upper.offset_Nm"),
        ("joints_Nm", "joints", "joints is unknown"),
        ("slope: 1.0, offset_Nm: -0.025", "slope: steep, offset_Nm: -0.025", "lower.slope = 'ste"),
    ],
)
def test_a_wrong_linearization_file_is_refused_by_key(tmp_path, old, new, named):
    told = refusal(load_linearization, tmp_path / "amplifier.yaml", LINEARIZATION, old, new)
    assert named in told


def test_identity_names_the_file_and_follows_its_content(tmp_path):
    path = tmp_path / "friction.yaml"
    path.write_text("a: 1")
    first = file_identity(path)
    path.write_text("a: 2")
    assert first.startswith("friction.yaml sha256:")
    assert file_identity(path) != first
