# SPDX-License-Identifier: Apache-2.0
"""Messages as plain values and back, on messages of the graph."""

from __future__ import annotations

import json
import math

import pytest
from rcl_interfaces.msg import Log
from rcl_interfaces.srv import SetParameters
from screw_module_msgs.msg import EndpointSetpoint, EndpointState, PlanarState, SafetyState
from screw_module_msgs.srv import StartTherapy

from screw_module_ros.bridge.conversion import ConversionError, fill, plain
from screw_module_ros.bridge.rights import ASKED, HEARD, SENT
from screw_module_ros.nodes.bridge_gateway import found_type, new_message


def test_no_number_is_null():
    message = EndpointState()
    message.position.x, message.position.y, message.position.z = math.nan, math.inf, 0.25
    message.valid = [True, False, True]
    content = json.loads(json.dumps(plain(message), allow_nan=False))
    assert content["position"] == {"x": None, "y": None, "z": 0.25}
    assert content["valid"] == [True, False, True]
    assert content["header"]["stamp"] == {"sec": 0, "nanosec": 0}


def test_arrays_of_every_make_are_lists():
    message = PlanarState(drive_state=[3, 4], position=[0.1, math.nan])
    content = plain(message)
    assert content["drive_state"] == [3, 4]
    assert content["position"] == [0.1, None]
    assert plain(SafetyState(reasons=["a", "b"]))["reasons"] == ["a", "b"]


def test_null_is_no_number():
    message = fill(EndpointSetpoint(), {"position": {"x": None, "z": 1}}, new_message)
    assert math.isnan(message.position.x)
    assert message.position.y == 0.0
    assert message.position.z == 1.0


def test_parameters_travel():
    content = {"parameters": [{"name": "wish.high", "value": {"type": 3, "double_value": 0.3}}]}
    request = fill(SetParameters.Request(), content, new_message)
    assert request.parameters[0].name == "wish.high"
    assert request.parameters[0].value.double_value == 0.3


@pytest.mark.parametrize("kind", sorted({*HEARD.values(), *SENT.values()}))
def test_every_message_comes_back_as_it_was(kind):
    message = found_type(kind)()
    assert fill(found_type(kind)(), plain(message), new_message) == message


@pytest.mark.parametrize("kind", sorted(set(ASKED.values())))
def test_every_request_comes_back_as_it_was(kind):
    request = found_type(kind).Request()
    assert fill(found_type(kind).Request(), plain(request), new_message) == request


@pytest.mark.parametrize(
    ("message", "content", "told"),
    [
        (EndpointSetpoint, {"pos": {}}, "'pos': unknown field; known are header, position"),
        (EndpointSetpoint, {"position": 3}, "position: an object"),
        (EndpointSetpoint, {"position": {"x": "1"}}, "position.x = '1': a number or null"),
        (EndpointSetpoint, {"position": {"x": True}}, "position.x = True"),
        (EndpointSetpoint, {"position": {"x": 10**400}}, "position.x"),
        (EndpointSetpoint, [], "the message: an object"),
        (SafetyState, {"level": 256}, "a whole number from 0 to 255"),
        (SafetyState, {"level": -1}, "a whole number"),
        (SafetyState, {"level": True}, "a whole number"),
        (SafetyState, {"level": 1.0}, "a whole number"),
        (SafetyState, {"estopped": 1}, "true or false"),
        (SafetyState, {"reasons": "all"}, "reasons = 'all': a list"),
        (SafetyState, {"reasons": [1]}, "reasons[0] = 1: a text"),
        (PlanarState, {"position": [1.0]}, "position: a list of 2 is wanted, not one of 1"),
        (StartTherapy.Request, {"patient": 5}, "patient = 5: a text"),
        (Log, {"stamp": {"sec": 2**31}}, "stamp.sec"),
    ],
)
def test_what_does_not_fit_is_told_by_its_name(message, content, told):
    with pytest.raises(ConversionError) as error:
        fill(message(), content, new_message)
    assert told in str(error.value)
    assert len(str(error.value)) < 400
