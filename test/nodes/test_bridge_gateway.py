# SPDX-License-Identifier: Apache-2.0
"""What the bridge tells a page, and calls for it: the robot of now, not one that has died since."""

from __future__ import annotations

import asyncio
import json
from concurrent.futures import Future
from types import SimpleNamespace

import pytest
from rcl_interfaces.msg import Log
from screw_module_msgs.msg import TherapyState

from screw_module_ros.bridge.client import ServiceError
from screw_module_ros.bridge.rights import Rights
from screw_module_ros.nodes import bridge_gateway
from screw_module_ros.nodes.bridge_gateway import BridgeGateway, KeptTopic, PolledTopic
from screw_module_ros.nodes.support import topics

S = 1_000_000_000


def polled(waiting, made=PolledTopic, **more):
    """Return a topic whose subscription has these messages, [(message, time of arrival [ns])]."""

    def take_message(kind, raw):
        if not waiting:
            return None
        message, arrived_ns = waiting.pop(0)
        return message, {"received_timestamp": arrived_ns}

    subscription = SimpleNamespace(handle=SimpleNamespace(take_message=take_message))
    node = SimpleNamespace(create_subscription=lambda *given, **more: subscription)
    kind = "screw_module_msgs/msg/TherapyState"
    return made(node, "/therapy/state", kind, topics.SAMPLE, None, **more)


def kept(waiting):
    return polled(waiting, KeptTopic, rising=("trial",))


def shown(topic):
    """Return the trials of which a page is told that subscribes now."""
    return [json.loads(text)["trial"] for _, text in topic.after(topic.begin(), 3700 * S)]


def test_a_message_of_a_node_that_has_died_is_no_news():
    waiting = [(TherapyState(state=TherapyState.RUNNING), 100 * S)]
    topic = polled(waiting)
    topic.poll()
    ((number, text),) = topic.after(0, 100 * S + 10_000_000)
    assert (number, json.loads(text)["state"]) == (1, TherapyState.RUNNING)
    assert topic.after(0, 102 * S) == []
    waiting.append((TherapyState(state=TherapyState.IDLE), 103 * S))
    topic.poll()
    ((number, _),) = topic.after(1, 103 * S)
    assert number == 2 and topic.after(2, 103 * S) == []


def test_a_message_that_waited_until_a_client_came_is_as_old_as_it_is():
    topic = polled([(TherapyState(state=TherapyState.RUNNING), 100 * S)])
    topic.poll()  # the first client, an hour later
    assert topic.after(0, 3700 * S) == []


def test_a_result_stays():
    topic = kept([(TherapyState(trial=1), 100 * S)])
    topic.poll()
    assert shown(topic) == [1]


def test_the_results_of_another_session_are_not_shown():
    topic = kept([(TherapyState(trial=number), 100 * S) for number in (1, 2, 3)])
    topic.poll()
    assert shown(topic) == [1, 2, 3]
    topic.forget()
    assert shown(topic) == []
    topic = kept([(TherapyState(trial=number), 100 * S) for number in (1, 2, 3, 1, 2)])
    topic.poll()
    assert shown(topic) == [1, 2], "a trial number that does not rise is of another session"
    topic = kept([(TherapyState(trial=number), 100 * S) for number in (1, 2, 3, 3)])
    topic.poll()
    assert shown(topic) == [3]


def test_who_asks_for_the_results_again_and_again_holds_nobody_up(monkeypatch):
    """Each request converted up to 1100 messages in the server's thread, 0.1 s long."""
    converted = []
    as_json = bridge_gateway.as_json
    monkeypatch.setattr(
        bridge_gateway, "as_json", lambda message: converted.append(1) or as_json(message)
    )
    topic = kept([(TherapyState(trial=number), 100 * S) for number in (1, 2, 3)])
    topic.poll()
    assert [shown(topic) for _ in range(10)] == [[1, 2, 3]] * 10
    assert len(converted) == 3, "once each"


RESUME = "/therapy_session/resume"


class Sent:
    """Publishers and clients of a node; ready: whether the services are offered.

    looks: of the gateway, at whether they are; later: called at each of them. states: of a session,
    that the gateway takes with its next look; actions: what it has published of them.
    """

    def __init__(self):
        self.words, self.requests, self.ready, self.looks = [], [], True, 0
        self.later = lambda looks: None
        self.states: list[TherapyState] = []
        self.actions: list[str] = []
        self.gateway = BridgeGateway(self, Rights(["/"]), 0.01)

    def create_publisher(self, kind, topic, profile):
        def publish(message):
            self.words.append(topic)
            if isinstance(message, Log):
                self.actions.append(f"{message.name} {message.msg} {message.level}")

        return SimpleNamespace(msg_type=kind, publish=publish)

    def stamp(self, log):
        """It is always the same time."""

    def create_client(self, kind, service):
        future = Future()
        return SimpleNamespace(
            srv_type=kind,
            service_is_ready=self.look,
            call_async=lambda request: (
                self.words.append(service) or self.requests.append(request) or future
            ),
            remove_pending_request=lambda future: None,
        )

    def create_subscription(self, kind, name, *given, **more):
        def take_message(kind, raw):
            waits = kind is TherapyState and self.states
            return (self.states.pop(0), {"received_timestamp": 0}) if waits else None

        return SimpleNamespace(handle=SimpleNamespace(take_message=take_message))

    def look_after(self, *states, times=1):
        """Let the gateway poll some times, after a session has told its states."""
        self.states += states
        for _ in range(times):
            self.gateway.poll()

    def look(self):
        self.looks += 1
        self.later(self.looks)
        return self.ready

    def call(self, service, **arguments):
        """Call; return why there is no answer: a service of this node never gives one."""
        with pytest.raises(ServiceError) as error:
            asyncio.run(self.gateway.call(service, arguments))
        return str(error.value)


@pytest.fixture
def sent(monkeypatch):
    monkeypatch.setattr(bridge_gateway, "_CHECK_S", 0.0)
    monkeypatch.setattr(bridge_gateway, "is_served", lambda _, client: client.service_is_ready())
    return Sent()


def test_actions_wait_for_the_bag_of_a_session(sent):
    """The start itself is done before the recording begins, and so is what was refused before."""
    act, recorded = sent.gateway.act, TherapyState(state=TherapyState.RUNNING, recorded=True)
    sent.look_after()
    act("/", "therapist", "start", True)
    sent.look_after(TherapyState(state=TherapyState.IDLE))
    act("/", "patient", "sound")
    act("/", "therapist", "start")
    sent.look_after(TherapyState(state=TherapyState.STARTING), times=5)
    act("/", "patient", "language")
    assert sent.actions == []
    sent.look_after(recorded)
    assert sent.actions == ["patient language 20", "therapist start 30"], "one of each page"
    sent.look_after(times=5)
    assert sent.actions[2:] == ["therapist start 20"]
    act("/", "therapist", "abort")
    sent.look_after(TherapyState(state=TherapyState.ABORTED, recorded=True))
    assert sent.actions[3:] == ["therapist abort 20"]


@pytest.mark.parametrize("state", [TherapyState.RUNNING, TherapyState.PAUSED])
def test_actions_of_a_session_without_a_recording_come_into_no_other_bag(sent, state):
    sent.gateway.act("/", "therapist", "start")
    sent.look_after(TherapyState(state=state))
    sent.look_after(TherapyState(state=TherapyState.RUNNING, recorded=True), times=3)
    assert sent.actions == []


def test_a_flood_of_actions_fills_no_bag_and_hides_none_of_another_page(sent):
    """Of a page the newest hundred wait, and one goes out with each look."""
    sent.look_after(TherapyState(state=TherapyState.STARTING))
    for number in range(5000):
        sent.gateway.act("/", "patient", f"{number}")
        sent.gateway.act("/", "therapist", "pause") if number == 0 else None
    sent.look_after(TherapyState(state=TherapyState.RUNNING, recorded=True), times=5000)
    assert sent.actions[:2] == ["patient 4900 20", "therapist pause 20"]
    assert len(sent.actions) == 101 and sent.actions[-1] == "patient 4999 20"


def test_a_call_waits_until_its_node_is_found(sent):
    sent.ready, before = False, []

    def later(looks):
        if looks == 3:
            before.extend(sent.words)
            sent.ready = True

    sent.later = later
    assert sent.call(RESUME) == f"{RESUME} did not answer within 0.01 s"
    assert before == [] and sent.words == [RESUME]


@pytest.mark.parametrize("said", [{}, {"attended": False}])
def test_whoever_starts_a_session_through_the_bridge_attends_it(sent, said):
    sent.call("/therapy_session/start", protocol="reach_3d", patient="P-22222", **said)
    assert [request.attended for request in sent.requests] == [True]


def test_a_call_that_nobody_offers_is_given_up(sent, monkeypatch):
    monkeypatch.setattr(bridge_gateway, "_FOUND_S", 0.0)
    sent.ready = False
    assert sent.call(RESUME) == f"nobody offers {RESUME}: is its node running?"
    assert sent.words == []


def test_an_answer_comes_from_another_thread(sent):
    answer = SimpleNamespace(get_fields_and_field_types=lambda: {"success": "boolean"},
                             success=True)  # fmt: skip
    client = sent.gateway._clients["/therapy_session/pause"]
    future = client.call_async(None)

    async def play():
        call = asyncio.ensure_future(sent.gateway.call("/therapy_session/pause", {}))
        await asyncio.get_running_loop().run_in_executor(None, future.set_result, answer)
        return await call

    sent.gateway._answer_s = 20.0
    assert asyncio.run(play()) == {"success": True}
