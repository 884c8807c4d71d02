# SPDX-License-Identifier: Apache-2.0
"""Nothing that stands in the folder of the results is overwritten, or written through a link."""

import pytest
from screw_module_msgs.action import RunExperiment

from screw_module_ros.identification.live.characterize import _checked


@pytest.mark.parametrize(
    ("experiment", "file"),
    [("delivered_impedance", "module_certificate.yaml"), ("calibration", "module_calibration.yaml"),
     ("gravity", "gravity.npz")],
)  # fmt: skip
def test_what_is_there_stays(tmp_path, experiment, file):
    """The certificate that a controller runs with was replaced, also through a link out of here."""
    (tmp_path / file).symlink_to("/nonexistent")
    with pytest.raises(ValueError, match=f"{file} exists already and is never overwritten"):
        _checked(RunExperiment.Goal(experiment=experiment, folder="."), tmp_path)
