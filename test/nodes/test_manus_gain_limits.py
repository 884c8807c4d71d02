# SPDX-License-Identifier: Apache-2.0
"""`manus` keeps to the gain limits of its plane, and wants them where it feeds the force back."""

from __future__ import annotations

import pytest
import yaml

from screw_module_ros.calibration.limits_file import text_checksum
from screw_module_ros.calibration.plane_limits import FORMAT, VERSION
from screw_module_ros.calibration.plane_version import plane_law_version
from screw_module_ros.control.laws.plane_impedance import PLANE_IMPEDANCE
from screw_module_ros.settings import SettingError


@pytest.fixture
def limited(make_node, tmp_path):
    """Return a function that makes a node with gain limits of 1.36."""
    content = {
        "format": FORMAT, "version": VERSION, "serial": "ARM-0007", "date": "2026-11-28T09:30:00Z",
        "software": "0.2.0", "law": plane_law_version(PLANE_IMPEDANCE), "rate": 500.0,
        "force_cutoff": 7.0, "found_by": "sweep", "first_mode_Hz": 71.5,
        "largest_gains_on": {"hand": 5.5, "any_arm": 1.36},
    }  # fmt: skip
    text = yaml.safe_dump(content, sort_keys=False)
    path = tmp_path / "plane_gain_limits.yaml"
    path.write_text(f"{text}sha256: {text_checksum(text)}\n")

    def made(**values):
        given = {"gain_limits_file": path, "module_serial": "ARM-0007", "rate": 500.0, **values}
        return make_node(
            "manus", *(word for key, value in given.items() for word in ("-p", f"{key}:={value}"))
        )

    return made


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"force_gain": 2.0}, "force_gain is 2, and the limits are 1.36 at most"),
        ({"force_gain": 1.0, "rate": 250.0}, "are for 500 Hz at least"),
        ({"force_gain": 1.0, "gain_limits_file": '""'}, "no gain limits of this plane are known"),
        ({"module_serial": "ARM-0008"}, "belongs to module 'ARM-0007'"),
    ],
)
def test_a_gain_that_the_plane_does_not_bear_is_refused_at_the_start(limited, values, told):
    with pytest.raises(SettingError, match=told):
        limited(**values).connect()


@pytest.mark.parametrize(
    "values",
    [{"force_gain": 1.36}, {"force_gain": 9.0, "beyond_gain_limits": True},
     {"force_gain": 9.0, "gain_limits_file": '""', "gain_limits_required": False}, {}],
)  # fmt: skip
def test_a_gain_within_them_or_on_the_operator_s_word_is_taken(limited, values, monkeypatch):
    """The node goes on to its drives, of which there is none here."""
    node = limited(**values)
    monkeypatch.setattr(node, "open_port", lambda *names: (_ for _ in ()).throw(LookupError))
    with pytest.raises(LookupError):
        node.connect()
