# SPDX-License-Identifier: Apache-2.0
"""A module's calibration file: what is written is read, and whatever is wrong is refused."""

import copy
import errno
import math
import re
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from screw_module_ros.calibration.module import (
    ModuleCalibration,
    SensorBias,
    load_module_calibration,
    thesis_friction,
    write_calibration,
)
from screw_module_ros.calibration.selection import (
    CalibrationSettings,
    chosen_calibration,
    chosen_friction,
)
from screw_module_ros.control.linearization import Line, default_linearization
from screw_module_ros.settings import SettingError

SERIAL = "SIM-0001"
FRICTION = thesis_friction()
STORED = Path(__file__).with_name("stored_by_0_1_0.yaml")
GOOD = ModuleCalibration(
    serial=SERIAL,
    date="2001-05-11T09:30:00Z",
    software="0.1.0",
    gravity_N=9.8,
    mass_kg=5.5,
    sensor_bias=SensorBias((0.1, -0.2, 0.3), (0.01, -0.02, 0.03)),
    residuals={
        "friction_rms_N": 0.8,
        "friction_within_2N": 0.93,
        "linearization_correlation": 0.99996,
        "gravity_sd_N": 0.25,
        "mass_sd_kg": 0.125,
        "backlash_mm": 0.1,
    },
    friction=FRICTION,
    linearization=default_linearization(),
)


@pytest.fixture
def path(tmp_path):
    """Return the path of a good file."""
    file = tmp_path / "module.yaml"
    write_calibration(file, GOOD)
    return file


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    """Return a path that many examples overwrite."""
    return tmp_path_factory.mktemp("calibrations") / "module.yaml"


def refusal(path, serial=SERIAL) -> str:
    """Return the sentence a file is refused with."""
    with pytest.raises(SettingError) as caught:
        load_module_calibration(path, serial)
    told = str(caught.value)
    assert told.startswith(str(path))
    assert "\n" not in told
    return told


def test_what_is_written_is_read(path):
    loaded = load_module_calibration(path, SERIAL)
    assert loaded._replace(checksum="") == GOOD
    assert re.fullmatch("[0-9a-f]{64}", loaded.checksum)


def test_a_file_of_an_earlier_version_is_read_and_written_alike(path):
    """Byte for byte, its checksum included: files that were stored in the field stay valid."""
    assert load_module_calibration(STORED, SERIAL)._replace(checksum="") == GOOD
    assert path.read_bytes() == STORED.read_bytes()


def test_a_measured_delay_is_kept_and_covered_by_the_checksum(path):
    delayed = GOOD._replace(delay_s=8.2e-4, drive_delay_s=2.2e-4)
    write_calibration(path, delayed)
    assert load_module_calibration(path, SERIAL)._replace(checksum="") == delayed
    path.write_text(path.read_text().replace("0.00082", "0.00083"))
    assert "was changed after it was written" in refusal(path)


def test_a_loop_that_is_slower_than_its_calibration_says_so(path):
    """From a latency now and the drive's own delay; one that is not known is compared with none."""
    write_calibration(path, GOOD._replace(delay_s=8.2e-4, drive_delay_s=2.2e-4))
    chosen = chosen_friction(CalibrationSettings(str(path), SERIAL), "")
    assert chosen.delay_flaw(0.6e-3) == chosen.delay_flaw(1.0e-3) == ""
    assert "comes after 2.22 ms, in the module's calibration after 0.82" in chosen.delay_flaw(2e-3)
    assert chosen.delay_flaw(0.0) == "", "no command was written in the last second"
    write_calibration(path, GOOD)
    assert chosen_friction(CalibrationSettings(str(path), SERIAL), "").delay_flaw(2e-3) == ""


def test_the_file_can_be_read_by_whom_any_other_file_can(path):
    plain = path.with_name("plain")
    plain.write_text("")
    assert path.stat().st_mode == plain.stat().st_mode


numbers = st.floats(-900.0, 900.0)
serials = st.text(st.characters(exclude_categories=["C", "Z"]), min_size=1, max_size=64)


@settings(max_examples=60)
@given(
    serial=serials,
    gravity=st.floats(6.0, 14.0),
    mass=st.floats(0.5, 50.0),
    forces=st.tuples(numbers, numbers, numbers),
    phase=st.floats(-1e4, 1e4),
    residual=st.floats(-9e299, 9e299),
)
def test_any_value_comes_back_to_the_last_bit(
    scratch, serial, gravity, mass, forces, phase, residual
):
    calibration = GOOD._replace(
        serial=serial,
        gravity_N=gravity,
        mass_kg=mass,
        sensor_bias=SensorBias(forces, (0.0, -0.0, 1e-30)),
        friction=FRICTION._replace(phase_rad=phase),
        residuals={"anything": residual},
    )
    written = write_calibration(scratch, calibration)
    assert load_module_calibration(scratch, serial) == written
    assert repr(written._replace(checksum="")) == repr(calibration)


def test_identity_names_module_date_checksum_and_file(path):
    loaded = load_module_calibration(path, SERIAL)
    short = loaded.checksum[:12]
    assert loaded.identity(path) == f"SIM-0001 2001-05-11T09:30:00Z sha256:{short} module.yaml"


# The checksum --------------------------------------------------------------------------------


def leaves(value, way=()):
    """Yield the way to every single value of a mapping."""
    if isinstance(value, (dict, list)):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(part, (*way, key))
    else:
        yield way


def altered(value):
    """Return the value next to this one."""
    if isinstance(value, float):
        return math.nextafter(value, 0.5)
    return value.replace("0", "1", 1)


def test_any_single_changed_value_is_noticed(path):
    values = yaml.safe_load(path.read_text())
    ways = [way for way in leaves(values) if way[0] not in ("format", "version")]
    assert len(ways) == 3 + 2 + 6 + 6 + 7 + 2 * 20 + 10 + 1
    for way in ways:
        changed = copy.deepcopy(values)
        *outer, last = way
        inner = changed
        for key in outer:
            inner = inner[key]
        assert inner[last] != altered(inner[last]), way
        inner[last] = altered(inner[last])
        path.write_text(yaml.safe_dump(changed))
        told = refusal(path, serial=changed["serial"])
        assert "checksum: the file was changed after it was written" in told, way
        assert "identify the module anew" in told


@pytest.mark.parametrize("flow", [True, False, None])
def test_another_layout_is_the_same_calibration(path, flow):
    loaded = load_module_calibration(path, SERIAL)
    values = yaml.safe_load(path.read_text())
    values["friction"]["high_mm"] = 355  # was 355.0
    text = yaml.safe_dump(values, default_flow_style=flow, indent=6, sort_keys=True)
    path.write_text("# kept by somebody\n---\n" + text.replace("mass_kg: 5.5", "mass_kg: 5.50e+0"))
    assert load_module_calibration(path, SERIAL) == loaded


# Refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("screw_module_ros/calibration", "screw_module_ros/friction", "format = .*friction"),
        ("version: 1", "version: 2", "version = 2"),
        ("version: 1", "version: [", "no YAML"),
        ("gravity_N: 9.8", "gravity_N: 9.8\ngravity_N: 9.9", "'gravity_N' is written twice"),
        ("gravity_N: 9.8", "gravitas_N: 9.8", "gravitas_N is unknown"),
        ("gravity_N: 9.8", "", "gravity_N is missing"),
        ("gravity_N: 9.8", "gravity_N: -51.0", "gravity_N = -51.0 N: below the smallest"),
        ("gravity_N: 9.8", "gravity_N: 50.1", "gravity_N = 50.1 N: above"),
        ("gravity_N: 9.8", "gravity_N: 20.0", "gravity_N = 20 N, but friction was fitted with"),
        ("gravity_N: 9.8", "gravity_N: .nan", "gravity_N = nan: a finite number"),
        ("gravity_N: 9.8", "gravity_N: heavy", "gravity_N = 'heavy': a finite number"),
        ("mass_kg: 5.5", "mass_kg: 0.4", "mass_kg = 0.4 kg: below the smallest allowed, 0.5"),
        ("mass_kg: 5.5", "mass_kg: 51.0", "mass_kg = 51.0 kg: above"),
        ("force_N: [0.1, ", "force_N: [", "sensor_bias.force_N = .*: a list of 3"),
        ("force_N: [0.1, ", "force_N: [1.0e+4, ", r"sensor_bias.force_N\[0\] = 10000.0 N: above"),
        ("torque_Nm: [0.01, ", "torque_Nm: [101.0, ", r"sensor_bias.torque_Nm\[0\] = 101.0 Nm"),
        ("0.99996", "0.89", "residuals.linearization_correlation = 0.89: 0.9 to 1"),
        ("0.99996", "1.1", "residuals.linearization_correlation = 1.1: 0.9 to 1"),
        ("_within_2N: 0.93", "_within_2N: 93.0", "residuals.friction_within_2N = 93.0: 0 to 1"),
        ("_rms_N: 0.8", "_rms_N: -0.8", "residuals.friction_rms_N = -0.8: 0 to 20"),
        ("_rms_N: 0.8", "_rms_N: .inf", "residuals.friction_rms_N = inf: a finite"),
        ("_rms_N: 0.8", "_rms_N: small", "residuals.friction_rms_N = 'small': a finite"),
        ("13.682]", "1368.2]", "friction.up: .* N of friction"),
        ("high_mm: 355.0", "high_mm: -1.0", "friction.high_mm: -1 is not above"),
        ("lead_mm: 19.05", "", "friction.lead_mm is missing"),
        ("low_mm: 0.0", "format: x\n  low_mm: 0.0", "friction.format is unknown"),
        ("offset_Nm: 0.025", "offset_Nm: 0.1", "linearization.upper.offset_Nm"),
        ("serial: SIM-0001", "serial: 1", "serial = 1: str is wanted"),
        ("serial: SIM-0001", "serial: ''", "serial = '': a text"),
        ("serial: SIM-0001", "serial: ' x'", "serial = ' x': a text without spaces around it"),
        ("'2001-05-11T09:30:00Z'", "yesterday", "date = 'yesterday' is no date and time in UTC"),
        ("2001-05-11T09:30:00Z", "2001-02-30T09:30:00Z", "date = '2001-02-30.* is no date"),
        ("2001-05-11T09:30:00Z", "2001-05-11T09:30:00", "date = .* is no date and time in UTC"),
        ("2001-05-11T09:30:00Z", "2001-05-11T09:30:00+02:00", "date = .* is no date and time"),
        ("checksum: ", "checksum: 0", "checksum: the file was changed after it was written"),
        ("checksum: ", "sum: ", "sum is unknown"),
    ],
)
def test_a_wrong_file_is_refused_by_key(path, old, new, named):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    assert re.search(named, refusal(path))


@pytest.mark.parametrize("kept", [0.0, 0.3, 0.9])
def test_half_a_file_is_refused(path, kept):
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    refusal(path)


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    assert "cannot be read" in refusal(tmp_path / "nothing.yaml")
    assert "cannot be read" in refusal(tmp_path)


def test_a_file_without_its_checksum_is_refused(path):
    path.write_text(path.read_text().partition("checksum: ")[0])
    assert "checksum: the file was changed after it was written" in refusal(path)


def test_a_date_that_lost_its_quotes_is_the_same_date(path):
    loaded = load_module_calibration(path, SERIAL)
    path.write_text(path.read_text().replace("'2001-05-11T09:30:00Z'", "2001-05-11T09:30:00Z"))
    assert load_module_calibration(path, SERIAL) == loaded


def test_another_modules_file_is_refused_with_both_names(path):
    told = refusal(path, serial="SIM-0002")
    assert "'SIM-0001'" in told and "'SIM-0002'" in told


def test_a_file_for_nobody_knows_which_module_is_refused(path):
    told = refusal(path, serial="")
    assert "'SIM-0001'" in told and "set module_serial" in told


# The nodes' settings -------------------------------------------------------------------------


def test_settings_choose_the_file_or_none(path):
    assert chosen_calibration(CalibrationSettings(), "friction_file", "") is None
    assert chosen_calibration(CalibrationSettings("", SERIAL), "friction_file", "x") is None
    chosen = chosen_calibration(CalibrationSettings(str(path), SERIAL), "friction_file", "")
    assert chosen == load_module_calibration(path, SERIAL)


def test_calibration_and_a_part_of_it_are_refused_together(path):
    given_ = CalibrationSettings(str(path), SERIAL)
    with pytest.raises(SettingError, match="friction_file names own.yaml; .* empty one"):
        chosen_calibration(given_, "friction_file", "own.yaml")


# Writing -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"gravity_N": math.nan}, "gravity_N = nan: a finite"),
        ({"mass_kg": 0.0}, "mass_kg = 0.0 kg: below"),
        ({"mass_kg": 0.6}, "mass_kg = 0.6 kg with a standard deviation of 0.125 kg, more than 20 "),
        ({"mass_kg": None}, "mass_kg = None: a finite number"),
        ({"date": "today"}, "date = 'today' is no date"),
        ({"serial": ""}, "serial = '': a text"),
        ({"sensor_bias": SensorBias((0.0,) * 3, ())}, "sensor_bias.torque_Nm = .*: a list of 3"),
        ({"residuals": {"friction_rms_N": math.nan}}, "residuals.friction_rms_N = nan"),
        ({"residuals": {"linearization_left_N": 6.0}}, "linearization_left_N = 6.0: 0 to 5"),
        ({"friction": FRICTION._replace(low_mm=400.0)}, "friction.high_mm: 355 is not above"),
        (
            {"linearization": default_linearization()._replace(upper=Line(0.0, 0.025))},
            "linearization.upper.slope = 0.0: below",
        ),
    ],
)
def test_nothing_wrong_is_written_and_the_old_file_stays(path, change, named):
    before = path.read_bytes()
    with pytest.raises(SettingError, match=named) as caught:
        write_calibration(path, GOOD._replace(**change))
    assert str(path) in str(caught.value) and "nothing was written" in str(caught.value)
    assert path.read_bytes() == before


def test_a_disk_that_refuses_leaves_the_old_file_and_nothing_else(path, monkeypatch):
    before = path.read_bytes()

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(SettingError, match=r"cannot be written \(No space left"):
        write_calibration(path, GOOD._replace(mass_kg=6.0))
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]
