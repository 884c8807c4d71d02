# SPDX-License-Identifier: Apache-2.0
"""The wire: texts as ROSBRIDGE_PROTOCOL.md and roslibjs write them, and what is no such text."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.bridge.rosbridge import (
    Advertise,
    Call,
    ProtocolError,
    Publish,
    Subscribe,
    Unsubscribe,
    parsed,
    publication,
    same_kind,
    service_response,
    status,
)


@pytest.mark.parametrize(
    ("text", "operation"),
    [
        # as roslibjs 1.4 writes them
        (
            '{"op":"subscribe","id":"subscribe:/endpoint_state:1","type":"a_msgs/B",'
            '"topic":"/endpoint_state","compression":"none","throttle_rate":50,"queue_length":0}',
            Subscribe("/endpoint_state", "a_msgs/B", 0.05, "subscribe:/endpoint_state:1"),
        ),
        ('{"op":"unsubscribe","id":"x","topic":"/a"}', Unsubscribe("/a", "x")),
        (
            '{"op":"advertise","id":"y","type":"a_msgs/B","topic":"/a","latch":false,'
            '"queue_size":100}',
            Advertise("/a", "a_msgs/B", False, "y"),
        ),
        ('{"op":"unadvertise","id":"y","topic":"/a"}', Advertise("/a", "", True, "y")),
        (
            '{"op":"publish","id":"z","topic":"/a","msg":{"data":1.5},"latch":false}',
            Publish("/a", {"data": 1.5}, "z"),
        ),
        (
            '{"op":"call_service","id":"c","service":"/s","type":"t","args":{"a":[1]},"timeout":5}',
            Call("/s", {"a": [1]}, "t", "c"),
        ),
        ('{"op":"call_service","service":"/s"}', Call("/s", {}, "", None)),
    ],
)
def test_what_clients_write_is_understood(text, operation):
    assert parsed(text) == operation


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("hello", "no JSON"),
        ("[" * 100_000, "no JSON"),
        ('{"op":"publish","topic":"/a","msg":{"x":NaN}}', "NaN is no JSON: write null"),
        ("[]", "a JSON object"),
        ("{}", "op = None"),
        ('{"op":["publish"]}', "one of subscribe, unsubscribe"),
        ('{"op":"fragment"}', "one of subscribe"),
        ('{"op":"subscribe"}', "topic: a name"),
        ('{"op":"subscribe","topic":""}', "topic: a name"),
        ('{"op":"subscribe","topic":"' + "a" * 201 + '"}', "topic: a name"),
        ('{"op":"subscribe","topic":"/a","throttle_rate":true}', "throttle_rate"),
        ('{"op":"subscribe","topic":"/a","throttle_rate":-1}', "throttle_rate"),
        ('{"op":"subscribe","topic":"/a","compression":"png"}', "compression"),
        ('{"op":"publish","topic":"/a","msg":3}', "msg: an object"),
        ('{"op":"publish","topic":"/a","msg":' + '{"a":' * 20 + "1" + "}" * 21, "deeper"),
        ('{"op":"call_service","service":"/s","args":[1]}', "args: an object"),
        ('{"op":"subscribe","topic":"/a","id":7}', "id: a text"),
    ],
)
def test_what_cannot_be_understood_is_told(text, told):
    with pytest.raises(ProtocolError) as error:
        parsed(text)
    assert told in str(error.value)
    assert len(str(error.value)) < 400


def test_a_refusal_carries_the_id():
    with pytest.raises(ProtocolError) as error:
        parsed('{"op":"subscribe","id":"mine"}')
    assert error.value.id == "mine"


@given(st.text() | st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(
        st.sampled_from(["op", "topic", "id", "msg", "args", "service", "type", "throttle_rate"]),
        inner | st.sampled_from(["subscribe", "publish", "call_service"]), max_size=6,
    ),
).map(json.dumps))  # fmt: skip
def test_no_text_does_more_than_be_refused(text):
    try:
        operation = parsed(text)
    except ProtocolError:
        return
    assert isinstance(operation, (Subscribe, Unsubscribe, Advertise, Publish, Call))


def test_what_is_sent_is_what_the_protocol_says():
    assert json.loads(publication('/a"', '{"x":null}')) == {
        "op": "publish", "topic": '/a"', "msg": {"x": None}
    }  # fmt: skip
    assert json.loads(service_response("/s", "1", {"ok": True}, True)) == {
        "op": "service_response", "service": "/s", "id": "1", "values": {"ok": True},
        "result": True,
    }  # fmt: skip
    assert json.loads(status("error", "no")) == {"op": "status", "level": "error", "msg": "no"}


def test_types_are_meant_by_either_spelling():
    has = "screw_module_msgs/msg/EndpointState"
    assert same_kind("", has)
    assert same_kind(has, has)
    assert same_kind("screw_module_msgs/EndpointState", has)
    assert not same_kind("screw_module_msgs/Other", has)
    assert not same_kind("EndpointState", has)
