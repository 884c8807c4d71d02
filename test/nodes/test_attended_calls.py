# SPDX-License-Identifier: Apache-2.0
"""A page's start of a session goes out only after the session has received its attendance."""

from __future__ import annotations

from concurrent.futures import Future
from types import SimpleNamespace

import pytest

from screw_module_ros.bridge.rights import Rights
from screw_module_ros.nodes import bridge_gateway
from screw_module_ros.nodes.bridge_gateway import BridgeGateway

START = "/therapy_session/start"
S = 1_000_000_000


class Sent:
    """Publishers and clients of a node; `acked`: whether the subscribers acknowledge."""

    def __init__(self):
        self.words, self.subscribers, self.acked, self.now_ns = [], 1, True, 0

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
            service_is_ready=lambda: True,
            call_async=lambda request: self.words.append(service) or future,
        )

    def create_subscription(self, *given, **more):
        return None


@pytest.fixture
def sent(monkeypatch):
    sent = Sent()
    clock = SimpleNamespace(now_ns=lambda: sent.now_ns)
    monkeypatch.setattr(bridge_gateway, "WallClock", lambda: clock)
    timers = SimpleNamespace(every=lambda clock, period, act: None)
    sent.gateway = BridgeGateway(sent, Rights(["/"]), timers, 5.0)
    sent.answers = []
    return sent


def start(sent):
    request = {"protocol": "reach_3d", "patient": "P-22222", "record": False}
    sent.gateway.call(START, request, lambda values, result: sent.answers.append(values))


def test_an_attendance_goes_ahead_of_the_start(sent):
    start(sent)
    assert sent.words == ["/therapy/attendance", "/therapy/attendance", START]


def test_a_start_waits_until_the_attendance_has_arrived(sent):
    """The middleware of the session may discover the page's publisher after the page's service."""
    sent.acked = False
    start(sent)
    sent.gateway._check_calls()
    assert sent.words == ["/therapy/attendance"]
    sent.acked = True
    sent.gateway._check_calls()
    assert sent.words == ["/therapy/attendance", "/therapy/attendance", START], "a fresh one, too"
    assert sent.answers == []


def test_a_start_waits_until_a_session_hears(sent):
    sent.subscribers = 0
    start(sent)
    assert sent.words == []
    sent.subscribers = 1
    sent.gateway._check_calls()
    assert sent.words == ["/therapy/attendance", "/therapy/attendance", START]


def test_a_start_that_nobody_hears_is_given_up(sent):
    sent.subscribers = 0
    start(sent)
    sent.now_ns = 6 * S
    sent.gateway._check_calls()
    (answer,) = sent.answers
    assert "nobody offers" in answer and sent.words == []


def test_a_frozen_recorder_does_not_keep_a_session_from_being_resumed(sent):
    """It subscribes to every topic, and acknowledges nothing until its lease has ended."""
    sent.acked = False
    sent.gateway.call("/therapy_session/resume", {}, lambda values, result: None)
    sent.now_ns = 6 * S
    sent.gateway._check_calls()
    assert sent.words[-2:] == ["/therapy/attendance", "/therapy_session/resume"]


def test_other_calls_wait_for_nobody(sent):
    sent.acked, sent.subscribers = False, 0
    sent.gateway.call("/therapy_session/pause", {}, lambda *given: None)
    assert sent.words == ["/therapy_session/pause"]
