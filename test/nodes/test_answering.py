# SPDX-License-Identifier: Apache-2.0
"""Requests that trip up the services rclpy gives each node: an answer, and the node lives on."""

from __future__ import annotations

import subprocess
import sys

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter as Value

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
