# SPDX-License-Identifier: Apache-2.0
"""The file of the arms' weights: kept for patient and side, private, never overwritten unread."""

import json
import stat

import pytest

from screw_module_ros.therapy.arm_weights import (
    LASTS_S,
    Arms,
    ArmWeight,
    WeightsError,
    arms_of,
    keep,
)

LEFT, RIGHT = ArmWeight(18.4, 1.2, 1_796_000_000), ArmWeight(16.0, 0.4, 1_796_000_100)


@pytest.fixture
def file(tmp_path):
    return tmp_path / "therapy_session" / "arm_weights.json"


def test_a_weight_is_kept_for_patient_and_side(file):
    assert arms_of(file, "P-7K3QX") == Arms()
    keep(file, "P-7K3QX", "left", RIGHT)
    keep(file, "P-7K3QX", "left", LEFT)
    keep(file, "P-7K3QX", "right", RIGHT)
    keep(file, "P-22222", "left", RIGHT)
    assert arms_of(file, "P-7K3QX") == Arms(LEFT, RIGHT)
    assert arms_of(file, "P-22222") == Arms(RIGHT, None)


def test_it_is_its_owners_alone(file):
    keep(file, "P-7K3QX", "left", LEFT)
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert stat.S_IMODE(file.parent.stat().st_mode) == 0o700
    assert [each.name for each in file.parent.iterdir()] == ["arm_weights.json"]


@pytest.mark.parametrize(("text", "named"), [
    ("", "mapping"), ("{", "no YAML"), ("[]", "mapping"), ("{}", "patients is missing"),
    ('{"patients": {"P-7K3QX": 3}}', "P-7K3QX"),
    ('{"patients": {"P-7K3QX": {"up": {}}}}', "up is unknown"),
    ('{"patients": {"P-7K3QX": {"left": {"weight": 3}}}}', "left.spread is missing"),
    ('{"patients": {"P-7K3QX": {"left": {"weight": .nan, "spread": 0, "weighed_s": 0}}}}', "nan"),
])  # fmt: skip
def test_a_file_that_cannot_be_read_is_named_and_left_alone(file, text, named):
    file.parent.mkdir()
    file.write_text(text)
    for act in (lambda: arms_of(file, "P-7K3QX"),
                lambda: keep(file, "P-7K3QX", "left", LEFT)):  # fmt: skip
        with pytest.raises(WeightsError) as error:
            act()
        assert str(file) in str(error.value) and named in str(error.value)
        assert str(error.value).endswith("mend that file, or move it away and weigh again")
    assert file.read_text() == text


def test_a_folder_that_takes_no_file_is_told(file):
    file.parent.write_text("a file")
    with pytest.raises(WeightsError, match="arm_weights.json"):
        keep(file, "P-7K3QX", "left", LEFT)


def test_an_old_weight_and_one_of_tomorrow_are_weighed_again(file):
    at = LEFT.weighed_s
    assert not LEFT.is_old(at) and not LEFT.is_old(at + LASTS_S)
    assert LEFT.is_old(at + LASTS_S + 1) and LEFT.is_old(at - 1)


def test_the_file_can_be_read_by_a_person(file):
    keep(file, "P-7K3QX", "left", LEFT)
    assert json.loads(file.read_text())["patients"]["P-7K3QX"]["left"] == LEFT._asdict()
