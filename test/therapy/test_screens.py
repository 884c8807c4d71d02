# SPDX-License-Identifier: Apache-2.0
"""Data of the protocols for screens."""

from __future__ import annotations

import json

import pytest

from screw_module_ros.therapy.protocol_file import SHIPPED, protocol_text, protocols_for_screens


def test_the_package_protocols_are_offered_with_their_targets():
    offered = {each["name"]: each for each in protocols_for_screens()}
    assert list(offered) == list(SHIPPED)
    assert offered["clock_adaptive"]["trials"] == 1024
    assert len(offered["clock_adaptive"]["targets"]) == 8
    assert offered["elevator"]["targets"] == [
        pytest.approx((0.0, 0.0, 0.04)), pytest.approx((0.0, 0.0, 0.32))
    ]  # fmt: skip
    evaluation = offered["evaluation"]
    assert max(map(len, evaluation["blocks"].values())) < len(evaluation["targets"])
    together = {point for points in evaluation["blocks"].values() for point in points}
    assert sorted(together) == evaluation["targets"]
    json.dumps(offered, allow_nan=False)


def test_protocols_of_ones_own_are_offered_and_bad_ones_told(tmp_path):
    mine = protocol_text("elevator").replace("name: elevator", "name: mine")
    (tmp_path / "mine.yaml").write_text(mine)
    (tmp_path / "bad.yaml").write_text("dance: true")
    told = []
    names = [each["name"] for each in protocols_for_screens(tmp_path, told.append)]
    assert names == [*SHIPPED, "mine.yaml"]
    assert len(told) == 1 and "bad.yaml" in told[0]
    assert len(protocols_for_screens(tmp_path / "nowhere")) == len(SHIPPED)


def test_a_copy_that_kept_its_name_is_told_and_not_offered(tmp_path):
    """The patient's screen showed another protocol's picture: that of the first with the name."""
    copy = protocol_text("elevator").replace("name: elevator", "name: clock_adaptive")
    (tmp_path / "mine.yaml").write_text(copy)
    told = []
    assert len(protocols_for_screens(tmp_path, told.append)) == len(SHIPPED)
    (sentence,) = told
    assert "mine.yaml" in sentence and "'clock_adaptive'" in sentence
