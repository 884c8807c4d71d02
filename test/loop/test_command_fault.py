# SPDX-License-Identifier: Apache-2.0
"""A fault of the command stream is latched once, and cleared with the others."""

from __future__ import annotations

from screw_module_ros.devices.errors import BusError

MS = 1_000_000


def implausible(bench) -> None:
    """Send a new command that no controller may give."""
    bench.clock.time_ns += MS
    bench.axis.command(bench.now_ns // MS, bench.now_ns, 1e6, bench.now_ns)


def test_a_command_fault_is_latched(bench):
    implausible(bench)
    assert "beyond anything" in bench.axis.permit.fault.reason


def test_one_clear_fault_clears_what_came_behind_another_fault(bench):
    bench.axis.permit.fault.set("20 deadlines missed in a row")
    implausible(bench)
    fault = bench.axis.permit.fault
    assert fault.reason == "20 deadlines missed in a row", "the first is the cause"
    assert bench.clear_fault() == ""
    bench.ticks(20)
    assert bench.axis.permit.fault.reason == "", "nothing has happened since"


def test_torque_that_cannot_be_sent_is_not_shown_as_written(enabled, monkeypatch):
    """The state would show the last command for as long as the bus fails."""
    enabled.setpoint = (enabled.home + 0.03, 0.0)
    enabled.seconds(0.5)
    assert abs(enabled.axis.last.torque) > 1e-3

    def fail(can_id, data):
        raise BusError("cannot send")

    monkeypatch.setattr(enabled.ports["drive"], "send", fail)
    enabled.ticks(30)
    assert enabled.axis.permit.reason.startswith("cannot send")
    assert enabled.axis.last[:2] == (0.0, 0.0)
