# SPDX-License-Identifier: Apache-2.0
"""Messages as plain values and back, on messages of the graph."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from rcl_interfaces.msg import Log
from rcl_interfaces.srv import SetParameters
from screw_module_msgs.msg import EndpointSetpoint, EndpointState, PlanarState, SafetyState
from screw_module_msgs.srv import StartTherapy

from screw_module_ros.bridge.messages import LEFT_ALONE, as_json, filled, plain
from screw_module_ros.bridge.rights import ROLES, SERVICES, THERAPIST, TYPES
from screw_module_ros.graph import interface_class

DEFINITIONS = Path(__file__).parents[2] / "msg_defs"
TOPIC_TYPES = {TYPES[name] for verb in ("subscribe", "publish") for name in ROLES[THERAPIST][verb]}


def test_no_number_is_null():
    message = EndpointState()
    message.position.x, message.position.y, message.position.z = math.nan, math.inf, 0.25
    message.valid = [True, False, True]
    content = json.loads(as_json(message))
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
    message = filled(PlanarState, {"position": [None, 1]})
    assert math.isnan(message.position[0]) and message.position[1] == 1.0


@pytest.mark.parametrize(("content", "position"), [
    ({"position": {"x": 0.05, "y": -0.05}}, (0.05, -0.05, None)),
    ({"position": {"z": 0}}, (None, None, 0.0)),
    ({"position": {"x": None}}, (None, None, None)),
    ({"position": {}, "velocity": {"x": 0.1}}, (None, None, None)),
    ({}, (None, None, None)),
])  # fmt: skip
def test_an_axis_that_a_wish_does_not_name_is_left_alone(content, position):
    """As 0 the height would pull the hand to the floor."""
    message = filled(EndpointSetpoint, content)
    assert tuple(plain(message.position).values()) == position
    assert plain(message.velocity)["y"] == 0.0


def test_where_nan_leaves_something_alone_the_definitions_say_so():
    """Of all that a page can fill: a definition that comes to say so belongs to the table."""
    said = set()
    for kind in {TYPES[name] for name in ROLES[THERAPIST]["publish"]} | set(SERVICES.values()):
        package, folder, name = kind.split("/")
        file = DEFINITIONS / folder / f"{name}.{folder}"
        if package == "screw_module_msgs" and "NaN" in file.read_text().partition("---")[0]:
            said.add(name)
    assert said == set(LEFT_ALONE)
    assert LEFT_ALONE["EndpointSetpoint"] == ("position",)  # its velocity rests at 0


def test_parameters_travel():
    content = {"parameters": [{"name": "wish.high", "value": {"type": 3, "double_value": 0.3}}]}
    request = filled(SetParameters.Request, content)
    assert request.parameters[0].name == "wish.high"
    assert request.parameters[0].value.double_value == 0.3


@pytest.mark.parametrize("kind", sorted(TOPIC_TYPES))
def test_every_message_comes_back_as_it_was(kind):
    message = interface_class(kind)()
    assert filled(interface_class(kind), plain(message)) == message


@pytest.mark.parametrize("kind", sorted(set(SERVICES.values())))
def test_every_request_comes_back_as_it_was(kind):
    request = interface_class(kind).Request()
    assert filled(interface_class(kind).Request, plain(request)) == request


@pytest.mark.parametrize(
    ("message", "content", "told"),
    [
        (EndpointSetpoint, {"pos": {}}, "'pos': unknown field; known are header, position"),
        (EndpointSetpoint, {"position": 3}, "position: an object"),
        (EndpointSetpoint, {"position": {"x": "1"}}, "position.x = '1': The 'x' field must be"),
        (EndpointSetpoint, {"position": {"x": True}}, "position.x = True"),
        (EndpointSetpoint, {"position": {"x": 10**400}}, "position.x"),
        (EndpointSetpoint, {"position": {"x": math.inf}}, "position.x: a finite number or null"),
        (EndpointSetpoint, [], "the message: an object"),
        (SafetyState, {"level": 256}, "level = 256: The 'level' field must be"),
        (SafetyState, {"level": -1}, "level = -1"),
        (SafetyState, {"level": True}, "level = True: a uint8 is wanted"),
        (SafetyState, {"level": 1.0}, "level = 1.0"),
        (SafetyState, {"estopped": 1}, "estopped = 1"),
        (SafetyState, {"reasons": "all"}, "reasons = 'all': a list"),
        (SafetyState, {"reasons": {"a": 1}}, "a list is wanted"),
        (SafetyState, {"reasons": [1]}, "reasons = [1]"),
        (PlanarState, {"position": [1.0]}, "position = [1.0]"),
        (PlanarState, {"position": [1.0, math.inf]}, "position[1]: a finite number"),
        (StartTherapy.Request, {"patient": 5}, "patient = 5"),
        (SetParameters.Request, {"parameters": [3]}, "parameters[0]: an object"),
        (Log, {"stamp": {"sec": 2**31}}, "stamp.sec"),
    ],
)
def test_what_does_not_fit_is_told_by_its_name(message, content, told):
    with pytest.raises(ValueError) as error:
        filled(message, content)
    assert told in str(error.value)
    assert len(str(error.value)) < 400


def test_a_reason_is_cut_where_it_becomes_long():
    with pytest.raises(ValueError) as error:
        filled(PlanarState, {"position": [1.0]})
    assert len(str(error.value).removeprefix("position = [1.0]: ")) == 160
