# SPDX-License-Identifier: Apache-2.0
"""The ROS domain is the number that the middleware takes."""

from __future__ import annotations

import pytest
from rclpy.context import Context

from screw_module_ros.domain import domain_id


@pytest.mark.parametrize("told", ["", "0", "7", "07", "010", "0x10", "+5", " 12", "101"])
def test_as_the_middleware_reads_it(monkeypatch, told):
    monkeypatch.setenv("ROS_DOMAIN_ID", told)
    context = Context()
    context.init(args=[])
    try:
        assert domain_id() == context.get_domain_id()
    finally:
        context.try_shutdown()


def test_without_the_variable_it_is_0(monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID")
    assert domain_id() == 0


@pytest.mark.parametrize(
    "told", ["seven", "7th", "08", "-1", "0x", "1.0", "9" * 1000, "٣", "233", "0xE9"]
)
def test_what_is_no_number_is_named(monkeypatch, told):
    monkeypatch.setenv("ROS_DOMAIN_ID", told)
    with pytest.raises(ValueError, match="ROS_DOMAIN_ID") as raised:
        domain_id()
    assert len(str(raised.value)) < 100
