# SPDX-License-Identifier: Apache-2.0
"""What the gate permits, and how a refusal or a latched fault ends."""

from __future__ import annotations

import pytest

from screw_module_ros.clock import ManualClock, TimeStandsStill
from screw_module_ros.devices.errors import BusError, NotNow
from screw_module_ros.loop import gate
from screw_module_ros.loop.requests import Requests
from screw_module_ros.loop.ticker import Tick
from screw_module_ros.safety.permit import CLOSED, STARTING, Permit, PermitSettings

MS = 1_000_000


def test_permission_is_looked_at_whichever_ticks_are_left_out(bench):
    """A loop at half its rate may see odd ticks alone, a multiple of four never."""
    looked = []
    for number in range(1001, 1101, 2):
        bench.clock.time_ns += 2 * MS
        tick = Tick(number, bench.now_ns, 0, 1)
        bench.axis.end(tick, lambda permit, now_ns: looked.append(now_ns))
    assert len(looked) == 25


def test_a_fault_that_comes_with_a_clear_fault_keeps_its_reason(enabled):
    """Asked for while enabled, as for another node: the loop finds both in one tick."""
    permit = enabled.axis.permit
    permit.fault.set("20 deadlines missed in a row")
    enabled.requests.put(lambda: permit.clear(permit.fault.reason))
    enabled.ticks(5)
    assert not enabled.axis.permit.enabled
    assert permit.faulted and permit.reason == "20 deadlines missed in a row"
    assert enabled.clear_fault() == ""
    assert not permit.faulted


def test_on_the_way_to_enabled_the_last_stop_is_no_reason_any_more(enabled):
    enabled.permitted = False
    enabled.ticks(5)
    permit = enabled.axis.permit
    assert permit.reason == "not permitted: test"
    enabled.permitted = True
    enabled.ticks(400)
    enabled.rig.inject("drive", "refuse_enable", 0.0, 0.0, enabled.now_ns)
    assert permit.open(enabled.now_ns) == ""
    enabled.ticks(5)
    assert permit.reason == STARTING


def test_torque_ends_with_the_controller_that_it_was_enabled_for(enabled):
    """A node that is deactivated and activated within five periods never falls silent."""
    assert enabled.axis.permit.enabled
    enabled.controller.activation += 1
    enabled.ticks(2)
    assert not enabled.axis.permit.enabled
    assert "activated anew while the torque was on" in enabled.axis.permit.reason
    enabled.ticks(600)
    assert not enabled.axis.permit.enabled and enabled.axis.permit.latched
    assert enabled.clear_fault() == ""
    assert enabled.enable() == ""
    enabled.ticks(100)
    assert enabled.axis.permit.enabled


def test_a_controller_may_be_activated_anew_while_no_torque_passes(enabled):
    assert enabled.disable() == ""
    enabled.controller.activation += 1
    enabled.ticks(5)
    assert enabled.enable() == ""
    enabled.ticks(5)
    assert enabled.axis.permit.reason == ""


class StoppedClock(ManualClock):
    """Simulated time that stands still, in the second wait or at once."""

    def __init__(self, waits: int, bench):
        super().__init__(bench.now_ns)
        self.waits, self.tick = waits, bench.tick

    def wait_for(self, condition, seconds):
        if not self.waits:
            raise TimeStandsStill("no sim_rig runs")
        self.waits -= 1
        while not condition():
            self.tick()
        return True


@pytest.mark.parametrize("waits", [0, 1])
def test_an_enable_that_was_answered_with_an_error_is_not_carried_out_later(
    bench, waits, monkeypatch
):
    """The rig stops while somebody enables, and goes on after he was told that it failed."""
    permit = bench.axis.permit
    with monkeypatch.context() as patch:
        patch.setattr(bench.requests, "clock", StoppedClock(waits, bench))
        with pytest.raises(TimeStandsStill):
            gate.enable(permit, bench.requests)
    bench.ticks(200)
    assert not bench.axis.permit.enabled and permit.phase == CLOSED
    assert bench.enable() == ""


def test_without_a_supervisor_enabling_is_not_refused_in_its_name():
    permit = Permit([], PermitSettings(), MS)

    def refusal(now_ns: int) -> str:
        """Return what `~/enable` says with fresh commands."""
        permit.step(now_ns, now_ns)
        refused = permit.open(now_ns)
        permit.close()
        return refused

    assert refusal(MS) == "no fresh safety_state", "it has never said anything"
    permit.supervise(False, "encoder: not seen yet", 2 * MS)
    assert refusal(3 * MS) == "not permitted: encoder: not seen yet"
    assert refusal(500 * MS) == "no fresh safety_state", "it has gone since"


def test_a_latched_stop_whose_cause_is_over_tells_the_way_out(enabled):
    enabled.commanding = False
    enabled.ticks(12)
    enabled.commanding = True
    enabled.ticks(20)
    assert enabled.enable() == "no fresh command is latched: call ~/clear_fault first"


def test_disabled_and_enabled_again_at_once_is_no_fault(enabled):
    """The rig's drive obeys a tick late: its exit must not be taken for one by itself."""
    for _ in range(3):
        assert enabled.disable() == ""
        assert enabled.enable() == ""
        enabled.ticks(5)
        assert enabled.axis.permit.enabled and not enabled.axis.permit.faulted


@pytest.mark.parametrize("option", [0, 1])
def test_disabled_in_motion_it_coasts_whatever_its_option_code_says(enabled, option):
    enabled.rig.devices["drive"].node.put(0x605C, 0, option)
    enabled.setpoint = (0.05, 0.0)
    moving = enabled.seconds(0.4)[-1]
    assert abs(moving.velocity) > 0.01
    assert enabled.disable() == ""
    for _ in range(30):
        enabled.tick()
        assert not enabled.world.vertical_powered and not enabled.world.vertical_braked
    assert not enabled.axis.permit.faulted


def test_an_act_that_fails_fails_for_who_asked_and_the_loop_goes_on():
    requests = Requests(ManualClock(MS))
    failing, later = requests.put(lambda: 1 / 0), requests.put(lambda: "done")
    requests.serve()
    with pytest.raises(ZeroDivisionError):
        failing.result(timeout=0.0)
    assert later.result(timeout=0.0) == "done"


def test_an_act_that_no_loop_carries_out_is_refused_and_not_done_later():
    requests, acts = Requests(ManualClock(MS)), []
    with pytest.raises(NotNow, match="the loop does not run: activate the node"):
        requests.ask(lambda: acts.append("enabled"))
    requests.serve()
    assert acts == []


def test_what_was_asked_for_before_a_start_of_the_loop_is_not_carried_out_after_it():
    requests, acts = Requests(ManualClock(MS)), []
    answer = requests.put(lambda: acts.append("disabled"))
    requests.discard()
    requests.serve()
    assert acts == [] and answer.cancelled()


@pytest.mark.parametrize("first", ["", "20 deadlines missed in a row"])
def test_one_clear_fault_clears_a_command_fault_behind_another_fault(bench, first):
    """The first is the cause that is shown."""
    fault = bench.axis.permit.fault
    fault.set(first)
    bench.clock.time_ns += MS
    bench.axis.command(bench.now_ns // MS, bench.now_ns, 1e6, bench.now_ns)
    assert fault.reason == first if first else "beyond anything" in fault.reason
    assert bench.clear_fault() == ""
    bench.ticks(20)
    assert fault.reason == "", "nothing has happened since"


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
