# SPDX-License-Identifier: Apache-2.0
"""What the bridge tells a page that connects: the robot of now, not one that has died since."""

from __future__ import annotations

import json
from types import SimpleNamespace

from screw_module_msgs.msg import TherapyState

from screw_module_ros.nodes import bridge_gateway
from screw_module_ros.nodes.bridge_gateway import PolledTopic
from screw_module_ros.nodes.support import topics

S = 1_000_000_000


def polled(waiting, kept=False):
    """Return a topic whose subscription has these messages, [(message, time of arrival [ns])]."""

    def take_message(kind, raw):
        if not waiting:
            return None
        message, arrived_ns = waiting.pop(0)
        return message, {"received_timestamp": arrived_ns}

    subscription = SimpleNamespace(handle=SimpleNamespace(take_message=take_message))
    node = SimpleNamespace(create_subscription=lambda *given, **more: subscription)
    kind = "screw_module_msgs/msg/TherapyState"
    return PolledTopic(node, "/therapy/state", kind, topics.SAMPLE, None, kept)


def test_a_message_of_a_node_that_has_died_is_no_news():
    waiting = [(TherapyState(state=TherapyState.RUNNING), 100 * S)]
    topic = polled(waiting)
    topic.poll()
    number, text = topic.newest(100 * S + 10_000_000)
    assert (number, json.loads(text)["state"]) == (1, TherapyState.RUNNING)
    assert topic.newest(102 * S) is None
    waiting.append((TherapyState(state=TherapyState.IDLE), 103 * S))
    topic.poll()
    assert topic.newest(103 * S)[0] == 2


def test_a_message_that_waited_until_a_client_came_is_as_old_as_it_is():
    topic = polled([(TherapyState(state=TherapyState.RUNNING), 100 * S)])
    topic.poll()  # the first client, an hour later
    assert topic.newest(3700 * S) is None


def test_a_result_stays():
    topic = polled([(TherapyState(), 100 * S)], kept=True)
    topic.poll()
    assert topic.newest(3700 * S)[0] == 1 and len(topic.history()) == 1


def test_who_asks_for_the_history_again_and_again_holds_nobody_up(monkeypatch):
    """Each request converted up to 1100 messages in the server's thread, 0.1 s long."""
    converted = []
    text = bridge_gateway._text
    monkeypatch.setattr(
        bridge_gateway, "_text", lambda message: converted.append(1) or text(message)
    )
    topic = polled([(TherapyState(trial=number), 100 * S) for number in (1, 2, 3)], kept=True)
    topic.poll()
    histories = [topic.history() for _ in range(10)]
    assert [json.loads(each)["trial"] for each in histories[-1]] == [1, 2, 3]
    assert len(converted) == 3, "once each"
