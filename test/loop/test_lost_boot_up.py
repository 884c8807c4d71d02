# SPDX-License-Identifier: Apache-2.0
"""A drive that restarts while nobody can hear it: no torque without its guards, and a way back."""

from __future__ import annotations

import pytest

from screw_module_ros.devices.errors import NotAnswering

pytestmark = pytest.mark.long


def restart_unheard(bench, how: str) -> None:
    bench.rig.inject("drive", how, 0.0, 0.0, bench.now_ns)
    bench.rig.inject("drive", "reset", 0.0, 0.0, bench.now_ns)
    bench.seconds(0.6)


def watches_our_heartbeat(bench) -> bool:
    return bench.rig.devices["drive"].node.value(0x1016, 1) != 0


@pytest.mark.parametrize("how", ["cable_out", "bus_off"])
def test_clear_fault_configures_it_anew(enabled, how):
    restart_unheard(enabled, how)
    enabled.rig.inject("drive", "clear", 0.0, 0.0, enabled.now_ns)
    assert not watches_our_heartbeat(enabled)
    assert enabled.clear_fault() == ""
    assert watches_our_heartbeat(enabled)
    assert enabled.enable() == ""


def test_a_drive_that_keeps_its_pdos_over_a_restart_is_configured_anew_too(enabled):
    """It speaks again as if nothing had been; its guards and limits are gone all the same."""
    enabled.rig.inject("drive", "cable_out", 0.0, 0.0, enabled.now_ns)
    node = enabled.rig.devices["drive"].node
    node.put(0x1016, 1, 0)
    enabled.seconds(0.6)
    enabled.rig.inject("drive", "clear", 0.0, 0.0, enabled.now_ns)
    enabled.seconds(0.1)
    assert enabled.clear_fault() == ""
    assert watches_our_heartbeat(enabled)


def test_while_it_cannot_be_reached_it_stays_off(enabled):
    restart_unheard(enabled, "cable_out")
    with pytest.raises(NotAnswering):
        enabled.axis.permit.clear_fault(enabled.clock)
    assert enabled.enable() != ""
