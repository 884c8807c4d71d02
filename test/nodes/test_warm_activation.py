# SPDX-License-Identifier: Apache-2.0
"""`amplifier` hands the motor's heat from one activation to the next, also if one fails."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from screw_module_ros.control.torque_chain import TorqueChain
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.errors import NotAnswering

DRIVE = SimpleNamespace(settings=DriveSettings())


def test_a_hot_motor_stays_hot(make_node, monkeypatch):
    node = make_node("amplifier")
    node._chain, node.drives, node.period_ns = TorqueChain(), (DRIVE,), 1_000_000
    node.port = SimpleNamespace(clock=node.clock, close=lambda: None)
    node.part = SimpleNamespace(heat=lambda now_ns: 0.1)

    def silent():
        raise NotAnswering("the drive has no supply")

    monkeypatch.setattr(node, "start_drives", silent)
    for _ in range(2):
        with pytest.raises(NotAnswering):
            node.begin()
    assert node.part.heat(node.clock.now_ns()) == 0.1
