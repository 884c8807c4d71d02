# SPDX-License-Identifier: Apache-2.0
"""The identity of a calibration changes with its bytes; for malformed ones see the other tests."""

from screw_module_ros.calibration.yaml_file import calibration_identity


def test_identity_names_the_file_and_follows_its_content(tmp_path):
    path = tmp_path / "friction.yaml"
    path.write_text("a: 1")
    first = calibration_identity(path)
    path.write_text("a: 2")
    assert first.startswith("friction.yaml sha256:")
    assert calibration_identity(path) != first
