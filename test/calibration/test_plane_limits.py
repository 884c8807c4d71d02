# SPDX-License-Identifier: Apache-2.0
"""Gain limits of a plane: read as they were written, refused otherwise, and kept to by `manus`."""

from __future__ import annotations

import pytest
import yaml

from screw_module_ros.calibration.limits_file import text_checksum
from screw_module_ros.calibration.plane_limits import FORMAT, VERSION, load_plane_limits
from screw_module_ros.calibration.plane_version import plane_law_version
from screw_module_ros.control.laws.plane_impedance import PLANE_IMPEDANCE
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.settings import SettingError

SERIAL = "ARM-0007"
LAW = PlanarSettings()


def written(folder, **changes):
    """Return the path of a good file, with changes that its checksum covers."""
    content = {
        "format": FORMAT, "version": VERSION, "serial": SERIAL, "date": "2026-11-28T09:30:00Z",
        "software": "0.2.0", "law": plane_law_version(PLANE_IMPEDANCE), "rate": 500.0,
        "force_cutoff": 7.0, "found_by": "sweep", "first_mode_Hz": 71.5,
        "largest_gains_on": {"hand": 5.5, "any_arm": 1.36}, **changes,
    }  # fmt: skip
    text = yaml.safe_dump(content, sort_keys=False)
    path = folder / "plane_gain_limits.yaml"
    path.write_text(f"{text}sha256: {text_checksum(text)}\n")
    return path


def test_the_smallest_gain_limits(tmp_path):
    limits = load_plane_limits(written(tmp_path), SERIAL)
    assert limits.largest == 1.36
    assert limits.refusal(LAW._replace(force_gain=1.36), 500.0) == ""
    assert "1.36 at most" in limits.refusal(LAW._replace(force_gain=1.37), 500.0)


@pytest.mark.parametrize(
    ("gain", "rate", "cutoff", "refused"),
    [(1.0, 1000.0, 5.0, False), (1.0, 250.0, 7.0, True), (1.0, 500.0, 9.0, True),
     (0.0, 250.0, 9.0, False)],
)  # fmt: skip
def test_a_slower_loop_or_a_faster_filter_costs_margin(tmp_path, gain, rate, cutoff, refused):
    """Without a gain nothing has to bear one."""
    limits = load_plane_limits(written(tmp_path), SERIAL)
    law = LAW._replace(force_gain=gain, force_cutoff=cutoff)
    assert ("500 Hz at least and 7 Hz at most" in limits.refusal(law, rate)) == refused


@pytest.mark.parametrize(
    ("changes", "serial", "told"),
    [
        ({}, "ARM-0008", "belongs to module 'ARM-0007'"),
        ({}, "", "set module_serial"),
        ({"law": "0123456789ab"}, SERIAL, "found for version 0123456789ab"),
        ({"largest_gains_on": {"hand": -1.0}}, SERIAL, "largest_gains_on.hand: 0 or more"),
        ({"largest_gains_on": {}}, SERIAL, "at least one"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(tmp_path, changes, serial, told):
    with pytest.raises(SettingError, match=told):
        load_plane_limits(written(tmp_path, **changes), serial)


def test_a_file_that_was_changed_is_refused(tmp_path):
    path = written(tmp_path)
    path.write_text(path.read_text().replace("1.36", "9.36"))
    with pytest.raises(SettingError, match="was changed after it was written"):
        load_plane_limits(path, SERIAL)
