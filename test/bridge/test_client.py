# SPDX-License-Identifier: Apache-2.0
"""A client's side: its texts, newest samples and no queue, rights, floods, calls."""

from __future__ import annotations

import asyncio
import json

import pytest
from fake_gateway import FakeGateway
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.bridge.client import Client, CutOff, ServiceError
from screw_module_ros.bridge.rights import PATIENT, THERAPIST, Rights
from screw_module_ros.bridge.settings import Limits

MS = 1_000_000
LIMITS = Limits()
HALF = "\ud800"


def client(gateway, role=THERAPIST, limits=LIMITS, wishes=False):
    return Client(role, Rights(["/"], wishes), gateway, limits, 0)


def text(op, **more):
    return json.dumps({"op": op, **more})


def sent(client, now_ns=0):
    return [json.loads(each) for each in client.texts(now_ns)]


def subscribed(gateway, topic="/endpoint_state", role=THERAPIST, limits=LIMITS, **more):
    page = client(gateway, role, limits)
    page.take(text("subscribe", topic=topic, **more), 0)
    return page


def answered(gateway, message, **more):
    """Send a message; return the page and its one answer."""
    page = client(gateway, **more)
    page.take(message, 0)
    (answer,) = sent(page)
    return page, answer


def run(gateway, acts, role=THERAPIST):
    """Carry out `acts(page)`, a generator; let calls go on at each of its yields."""

    async def play():
        page = client(gateway, role)
        for _ in acts(page):
            for _ in range(3):
                await asyncio.sleep(0)
        for task in asyncio.all_tasks() - {asyncio.current_task()}:
            task.cancel()
        return sent(page)

    return asyncio.run(play())


# Texts -------------------------------------------------------------------------------------


def test_what_roslibjs_writes_is_understood(gateway):
    page = client(gateway)
    kind = "screw_module_msgs/EndpointState"
    page.take(text("subscribe", id="subscribe:/endpoint_state:1", type=kind, compression="none",
                   topic="/endpoint_state", throttle_rate=50, queue_length=0), 0)  # fmt: skip
    assert page.subscribed == {"/endpoint_state"}
    page.take(text("unsubscribe", id="x", topic="/endpoint_state"), 0)
    wish = "screw_module_msgs/EndpointSetpoint"
    page.take(text("advertise", id="y", type=wish, topic="/therapy/wish", latch=False,
                   queue_size=100), 0)  # fmt: skip
    page.take(text("publish", id="z", topic="/therapy/wish", msg={"data": 1.5}, latch=False), 0)
    page.take(text("unadvertise", id="y", topic="/therapy/wish"), 0)
    assert page.subscribed == frozenset()
    assert gateway.published == [("/therapy/wish", {"data": 1.5})]
    assert sent(page) == []


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
        ('{"op":"subscribe"}', "topic, type: names"),
        ('{"op":"subscribe","topic":""}', "may not subscribe"),
        ('{"op":"subscribe","topic":"' + "a" * 2000 + '"}', "may not subscribe"),
        ('{"op":"subscribe","topic":"/endpoint_state","type":3}', "topic, type: names"),
        ('{"op":"subscribe","topic":"/endpoint_state","throttle_rate":true}', "throttle_rate"),
        ('{"op":"subscribe","topic":"/endpoint_state","throttle_rate":-1}', "throttle_rate"),
        ('{"op":"subscribe","topic":"/endpoint_state","throttle_rate":1e999}', "throttle_rate"),
        ('{"op":"subscribe","topic":"/endpoint_state","compression":"png"}', "compression"),
        ('{"op":"publish","topic":"/therapy/wish","msg":3}', "bad"),
        ('{"op":"subscribe","topic":"/a","id":7}', "id: a text"),
        ('{"op":"subscribe","topic":"/a","id":1e999}', "id: a text"),
    ],
)
def test_what_cannot_be_understood_is_told(gateway, text, told):
    page, answer = answered(gateway, text)
    assert answer["op"] == "status" and told in answer["msg"]
    assert len(answer["msg"]) < 400
    assert page.subscribed == frozenset()


@pytest.mark.parametrize("wrong", [
    {"service": "/supervisor/estop", "args": [1]},
    {"service": ["/supervisor/estop"]},
    {"service": "/therapy_session/pause", "type": "std_srvs/Empty"},
    {"service": "/supervisor/reset"},
    {"service": "/therapy_session/get_parameters", "args": {"names": ["folder"]}},
    {"service": "/therapy_session/start", "args": {"patient": HALF}},
    {},
])  # fmt: skip
def test_every_refusal_of_a_call_is_a_response(gateway, wrong):
    """roslibjs waits for one; a status tells its caller nothing."""
    _, answer = answered(gateway, text("call_service", id="mine", **wrong))
    assert (answer["op"], answer["id"], answer["result"]) == ("service_response", "mine", False)
    assert answer["values"] and gateway.calls == []


@pytest.mark.parametrize("op", [
    text("publish", topic="/therapy/wish", msg={"header": {"frame_id": HALF}}),
    text("publish", topic="/therapy/wish", msg={HALF: 1}),
    text("call_service", service="/therapy_session/start", args={"patient": f"P{HALF}"}),
    text("subscribe", topic=f"/endpoint_state{HALF}"),
    text("subscribe", topic="/endpoint_state", id=HALF),
])  # fmt: skip
def test_half_of_a_surrogate_pair_is_refused(gateway, op):
    """Such a text in a call that had to wait for its node ended the whole bridge."""
    page = client(gateway)
    page.take(op, 0)
    (answer,) = page.texts(0)
    assert "half of a surrogate pair is no text" in answer
    answer.encode()
    assert gateway.published == [] and gateway.calls == [] and not page.subscribed


@given(st.text() | st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(
        st.sampled_from(["op", "topic", "id", "msg", "args", "service", "type", "throttle_rate"]),
        inner | st.sampled_from(["subscribe", "publish", "call_service"]), max_size=6,
    ),
).map(json.dumps))  # fmt: skip
def test_no_text_does_more_than_be_refused(text):
    gateway = FakeGateway()
    _, answer = answered(gateway, text)
    assert answer["op"] in ("status", "service_response")
    assert (gateway.published, gateway.calls) == ([], [])


# Topics ------------------------------------------------------------------------------------


def test_of_a_topic_there_is_the_newest_sample_alone(gateway):
    page = subscribed(gateway)
    for number in range(1000):
        gateway.tell("/endpoint_state", {"number": number})
    (message,) = sent(page, 10 * MS)
    assert message == {"op": "publish", "topic": "/endpoint_state", "msg": {"number": 999}}
    assert sent(page, 1000 * MS) == []


def test_of_results_each_one_comes_also_those_before(gateway):
    page = client(gateway)
    for trial in (1, 2):
        gateway.tell("/therapy/trial", {"trial": trial})
    page.take(text("subscribe", topic="/therapy/trial"), 0)
    assert [each["msg"]["trial"] for each in sent(page)] == [1, 2]
    for trial in (3, 4):
        gateway.tell("/therapy/trial", {"trial": trial})
    assert [each["msg"]["trial"] for each in sent(page, 100 * MS)] == [3, 4]
    assert sent(page, 200 * MS) == []
    gateway.begin = lambda topic: 3  # another session has begun
    page.take(text("subscribe", topic="/therapy/trial"), 0)
    assert [each["msg"]["trial"] for each in sent(page, 300 * MS)] == [4]


@pytest.mark.parametrize(("asked_ms", "allowed", "period_ms", "count", "least", "most"), [
    (3_600_000, 60.0, 10_000, 720, 2, 2),  # once an hour, for two hours
    (100, 60.0, 5, 200, 9, 11),
    (0, 50.0, 0.1, 10_000, 1, 100),  # twice at most: a poll that comes early is served
])  # fmt: skip
def test_samples_come_no_faster_than_asked_or_allowed(
    gateway, asked_ms, allowed, period_ms, count, least, most
):
    page = subscribed(gateway, limits=Limits(rate=allowed), throttle_rate=asked_ms)
    got = 0
    for number in range(count):
        gateway.tell("/endpoint_state", {"number": number})
        got += len(sent(page, round(number * period_ms * MS)))
    assert least <= got <= most


def test_the_name_is_the_one_the_client_uses(gateway):
    page = subscribed(gateway, "endpoint_state", PATIENT)
    gateway.tell("/endpoint_state", {})
    assert sent(page, MS)[0]["topic"] == "endpoint_state"
    assert page.subscribed == {"/endpoint_state"}


def test_unsubscribing_ends_it(gateway):
    page = subscribed(gateway)
    page.take(text("unsubscribe", topic="/endpoint_state"), 0)
    gateway.tell("/endpoint_state", {})
    assert sent(page, 100 * MS) == []


@pytest.mark.parametrize("role", [PATIENT, THERAPIST])
@pytest.mark.parametrize("op", ["publish", "advertise"])
def test_a_set_point_is_refused_and_goes_nowhere(gateway, role, op):
    """roslibjs advertises first: a game's author hears of it before the first message."""
    kind = "screw_module_msgs/EndpointSetpoint"
    message = text(op, topic="/setpoint", type=kind, msg={"position": {"x": 0.1}}, id="7")
    page, answer = answered(gateway, message, role=role, wishes=True)
    assert (answer["op"], answer["level"], answer["id"]) == ("status", "error", "7")
    assert "therapy/wish" in answer["msg"]
    page.take(text("advertise", topic="/therapy/wish", type=kind, id="8"), 0)
    assert (sent(page), gateway.published) == ([], [])


# Calls -------------------------------------------------------------------------------------


PAUSE = text("call_service", service="/therapy_session/pause", id="c1")


@pytest.mark.parametrize("answer", [{"success": True}, ServiceError("none"), OSError("none")])
def test_a_call_is_answered_with_its_id_also_if_it_fails(gateway, answer):
    works = isinstance(answer, dict)

    def acts(page):
        page.take(PAUSE, 0)
        yield
        ((service, arguments, future),) = gateway.calls
        assert (service, arguments) == ("/therapy_session/pause", {})
        assert sent(page) == []
        (future.set_result if works else future.set_exception)(answer)
        yield

    assert run(gateway, acts) == [{
        "op": "service_response", "service": "/therapy_session/pause", "id": "c1",
        "values": answer if works else "none", "result": works,
    }]  # fmt: skip


def test_calls_without_answers_are_bounded(gateway):
    def acts(page):
        for _ in range(20):
            page.take(PAUSE, 0)
        yield
        assert len(gateway.calls) == 8
        assert len([answer for answer in sent(page) if answer["result"] is False]) == 12
        gateway.calls[0][2].set_result({"success": True})
        yield
        page.take(PAUSE, 0)
        yield

    run(gateway, acts)
    assert len(gateway.calls) == 9


def test_the_software_stop_needs_no_answers_to_other_calls(gateway):
    """A therapist presses Pause again and again as the session's node hangs, and then the stop."""
    def acts(page):
        for _ in range(20):
            page.take(PAUSE, 0)
        page.take(text("call_service", service="/supervisor/estop"), 0)
        yield

    run(gateway, acts)
    assert gateway.calls[-1][0] == "/supervisor/estop"


def test_wrong_content_is_told_and_frees_the_call(gateway):
    def acts(page):
        for _ in range(20):
            page.take(text("call_service", service="/therapy_session/start", args={"bad": 1}), 0)
            yield
        page.take(text("publish", topic="/therapy/attendance", msg={"bad": 1}), 0)

    answers = run(gateway, acts)
    assert all("bad: unknown field" in (a.get("values") or a.get("msg")) for a in answers)
    assert len(answers) == 21


# Actions -----------------------------------------------------------------------------------


def limits_set(*names):
    parameters = [{"name": name, "value": {"type": 3, "double_value": 20.0}} for name in names]
    return text("call_service", service="/therapy_session/set_parameters",
                args={"parameters": parameters})  # fmt: skip


@pytest.mark.parametrize(("asked", "answer", "action"), [
    (PAUSE, {"success": True}, ("pause", False)),
    (PAUSE, {"success": False, "message": "P-7K3QX: no"}, ("pause", True)),
    (PAUSE, ServiceError("nobody"), ("pause", True)),
    (text("call_service", service="/supervisor/estop"), {"success": True}, ("estop", False)),
    (limits_set("support.force"), {"results": [{"successful": True}]},
     ("set support.force", False)),
    (limits_set("wish.low", "wish.high"),
     {"results": [{"successful": True}, {"successful": False}]}, ("set wish.low wish.high", True)),
    (limits_set("wish.low"), ValueError("value: unknown field"), ("set_parameters", True)),
    (text("call_service", service="/therapy_session/get_parameters", args={"names": ["wish.low"]}),
     {"values": []}, None),
])  # fmt: skip
def test_what_a_call_was_for_and_how_it_ended_is_an_action(gateway, asked, answer, action):
    """Without values, and without the sentence of a refusal, which may name somebody."""
    def acts(page):
        page.take(asked, 0)
        yield
        ((_, _, future),) = gateway.calls
        fails = isinstance(answer, Exception)
        (future.set_exception if fails else future.set_result)(answer)
        yield

    (told,) = run(gateway, acts)
    assert told["result"] is not isinstance(answer, Exception)
    assert gateway.actions == ([("/", THERAPIST, *action)] if action else [])


def test_what_the_patient_touches_and_presses_is_an_action_of_his_page(gateway):
    page = client(gateway, PATIENT)
    page.take(text("publish", topic="/therapy/answer", msg={"data": 19}), 0)
    page.take(text("publish", topic="/therapy/action", msg={"msg": "language"}), 0)
    for wrong in ({"msg": "fresh"}, {"msg": "Erika Mustermann"}, {"msg": "stop"}, {"name": "back"}):
        page.take(text("publish", topic="/therapy/action", msg=wrong), 0)
    assert [told["level"] for told in sent(page)] == ["error"] * 4
    assert gateway.actions == [("/", PATIENT, "answer", False), ("/", PATIENT, "language", False)]
    assert gateway.published == [("/therapy/answer", {"data": 19})], "the page writes no Log"


# Bounds ------------------------------------------------------------------------------------


def wish(number):
    return text("publish", topic="/therapy/wish", msg={"number": number})


def test_a_flood_is_cut_off_with_a_sentence(gateway):
    page = client(gateway)
    message = text("publish", topic="/therapy/attendance", msg={})
    for _ in range(round(LIMITS.flood)):
        page.take(message, 0)
    with pytest.raises(CutOff, match="more than 500 messages a second"):
        page.take(message, 0)
    assert len(gateway.published) == LIMITS.burst


def test_a_steady_client_is_never_cut_off(gateway):
    page = client(gateway)
    for number in range(6000):  # a minute at the rate that is allowed
        page.take(text("publish", topic="/therapy/attendance", msg={}), number * 10 * MS)
    assert len(gateway.published) == 6000 and sent(page) == []


@pytest.mark.parametrize("rate", [60, 120, 144, 240, 480])
def test_a_game_that_wishes_with_each_picture_plays_on(gateway, rate):
    """For a minute; of what is too much the newest counts, and the game hears of it once."""
    page, told, oldest = client(gateway), [], 0
    for number in range(60 * rate):
        now_ns = number * 1_000_000_000 // rate
        page.take(wish(number), now_ns)
        told += sent(page, now_ns)
        oldest = max(oldest, number - gateway.published[-1][1]["number"])
    carried_out = [content["number"] for _, content in gateway.published]
    assert carried_out == sorted(carried_out)
    most = min(60 * rate, 60 * LIMITS.messages + LIMITS.burst)
    assert abs(len(carried_out) - most) <= 2
    assert oldest <= -(-rate // round(LIMITS.messages))
    if rate <= LIMITS.messages:
        assert told == []
    else:
        ((op, level, what),) = [tuple(each.values()) for each in told]
        assert (op, level) == ("status", "warning")
        assert "more than 100 messages a second: of each topic the newest counts" in what


def test_the_last_wish_of_too_many_still_goes_out(gateway):
    page = client(gateway)
    for number in range(400):
        page.take(wish(number), 0)
    assert gateway.published[-1][1] == {"number": LIMITS.burst - 1}
    sent(page, 5 * MS)
    assert gateway.published[-1][1] == {"number": LIMITS.burst - 1}  # not yet allowed
    sent(page, 10 * MS)
    assert gateway.published[-1][1] == {"number": 399}
    sent(page, 1000 * MS)
    assert len(gateway.published) == LIMITS.burst + 1


def test_a_wish_that_had_to_wait_is_forgotten_for_a_newer_one(gateway):
    page = client(gateway)
    for number in range(400):
        page.take(wish(number), 0)
    page.take(wish(400), 10 * MS)
    sent(page, 1000 * MS)
    assert [each["number"] for _, each in gateway.published[-2:]] == [LIMITS.burst - 1, 400]


def test_a_wrong_wish_that_had_to_wait_is_told(gateway):
    page = client(gateway)
    for number in range(400):
        page.take(wish(number), 0)
    page.take(text("publish", topic="/therapy/wish", msg={"bad": 1}), 0)
    assert [each["level"] for each in sent(page, 10 * MS)] == ["warning", "error"]


def test_in_excess_a_call_is_refused_with_a_response_but_not_the_software_stop(gateway):
    def acts(page):
        for number in range(400):
            page.take(wish(number), 0)
        page.take(PAUSE, 0)
        page.take(text("call_service", service="/supervisor/estop"), 0)
        yield

    _, answer = run(gateway, acts)
    assert (answer["id"], answer["result"]) == ("c1", False)
    assert "not carried out" in answer["values"]
    assert [service for service, *_ in gateway.calls] == ["/supervisor/estop"]


def test_answers_nobody_fetches_do_not_pile_up(gateway):
    page = client(gateway, limits=Limits(messages=1000.0))
    for number in range(10_000):
        page.take("nonsense", number * 2 * MS)
    assert len(page.texts(0)) <= 64


@given(st.lists(st.tuples(
    st.sampled_from(["subscribe", "unsubscribe", "advertise", "publish", "call_service", "x"]),
    st.sampled_from(["/endpoint_state", "setpoint", "/therapy/wish", "/supervisor/estop",
                     "/therapy_session/set_parameters", "", "/", "💥"]),
    st.sampled_from([{}, {"names": ["folder"]}, {"bad": 1}, [], None, 5]),
), max_size=30), st.sampled_from([PATIENT, THERAPIST]))  # fmt: skip
def test_whatever_comes_is_answered_and_nothing_else_happens(operations, role):
    gateway = FakeGateway()

    def acts(page):
        for op, name, content in operations:
            page.take(text(op, topic=name, service=name, msg=content, args=content), 0)
        yield

    for answer in run(gateway, acts, role):
        assert answer["op"] in ("status", "service_response")
    assert {topic for topic, _ in gateway.published} <= {"/therapy/wish"}
    assert role == THERAPIST or not gateway.published
    assert {service for service, *_ in gateway.calls} <= {"/supervisor/estop"}
    assert role == THERAPIST or not gateway.calls
