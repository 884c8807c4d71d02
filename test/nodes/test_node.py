# SPDX-License-Identifier: Apache-2.0
"""A node's states after an error, the requests rclpy serves for it, and its threads."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from types import SimpleNamespace

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.exceptions import InvalidHandle
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter as Value

from screw_module_ros.clock import ManualClock, TimeStandsStill
from screw_module_ros.devices.errors import NotAnswering
from screw_module_ros.lockstep.conductor import Conductor
from screw_module_ros.loop.requests import Requests
from screw_module_ros.nodes.support import threads
from screw_module_ros.nodes.support.threads import Timers, run_loop


@pytest.fixture
def active(make_node):
    active = make_node("endpoint_state")
    active.trigger_configure()
    active.trigger_activate()
    return active


def state(active) -> int:
    return active._state_machine.current_state[0]


def fails_once(active, name, error):
    """Let a method of the node raise an error, once."""

    def fail():
        delattr(active, name)
        raise error

    setattr(active, name, fail)


@pytest.mark.parametrize(
    ("method", "steps"),
    [("end", ("deactivate",)), ("disconnect", ("deactivate", "cleanup"))],
)
def test_after_an_error_all_is_closed_and_the_node_begins_anew(active, method, steps):
    """It kept topics and bus, refused parameters as if configured, and nothing said why."""
    fails_once(active, method, RuntimeError("device gone"))
    for step in steps:
        getattr(active, f"trigger_{step}")()
    assert state(active) == State.PRIMARY_STATE_UNCONFIGURED
    assert "device gone" in active.failure
    assert not active._inboxes and not active._topics
    assert active.parameters.write(max_age=0.2) == ""
    active.trigger_configure()
    active.trigger_activate()
    assert active.active and state(active) == State.PRIMARY_STATE_ACTIVE
    assert active.failure == ""


def test_while_simulated_time_stands_the_node_stays_active(active):
    """Its loop was left out for good, with its device as it was, and nothing said why."""
    leave_step = active._leave_step

    def stands():
        active._active.clear()
        active._leave_step = leave_step
        raise TimeStandsStill("simulated time stands still")

    active._leave_step = stands
    active.trigger_deactivate()
    assert active.active and state(active) == State.PRIMARY_STATE_ACTIVE
    active.trigger_deactivate()
    assert not active.active and state(active) == State.PRIMARY_STATE_INACTIVE


def step_of(active, done):
    """Return a step of a loop that notes itself in `done`, and ends the loop."""

    def step(nodes):
        done.append("step")
        active.stopping.set()

    return step


def test_what_a_service_asks_for_is_carried_out_before_the_next_step(active):
    done = []
    answer = active.requests.put(lambda: done.append("asked"))
    failed = active.requests.put(lambda: 1 / 0)
    run_loop([active], step_of(active, done))
    assert done == ["asked", "step"] and answer.done()
    with pytest.raises(ZeroDivisionError):
        failed.result(timeout=0.0)


def test_of_the_nodes_in_one_loop_those_that_are_active_are_served_alone(active):
    done = []
    other = SimpleNamespace(enters=lambda: False, requests=Requests(ManualClock()))
    other.requests.put(lambda: done.append("asked"))
    run_loop([active, other], step_of(active, done))
    assert done == ["step"]


def test_what_was_asked_for_before_an_activation_is_not_carried_out_after_it(active):
    """A gate that was closed for who gave up waiting would close for who enables now."""
    done = []
    active.trigger_deactivate()
    active.requests.put(lambda: done.append("asked"))
    active.trigger_activate()
    run_loop([active], step_of(active, done))
    assert done == ["step"]


@pytest.fixture
def amplifier(make_node):
    made = make_node("amplifier")
    made.told = []
    made.get_logger().error = made.told.append
    made.get_logger = lambda: type("Log", (), {"error": staticmethod(made.told.append)})
    return made


def fails():
    raise NotAnswering("the drive has no supply")


@pytest.mark.parametrize("transition", ["on_configure", "on_cleanup", "on_error"])
def test_a_failing_disconnect_is_logged_and_the_topics_are_closed(amplifier, transition):
    closed = []
    amplifier.connect = amplifier.disconnect = fails
    amplifier.close_topics = lambda: closed.append(True)
    getattr(amplifier, transition)(None)
    assert any("the drive has no supply" in line for line in amplifier.told)
    assert closed == [True]


@pytest.mark.parametrize("transition", ["on_activate", "on_deactivate"])
def test_a_failing_end_is_logged_and_is_an_error(amplifier, transition):
    amplifier.begin = amplifier.end = fails
    assert getattr(amplifier, transition)(None) == TransitionCallbackReturn.ERROR
    assert any("the drive has no supply" in line for line in amplifier.told)


def test_a_failed_connect_leaves_nothing_that_disconnect_stumbles_over(amplifier):
    """The permission is followed late; before, the sentence of the failure got lost."""
    amplifier.open_port = lambda *names: fails()
    assert amplifier.on_configure(None) == TransitionCallbackReturn.FAILURE
    assert amplifier.told == ["cannot configure: the drive has no supply"]
    amplifier.new_inbox()
    amplifier.disconnect()


RATE = Value("rate", value=100.0).to_parameter_msg()
ODD = Parameter(name="joint_states_rate", value=ParameterValue(type=77))


def call(node, name, request):
    """What the executor does with a request."""
    (service,) = [each for each in node.services if each.srv_name.endswith(f"/{name}")]
    return service.callback(request, service.srv_type.Response())


@pytest.fixture
def node(make_node):
    return make_node("endpoint_state")


def test_a_request_with_a_parameter_of_no_type_is_refused_and_sets_nothing(node):
    before = node.get_parameter("rate").value
    request = SetParameters.Request(parameters=[RATE, ODD])
    results = call(node, "set_parameters", request).results
    assert len(results) == 2
    assert all(not each.successful and "ValueError: 77" in each.reason for each in results)
    assert node.get_parameter("rate").value == before


def test_all_or_nothing_is_nothing(node):
    before = node.get_parameter("rate").value
    request = SetParametersAtomically.Request(parameters=[RATE, ODD])
    result = call(node, "set_parameters_atomically", request).result
    assert not result.successful and "77" in result.reason
    assert node.get_parameter("rate").value == before


@pytest.mark.parametrize("number", [0, 200, Transition.TRANSITION_ACTIVATE])
def test_a_transition_that_does_not_go_is_refused(node, number):
    """`ros2 lifecycle set NODE activate` for a node that is not configured, or active already."""
    request = ChangeState.Request(transition=Transition(id=number))
    assert not call(node, "change_state", request).success


def test_what_goes_well_is_as_before(node):
    values = call(node, "get_parameters", GetParameters.Request(names=["rate"])).values
    assert values[0].double_value == node.get_parameter("rate").value


_FAILS = """
import sys
from screw_module_ros.nodes.support import runtime, threads
from screw_module_ros.nodes.endpoint_state import EndpointStateNode
def serve(service, executor):
    raise RuntimeError("of this test")
threads.ServiceThread._serve = serve
sys.argv = ["endpoint_state"]
sys.exit(runtime.main(EndpointStateNode))
"""


def test_a_node_whose_requests_nobody_serves_ends_by_an_error(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", _FAILS], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1
    assert "what serves its requests failed: RuntimeError: of this test" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_clock_cannot_be_changed_while_the_node_runs(node):
    """rclpy's timers would stop, and with them what watches the senders of safety_state."""
    before = node.get_parameter("use_sim_time").value
    other = Value("use_sim_time", value=not before).to_parameter_msg()
    (result,) = call(node, "set_parameters", SetParameters.Request(parameters=[other])).results
    assert not result.successful and "use_sim_time is fixed" in result.reason
    assert node.get_parameter("use_sim_time").value == before


class Executor:
    """Raises what it is given, one after the other, and then lets the thread end."""

    def __init__(self, end: Callable[[], None], *errors: Exception):
        self.left, self._end = list(errors), end

    def spin_once(self, timeout_sec=None):
        if not self.left:
            self._end()
            return
        raise self.left.pop(0)

    def add_node(self, node):
        pass

    create_task = add_node

    def shutdown(self, timeout_sec):
        pass


@pytest.fixture
def served(make_node, monkeypatch):
    """Return a node whose service thread has run until its end, with these errors on the way."""

    def serve(*errors: Exception):
        node = make_node("endpoint_state")
        executor = Executor(node.service._ended.set, *errors)
        monkeypatch.setattr(threads, "SingleThreadedExecutor", lambda: executor)
        node.service.start(lambda: None)
        node.service._thread.join(20.0)
        assert not node.service._thread.is_alive() and not executor.left
        return node

    return serve


def test_a_publisher_destroyed_by_another_thread_does_not_end_the_node(served):
    assert not served(InvalidHandle("destruction was requested")).service.failed


def test_any_other_error_ends_the_node(served):
    node = served(RuntimeError())
    assert node.service.failed and node.stopping.is_set()


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
        if node.periodic.is_due():  # as the loop does
            node.service.wake()
    wait_until(lambda: conductor.quiet() is not None)
    node.service.end()
    conductor.close()
    assert calls == [20 * MS, 40 * MS, 60 * MS, 80 * MS, 100 * MS]


@pytest.mark.parametrize("woken_before", [True, False])
def test_a_thread_that_has_ended_holds_no_time_for_a_call_that_is_due(make_node, woken_before):
    """The rig's diagnostics fell due while the drives left: time stood still for ten seconds."""
    node = make_node("sim_rig", "-p", "use_sim_time:=true", "-r", "__ns:=/due_at_the_end")
    conductor = Conductor(node.clock.page, 0.0, pytest.fail)
    node.periodic.every(node.clock, 0.02, lambda: None)
    node.service.start(lambda: None)
    if not woken_before:
        node.service.end()
    conductor.move(node.clock.now_ns() + 20 * MS)
    assert node.periodic.is_due()
    node.service.wake()
    node.service.end()
    assert conductor.quiet() is not None
    conductor.close()
