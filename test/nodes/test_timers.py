# SPDX-License-Identifier: Apache-2.0
"""Calls of the service thread: when the hot loop wakes it, and how long it may sleep."""

import pytest

from screw_module_ros.clock import ManualClock
from screw_module_ros.lockstep.conductor import Conductor
from screw_module_ros.nodes.support.threads import Timers

S, MS = 1_000_000_000, 1_000_000


class _RealTime(ManualClock):
    """A clock of which an executor's sleep is a good measure."""

    simulated = False


def test_in_simulated_time_the_thread_sleeps_until_the_loop_wakes_it():
    """It woke fifteen times for each timer, each wake-up at the price of half a tick."""
    timers, clock, calls = Timers(), ManualClock(), []
    timers.every(clock, 0.02, lambda: calls.append(clock.now_ns()))
    for now_ns in range(0, 20_000_000, 100_000):
        clock.time_ns = now_ns
        assert not timers.is_due()
        assert timers.left_s() == 0.2
    clock.time_ns = 20_000_000
    assert timers.is_due()
    timers.run()
    assert calls == [20_000_000]
    assert not timers.is_due()


@pytest.mark.parametrize(
    ("now_s", "left_s"), [(0.0, 0.2), (0.9, 0.1), (0.9999999, 1e-4), (1.5, 1e-4)]
)
def test_in_real_time_the_thread_sleeps_until_the_next_call(now_s, left_s):
    timers, clock = Timers(), _RealTime()
    timers.every(clock, 1.0, lambda: None)
    clock.time_ns = round(now_s * S)
    assert timers.left_s() == pytest.approx(left_s)
    assert not timers.is_due()  # the thread wakes up by itself


def test_a_call_that_was_cancelled_is_not_made():
    timers, clock, calls = Timers(), ManualClock(), []
    timer = timers.every(clock, 1.0, lambda: calls.append(clock.now_ns()))
    clock.time_ns = S
    assert timers.is_due()
    timers.cancel(timer)
    timers.run()
    assert not timers.is_due() and not calls


def test_calls_after_a_pause_are_made_once():
    timers, clock, calls = Timers(), ManualClock(), []
    timers.every(clock, 1.0, lambda: calls.append(clock.now_ns()))
    clock.time_ns = round(7.5 * S)
    timers.run()
    timers.run()
    clock.time_ns = 8 * S
    timers.run()
    assert calls == [round(7.5 * S), 8 * S]


def test_simulated_time_waits_for_a_call_that_is_due(make_node, wait_until):
    """A guard that looks each 0.1 s looked up to 0.08 s later, depending on the machine."""
    node = make_node("encoder", "-p", "use_sim_time:=true", "-r", "__ns:=/due_calls")
    conductor = Conductor(node.clock.page, 0.0, pytest.fail)
    begin_ns, calls = node.clock.now_ns(), []
    node.periodic.every(node.clock, 0.02, lambda: calls.append(node.clock.now_ns() - begin_ns))
    node.service.start(lambda: None)
    for tick in range(1, 101):
        wait_until(lambda: conductor.quiet() is not None)
        conductor.move(begin_ns + tick * MS)
        node.service.wake_if_due()
    wait_until(lambda: conductor.quiet() is not None)
    node.service.end()
    node.service.close()
    conductor.close()
    assert calls == [20 * MS, 40 * MS, 60 * MS, 80 * MS, 100 * MS]
