# SPDX-License-Identifier: Apache-2.0
"""The page that `bench --bridge` connects, against the real server."""

from __future__ import annotations

import pytest
from fake_gateway import FakeGateway, Served

from screw_module_ros.bridge.rights import Rights
from screw_module_ros.bridge.server import Server
from screw_module_ros.bridge.settings import Limits, Listening
from screw_module_ros.bridge.tokens import Tokens
from screw_module_ros.clock import WallClock
from screw_module_ros.resources import resource_path
from screw_module_ros.trials.benchmark.page import SUBSCRIBED, PageReader

TOKENS = Tokens("p" * 32, "t" * 32)
DEADLINE_S = 20.0


@pytest.fixture
def serving():
    robot = FakeGateway()
    made = Server(Listening(port=0), Limits(), TOKENS, Rights(("/",)), robot, WallClock(), {})
    with Served(made) as server:
        yield server, robot


def test_it_reads_what_the_robot_tells(serving, wait_until):
    server, robot = serving
    with PageReader(server.address, TOKENS.patient) as page:

        def heard():
            robot.tell("/endpoint_state", {"x": page.received})
            return page.received >= 5

        wait_until(heard, DEADLINE_S)
        assert page.error is None
    assert not page._thread.is_alive()


@pytest.mark.parametrize(
    ("token", "topics", "why"),
    [("x" * 32, SUBSCRIBED, "403"), (TOKENS.patient, ("safety_state",), "may not subscribe")],
)
def test_it_tells_why_it_reads_nothing(serving, wait_until, token, topics, why):
    server, _ = serving
    with PageReader(server.address, token, topics) as page:
        wait_until(lambda: page.error is not None, DEADLINE_S)
    assert why in str(page.error)


def test_it_reads_the_topics_of_the_patients_page():
    script = resource_path("screw_module_ros/bridge/pages/static/js/patient/main.js")
    for topic in SUBSCRIBED:
        assert f'bridge.subscribe(named(robot, "{topic}")' in script.read_text()
