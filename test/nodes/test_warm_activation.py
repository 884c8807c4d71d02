# SPDX-License-Identifier: Apache-2.0
"""`amplifier` hands the motor's heat from one activation to the next, also if one fails."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from screw_module_ros.control.torque_chain import TorqueChain
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.errors import NotAnswering
from screw_module_ros.geometry import Screw

DRIVE = SimpleNamespace(
    settings=DriveSettings(), state=lambda now_ns: SimpleNamespace(text="on"), counters={}
)


def test_a_hot_motor_stays_hot_and_says_so(make_node, monkeypatch):
    node = make_node("amplifier")
    node._chain, node.drives, node.period_ns = TorqueChain(), (DRIVE,), 1_000_000
    node.port = SimpleNamespace(clock=node.clock, close=lambda: None)
    node._screw = Screw()
    node.part = SimpleNamespace(heat=lambda now_ns: 0.1)

    def silent():
        raise NotAnswering("the drive has no supply")

    monkeypatch.setattr(node, "start_drives", silent)
    for _ in range(2):
        with pytest.raises(NotAnswering):
            node.begin()
    assert node.part.heat(node.clock.now_ns()) == 0.1
    monkeypatch.setattr(node, "port_values", lambda skipped: {})
    monkeypatch.setattr(node, "drive_health", lambda values, state: values)
    share = 0.1 / node._chain.limits.continuous**2
    assert node.health()["motor heat [%]"] == f"{100.0 * share:.0f}"
