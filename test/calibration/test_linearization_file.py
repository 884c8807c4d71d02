# SPDX-License-Identifier: Apache-2.0
"""A linearization's file: the default map as the thesis gives it, and broken ones."""

import pytest

from screw_module_ros.calibration.linearization_file import (
    LinearizationFileError,
    load_linearization,
)
from screw_module_ros.control.linearization import default_linearization, torque_command

DEFAULT = default_linearization()

GOOD = """
format: screw_module_ros/linearization
version: 1
joints_Nm: [-0.025, 0.025]
lower: {slope: 1.0, offset_Nm: -0.025}
middle: [-880.0, 0.0, 2.55, 0.0]
upper: {slope: 1.0, offset_Nm: 0.025}
"""


def test_file_gives_the_default_map(tmp_path):
    path = tmp_path / "amplifier.yaml"
    path.write_text(GOOD)
    loaded = load_linearization(path)
    for torque in (-1.0, -0.02, 0.0, 0.01, 0.5):
        assert torque_command(loaded, torque) == pytest.approx(torque_command(DEFAULT, torque))


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("middle: [-880.0, 0.0, 2.55, 0.0]", "middle: [1.0, 2.0]", "middle: 2 numbers"),
        ("offset_Nm: 0.025", "offset_Nm: 0.1", "upper.offset_Nm"),
        ("joints_Nm", "joints", "joints_Nm: missing"),
        ("slope: 1.0, offset_Nm: -0.025", "slope: steep, offset_Nm: -0.025", "lower.slope"),
    ],
)
def test_a_broken_file_is_refused_by_key(tmp_path, old, new, named):
    path = tmp_path / "amplifier.yaml"
    assert old in GOOD
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(LinearizationFileError, match=named) as caught:
        load_linearization(path)
    assert str(path) in str(caught.value)
