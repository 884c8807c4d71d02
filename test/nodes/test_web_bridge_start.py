# SPDX-License-Identifier: Apache-2.0
"""How `web_bridge` starts, and when it refuses to."""

from __future__ import annotations

import asyncio
import json
import socket
import stat

import aiohttp
import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from screw_module_msgs.msg import EndpointState, TherapyState, TrialResult
from std_msgs.msg import Empty


@pytest.fixture
def bridge(make_node, tmp_path):
    """Return a maker of connected bridges, on any port, with tokens of their own."""
    made = []

    def make(*words: str):
        tokens = f"token_file:={tmp_path}/state/tokens.json"
        made.append(make_node("web_bridge", "-p", "port:=0", "-p", tokens, *words))
        made[-1].connect()
        return made[-1]

    yield make
    for node in made:
        node.disconnect()


REFUSED = [
    *(([f"address:={address}"], "name a certificate and its key, or listen on 127.0.0.1")
      for address in ("0.0.0.0", "192.168.7.7", "'::'", "robot.example")),
    (["address:=0.0.0.0", "certificate:={folder}/none.pem"], "none.pem: there is no such file"),
    (["robots:=[left, /left/]"], "/left is named twice"),
    (["robots:=['1 2']"], "is no namespace"),
    (["token_file:={folder}/tokens.json"], "chmod 700"),  # a folder that others can read
]  # fmt: skip


@pytest.mark.parametrize(("given", "told"), REFUSED)
def test_what_it_does_not_start_with(make_node, tmp_path, given, told):
    tmp_path.chmod(0o755)
    words = [word for each in given for word in ("-p", each.format(folder=tmp_path))]
    node = make_node("web_bridge", *words)
    with pytest.raises((ValueError, OSError)) as error:
        node.connect()
    node.disconnect()
    assert told in str(error.value)


def test_it_serves_while_it_is_active_and_only_then(bridge, tmp_path):
    node = bridge()
    node.begin()
    address = node.health().values["address"]
    assert address.startswith("http://127.0.0.1:")
    file = tmp_path / "state" / "tokens.json"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    node.end()

    async def ask():
        async with aiohttp.ClientSession() as session:
            await session.get(address)

    with pytest.raises(aiohttp.ClientConnectionError):
        asyncio.run(ask())


def test_a_port_that_is_taken_is_told_with_the_way_out(bridge):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        node = bridge("-p", f"port:={port}")
        with pytest.raises(OSError, match=f"port {port}: .*choose another port"):
            node.begin()
        node.end()


def test_two_robots_are_heard_and_told_apart(bridge, wait_until):
    node = bridge("-p", "robots:=[left, right]")
    gateway = node._gateway
    publisher = node.create_publisher(EndpointState, "/right/endpoint_state", 1)

    def seen():
        publisher.publish(EndpointState(sequence=7))
        gateway.poll()
        return gateway.after("/right/endpoint_state", 0)

    wait_until(seen)
    assert json.loads(seen()[0][1])["sequence"] == 7
    assert gateway.after("/left/endpoint_state", 0) == []
    heard = node.create_subscription(Empty, "/left/therapy/attendance", lambda _: None, 1)

    def attended():
        gateway.publish("/left/therapy/attendance", {})
        return heard.handle.take_message(Empty, False)

    wait_until(attended)


def test_the_results_of_a_session_are_kept_until_it_ends(bridge, wait_until):
    """1100 were, from patient to patient, and each patient's token could read them."""
    node = bridge()
    gateway = node._gateway
    results = node.create_publisher(TrialResult, "/therapy/trial", 10)
    states = node.create_publisher(TherapyState, "/therapy/state", 10)
    wait_until(lambda: results.get_subscription_count() and states.get_subscription_count())
    for trial in (1, 2, 3):
        results.publish(TrialResult(trial=trial))

    def kept():
        """Return what a page would get that subscribes now."""
        gateway.poll()
        new = gateway.after("/therapy/trial", gateway.begin("/therapy/trial"))
        return [json.loads(text)["trial"] for _, text in new]

    wait_until(lambda: len(kept()) == 3)
    assert kept() == [1, 2, 3]

    def is_over():
        states.publish(TherapyState(state=TherapyState.FINISHED))
        return kept() == []

    wait_until(is_over)
    assert [number for number, _ in gateway.after("/therapy/trial", 1)] == [2, 3], (
        "who has subscribed before gets the last ones"
    )


def test_wishes_of_the_patient_can_be_allowed_and_taken_back(make_node, tmp_path):
    node = make_node("web_bridge", "-p", f"token_file:={tmp_path}/s/tokens.json")
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert not node._rights.wishes
    assert node.parameters.write(wishes=True) == ""
    assert node._rights.wishes
    assert node.parameters.write(wishes=False) == ""
    assert not node._rights.wishes
    assert "fixed once the node has started" in node.parameters.write(address="0.0.0.0")
    assert node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
