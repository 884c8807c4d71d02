# SPDX-License-Identifier: Apache-2.0
"""A client's side: newest samples, never a queue; rights; floods; calls. Time is handed in."""

from __future__ import annotations

import json

import pytest
from fake_gateway import FakeGateway
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.bridge.client import Client, CutOff
from screw_module_ros.bridge.rights import PATIENT, THERAPIST, Rights
from screw_module_ros.bridge.settings import Limits

MS = 1_000_000
LIMITS = Limits()


def client(gateway, role=THERAPIST, limits=LIMITS, wishes=False):
    return Client(role, Rights(["/"], wishes), gateway, limits, 0)


def text(op, **more):
    return json.dumps({"op": op, **more})


def sent(client, now_ns):
    return [json.loads(each) for each in client.due(now_ns)]


def test_of_a_topic_there_is_the_newest_sample_alone(gateway):
    page = client(gateway)
    page.take(text("subscribe", topic="/endpoint_state"), 0)
    for number in range(1000):
        gateway.tell("/endpoint_state", {"number": number})
    (message,) = sent(page, 10 * MS)
    assert message["msg"] == {"number": 999}
    assert sent(page, 1000 * MS) == []


def test_samples_come_no_faster_than_asked(gateway):
    page = client(gateway)
    page.take(text("subscribe", topic="/endpoint_state", throttle_rate=100), 0)
    got = 0
    for ms in range(0, 1000, 5):
        gateway.tell("/endpoint_state", {"at": ms})
        got += len(sent(page, ms * MS))
    assert 9 <= got <= 11


def test_samples_come_no_faster_than_the_bridge_allows(gateway):
    page = client(gateway, limits=Limits(rate=50.0))
    page.take(text("subscribe", topic="/endpoint_state"), 0)
    got = 0
    for tenth in range(10_000):  # polled ten times a millisecond
        gateway.tell("/endpoint_state", {})
        got += len(sent(page, tenth * MS // 10))
    assert got <= 100  # twice at most: a poll that comes early is served


def test_the_name_is_the_one_the_client_uses(gateway):
    page = client(gateway, PATIENT)
    page.take(text("subscribe", topic="endpoint_state"), 0)
    gateway.tell("/endpoint_state", {})
    assert sent(page, MS)[0]["topic"] == "endpoint_state"
    assert page.subscribed == {"/endpoint_state"}


def test_unsubscribing_ends_it(gateway):
    page = client(gateway)
    page.take(text("subscribe", topic="/endpoint_state"), 0)
    page.take(text("unsubscribe", topic="/endpoint_state"), 0)
    gateway.tell("/endpoint_state", {})
    assert sent(page, 100 * MS) == []


@pytest.mark.parametrize("role", [PATIENT, THERAPIST])
def test_a_set_point_is_refused_and_goes_nowhere(gateway, role):
    page = client(gateway, role, wishes=True)
    page.take(text("publish", topic="/setpoint", msg={"position": {"x": 0.1}}, id="7"), 0)
    (answer,) = sent(page, 0)
    assert answer["op"] == "status" and answer["level"] == "error" and answer["id"] == "7"
    assert "therapy/wish" in answer["msg"]
    assert gateway.published == []


def test_the_patients_token_reads(gateway):
    page = client(gateway, PATIENT)
    page.take(text("publish", topic="/therapy/wish", msg={}), 0)
    page.take(text("publish", topic="/therapy/attendance", msg={}), 0)
    page.take(text("call_service", service="/supervisor/estop", id="c"), 0)
    page.take(text("subscribe", topic="/safety_state"), 0)
    answers = sent(page, 0)
    assert [answer["op"] for answer in answers] == ["status"] * 2 + ["service_response", "status"]
    assert answers[2]["result"] is False and answers[2]["id"] == "c"
    assert gateway.published == [] and gateway.calls == []
    assert page.subscribed == frozenset()


def test_a_call_is_answered_with_its_id(gateway):
    page = client(gateway)
    page.take(text("call_service", service="/therapy_session/pause", id="c1"), 0)
    ((service, arguments, answered),) = gateway.calls
    assert (service, arguments) == ("/therapy_session/pause", {})
    assert sent(page, 0) == []
    answered({"success": True, "message": ""}, True)
    (answer,) = sent(page, 0)
    assert answer == {
        "op": "service_response", "service": "/therapy_session/pause", "id": "c1",
        "values": {"success": True, "message": ""}, "result": True,
    }  # fmt: skip


def test_calls_without_answers_are_bounded(gateway):
    page = client(gateway)
    for _ in range(20):
        page.take(text("call_service", service="/therapy_session/pause"), 0)
    assert len(gateway.calls) == 8
    assert len([answer for answer in sent(page, 0) if answer["result"] is False]) == 12
    gateway.calls[0][2]({}, True)
    page.take(text("call_service", service="/therapy_session/pause"), 0)
    assert len(gateway.calls) == 9


def test_the_software_stop_needs_no_answers_to_other_calls(gateway):
    """A therapist presses Pause again and again as the session's node hangs, and then the stop."""
    page = client(gateway)
    for _ in range(20):
        page.take(text("call_service", service="/therapy_session/pause"), 0)
    page.take(text("call_service", service="/supervisor/estop"), 0)
    assert gateway.calls[-1][0] == "/supervisor/estop"


def test_wrong_content_is_told_and_frees_the_call(gateway):
    page = client(gateway)
    for _ in range(20):
        page.take(text("call_service", service="/therapy_session/start", args={"bad": 1}), 0)
    page.take(text("publish", topic="/therapy/attendance", msg={"bad": 1}), 0)
    answers = sent(page, 0)
    assert all("bad: unknown field" in (a.get("values") or a.get("msg")) for a in answers)
    assert len(answers) == 21


def test_a_wrong_type_is_refused(gateway):
    page = client(gateway)
    page.take(text("subscribe", topic="/endpoint_state", type="std_msgs/String"), 0)
    page.take(text("advertise", topic="/therapy/wish", type="std_msgs/String"), 0)
    right = "screw_module_msgs/EndpointSetpoint"
    page.take(text("advertise", topic="/therapy/wish", type=right), 0)
    answers = sent(page, 0)
    assert len(answers) == 2
    assert "screw_module_msgs/msg/EndpointState" in answers[0]["msg"]


def test_a_flood_is_cut_off_with_a_sentence(gateway):
    page = client(gateway)
    message = text("publish", topic="/therapy/attendance", msg={})
    for _ in range(round(LIMITS.burst)):
        page.take(message, 0)
    with pytest.raises(CutOff, match="more than 100 messages a second"):
        page.take(message, 0)
    assert len(gateway.published) == LIMITS.burst


def test_a_steady_client_is_never_cut_off(gateway):
    page = client(gateway)
    for number in range(6000):  # a minute at the rate that is allowed
        page.take(text("publish", topic="/therapy/attendance", msg={}), number * 10 * MS)
    assert len(gateway.published) == 6000


def test_answers_nobody_fetches_do_not_pile_up(gateway):
    page = client(gateway, limits=Limits(messages=1000.0))
    for number in range(100_000):
        page.take("nonsense", number * 2 * MS)
    assert len(page.due(0)) <= 64


@given(st.lists(st.tuples(
    st.sampled_from(["subscribe", "unsubscribe", "advertise", "publish", "call_service", "x"]),
    st.sampled_from(["/endpoint_state", "setpoint", "/therapy/wish", "/supervisor/estop",
                     "/therapy_session/set_parameters", "", "/", "💥"]),
    st.sampled_from([{}, {"names": ["folder"]}, {"bad": 1}, [], None, 5]),
), max_size=30), st.sampled_from([PATIENT, THERAPIST]))  # fmt: skip
def test_whatever_comes_is_answered_and_nothing_else_happens(operations, role):
    gateway = FakeGateway()
    page = client(gateway, role)
    for op, name, content in operations:
        page.take(text(op, topic=name, service=name, msg=content, args=content), 0)
    for answer in sent(page, 0):
        assert answer["op"] in ("status", "service_response")
    assert {topic for topic, _ in gateway.published} <= {"/therapy/wish"}
    assert role == THERAPIST or not gateway.published
    assert {service for service, *_ in gateway.calls} <= {"/supervisor/estop"}
    assert role == THERAPIST or not gateway.calls
