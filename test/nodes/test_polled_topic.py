# SPDX-License-Identifier: Apache-2.0
"""What the bridge tells a page that connects: the robot of now, not one that has died since."""

from __future__ import annotations

import json
from types import SimpleNamespace

from screw_module_msgs.msg import TherapyState

from screw_module_ros.nodes import bridge_gateway
from screw_module_ros.nodes.bridge_gateway import KeptTopic, PolledTopic
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
