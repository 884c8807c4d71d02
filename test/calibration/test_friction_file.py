# SPDX-License-Identifier: Apache-2.0
"""Friction files, and whatever else somebody may name as one: refused by key, with a way out."""

import os
from pathlib import Path

import pytest

from screw_module_ros.calibration.friction_file import FrictionFileError, load_friction_model

FILE = Path(__file__).parents[2] / "params" / "friction_thesis.yaml"


def changed(tmp_path, old, new):
    text = FILE.read_text()
    assert old in text
    path = tmp_path / "friction.yaml"
    path.write_text(text.replace(old, new, 1))
    return path


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("high_mm: 355.0", "", "high_mm: missing"),
        ("high_mm: 355.0", "high_mm: tall", "high_mm: a number is needed"),
        ("high_mm: 355.0", "high_mm: .nan", "high_mm: nan is not a finite"),
        ("high_mm: 355.0", "high_mm: .inf", "high_mm: inf is not a finite"),
        ("high_mm: 355.0", "high_mm: true", "high_mm: a number is needed"),
        ("high_mm: 355.0", "high_mm: 1e2", "decimal point"),
        ("high_mm: 355.0", "high_mm: -5.0", "high_mm: -5 is not above low_mm"),
        ("high_mm: 355.0", "high_mm: 355.0\nhigh_mm: 300.0", "written twice"),
        ("lead_mm: 19.05", "lead_mm: 0.0", "lead_mm: 0 is outside"),
        ("ramp_speed_mm_s: 2.0", "ramp_speed_mm_s: 0.0", "ramp_speed_mm_s: 0 is outside"),
        ("13.6820]", "]", "up.trend: 7 numbers found, 8"),
        ("13.6820]", ".nan]", r"up.trend\[7\]: nan"),
        ("13.6820]", "1368.2]", "up: .* N of friction"),
        ("-0.0038]", "-0.0038, 1.0]", "down.ripple: 7 numbers found, 6"),
        # 200 N at 140 mm/s, where neither the slowest nor the fastest speed shows it
        ("break_speed_mm_s: 2.5\n  low_gain: 0.754\n  low_exponent: 0.15",
         "break_speed_mm_s: 140.0\n  low_gain: 0.001\n  low_exponent: 2.0",
         "up: .* N of friction at .* 0.140 m/s"),
        ("high_slope: 0.00296\n  high_offset: 0.857", "high_slope: -0.06\n  high_offset: 10.0",
         "up: .* N of friction at .* 0.003 m/s"),
        ("gravity_N: 10.0", "gravity_N: 10.0\ncolour: red", "colour: unknown key"),
        ("low_gain: 0.754", "low_gain: 0.754\n  extra: 1", "up.extra: unknown key"),
        ("up:", "up: 3\nupward:", "up: a mapping is needed"),
        ("version: 1", "version: 2", "version: 2 is not known"),
        ("screw_module_ros/friction", "screw_module_ros/linearization", "format: "),
        ("version: 1", "version: [", "not a YAML file"),
        ("version: 1", "version: 2001-99-99", "not a YAML file"),
        ("high_mm: 355.0", "high_mm: 1.0e+400", "high_mm: inf is not a finite"),
        ("high_mm: 355.0", "high_mm: 1" + "0" * 399, "high_mm: an integer of 1326 bits is not"),
        ("high_mm: 355.0", "high_mm: 1" + "0" * 9999, "high_mm: a number of 10000 characters"),
        ("high_mm: 355.0", "high_mm: !!python/name:os.system ''", "high_mm: tag .*os.system"),
        ("low_gain: 0.754", "low_gain: !!python/tuple [1]", "up.low_gain: tag"),
        ("high_mm: 355.0", "high_mm: [" + "[1, 2], " * 9999 + "]", "high_mm: a number is needed"),
        ("high_mm: 355.0", f"high_mm: {'x' * 9999}", "high_mm: a number is needed"),
        ("high_mm: 355.0", f"high_mm: 1.0\n{'k' * 999}: 1", "unknown key"),
    ],
)
def test_a_malformed_file_is_refused_by_key(tmp_path, old, new, named):
    path = changed(tmp_path, old, new)
    with pytest.raises(FrictionFileError, match=named) as caught:
        load_friction_model(path)
    assert str(caught.value).startswith(str(path))
    assert ";" in str(caught.value), "the way out is missing"


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (b"", "a YAML mapping is needed"),
        (b"- 1\n- 2\n", "a YAML mapping is needed"),
        (b"\xff\xfe\x00", "not a YAML file"),
        (b"[" * 20_000, "not a YAML file"),
        (b"# " + b"x" * 1_000_001, "larger than"),
    ],
)
def test_something_else_than_a_calibration_is_refused(tmp_path, content, named):
    path = tmp_path / "friction.yaml"
    path.write_bytes(content)
    with pytest.raises(FrictionFileError, match=named):
        load_friction_model(path)


def test_an_absent_file_and_a_folder_are_refused(tmp_path):
    with pytest.raises(FrictionFileError, match="cannot be read"):
        load_friction_model(tmp_path / "nothing.yaml")
    with pytest.raises(FrictionFileError, match="cannot be read"):
        load_friction_model(tmp_path)


BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{after}: &{after} [{', '.join([f'*{name}'] * 9)}]\n"
    for name, after in zip("abcdefg", "bcdefgh", strict=True)
)


@pytest.mark.timeout(20)
def test_a_few_bytes_that_stand_for_gigabytes_are_refused_at_once(tmp_path):
    path = changed(tmp_path, "high_mm: 355.0", f"{BOMB}high_mm: *h")
    with pytest.raises(FrictionFileError, match=r"alias \*a") as caught:
        load_friction_model(path)
    assert len(str(caught.value)) < 400


@pytest.mark.timeout(20)
def test_devices_and_fifos_are_refused_unread(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    for path in ("/dev/zero", tmp_path / "fifo"):
        with pytest.raises(FrictionFileError, match="cannot be read.*FIFO or device"):
            load_friction_model(path)
