# SPDX-License-Identifier: Apache-2.0
"""A page's start of a session goes out only after the session has received its attendance."""

from __future__ import annotations

import asyncio
from concurrent.futures import Future
from types import SimpleNamespace

import pytest

from screw_module_ros.bridge.client import ServiceError
from screw_module_ros.bridge.rights import Rights
from screw_module_ros.nodes import bridge_gateway
from screw_module_ros.nodes.bridge_gateway import BridgeGateway

START, RESUME = "/therapy_session/start", "/therapy_session/resume"
ATTENDANCE = "/therapy/attendance"


class Sent:
    """Publishers and clients of a node; `acked`: whether the subscribers acknowledge.

    looks: of the gateway, at whether a subscriber is there; later: called at each of them.
    """

    def __init__(self):
        self.words, self.subscribers, self.acked, self.looks = [], 1, True, 0
        self.later = lambda looks: None
        self.gateway = BridgeGateway(self, Rights(["/"]), 0.01)

    def create_publisher(self, kind, topic, profile):
        return SimpleNamespace(
            msg_type=kind,
            publish=lambda message: self.words.append(topic),
            get_subscription_count=lambda: self.subscribers,
            wait_for_all_acked=lambda timeout: self.acked,
        )

    def create_client(self, kind, service):
        future = Future()
        return SimpleNamespace(
            srv_type=kind,
            service_is_ready=self.look,
            call_async=lambda request: self.words.append(service) or future,
            remove_pending_request=lambda future: None,
        )

    def create_subscription(self, *given, **more):
        return None

    def look(self):
        self.looks += 1
        self.later(self.looks)
        return True

    def call(self, service, **arguments):
        """Call; return why there is no answer: a service of this node never gives one."""
        with pytest.raises(ServiceError) as error:
            asyncio.run(self.gateway.call(service, arguments))
        return str(error.value)


@pytest.fixture
def sent(monkeypatch):
    monkeypatch.setattr(bridge_gateway, "_CHECK_S", 0.0)
    return Sent()


def start(sent):
    return sent.call(START, protocol="reach_3d", patient="P-22222", record=False)


def test_an_attendance_goes_ahead_of_the_start(sent):
    assert start(sent) == f"{START} did not answer within 0.01 s"
    assert sent.words == [ATTENDANCE, ATTENDANCE, START]


def test_a_start_waits_until_the_attendance_has_arrived(sent):
    """The middleware of the session may discover the page's publisher after the page's service."""
    sent.acked, before = False, []

    def later(looks):
        if looks == 3:
            before.extend(sent.words)
            sent.acked = True

    sent.later = later
    start(sent)
    assert before == [ATTENDANCE]
    assert sent.words == [ATTENDANCE, ATTENDANCE, START], "a fresh one, too"


def test_a_start_waits_until_a_session_hears(sent):
    sent.subscribers, before = 0, []

    def later(looks):
        if looks == 3:
            before.extend(sent.words)
            sent.subscribers = 1

    sent.later = later
    start(sent)
    assert before == [] and sent.looks == 3
    assert sent.words == [ATTENDANCE, ATTENDANCE, START]


def test_a_start_that_nobody_hears_is_given_up(sent, monkeypatch):
    monkeypatch.setattr(bridge_gateway, "_FOUND_S", 0.0)
    sent.subscribers = 0
    assert "nobody offers" in start(sent)
    assert sent.words == []


def test_a_frozen_recorder_does_not_keep_a_session_from_being_resumed(sent, monkeypatch):
    """It subscribes to every topic, and acknowledges nothing until its lease has ended."""
    monkeypatch.setattr(bridge_gateway, "_FOUND_S", 0.0)
    sent.acked = False
    sent.call(RESUME)
    assert sent.words[-2:] == [ATTENDANCE, RESUME]


def test_other_calls_wait_for_nobody(sent):
    sent.acked, sent.subscribers = False, 0
    sent.call("/therapy_session/pause")
    assert sent.words == ["/therapy_session/pause"]


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
