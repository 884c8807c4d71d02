# SPDX-License-Identifier: Apache-2.0
"""A call of a page goes out once its node is found, and its answer comes from another thread."""

from __future__ import annotations

import asyncio
from concurrent.futures import Future
from types import SimpleNamespace

import pytest

from screw_module_ros.bridge.client import ServiceError
from screw_module_ros.bridge.rights import Rights
from screw_module_ros.nodes import bridge_gateway
from screw_module_ros.nodes.bridge_gateway import BridgeGateway

RESUME = "/therapy_session/resume"


class Sent:
    """Publishers and clients of a node; ready: whether the services are offered.

    looks: of the gateway, at whether they are; later: called at each of them.
    """

    def __init__(self):
        self.words, self.requests, self.ready, self.looks = [], [], True, 0
        self.later = lambda looks: None
        self.gateway = BridgeGateway(self, Rights(["/"]), 0.01)

    def create_publisher(self, kind, topic, profile):
        return SimpleNamespace(msg_type=kind, publish=lambda message: self.words.append(topic))

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

    def create_subscription(self, *given, **more):
        return None

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
    assert "nobody offers" in sent.call(RESUME)
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
