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

from screw_module_ros.bridge.client import ServiceError
from screw_module_ros.nodes import bridge_gateway
from screw_module_ros.settings import SettingError


@pytest.fixture
def refused(make_node):
    """Return `refused(*ros_args)`: the sentence with which configuring is refused."""

    def refuse(*ros_args):
        node = make_node("web_bridge", *ros_args)
        with pytest.raises((ValueError, OSError)) as error:
            node.connect()
        node.disconnect()
        return str(error.value)

    return refuse


@pytest.mark.parametrize("address", ["0.0.0.0", "192.168.7.7", "'::'", "robot.example"])
def test_no_other_address_without_tls(refused, address):
    told = refused("-p", f"address:={address}")
    assert "name a certificate and its key, or listen on 127.0.0.1" in told


def test_a_certificate_that_is_not_there_is_named(refused, tmp_path):
    told = refused("-p", "address:=0.0.0.0", "-p", f"certificate:={tmp_path}/none.pem")
    assert "none.pem: there is no such file" in told


@pytest.mark.parametrize(("robots", "told"), [
    ("[left, /left/]", "/left is named twice"), ("['1 2']", "is no namespace"),
])  # fmt: skip
def test_robots_that_cannot_be_are_named(refused, robots, told):
    assert told in refused("-p", f"robots:={robots}")


def test_tokens_that_others_can_read_are_refused(refused, tmp_path):
    (tmp_path / "open").mkdir(mode=0o755)
    (tmp_path / "open").chmod(0o755)
    file = tmp_path / "open" / "tokens.json"
    file.write_text("{}")
    assert "chmod 700" in refused("-p", f"token_file:={file}")


@pytest.mark.parametrize("given", ["port:=70000", "limits.rate:=1000.0", "limits.size:=1"])
def test_values_out_of_range_are_refused(make_node, given):
    with pytest.raises(SettingError, match=given.split(":=")[0]):
        make_node("web_bridge", "-p", given)


def test_it_serves_while_it_is_active_and_only_then(make_node, tmp_path):
    file = tmp_path / "state" / "tokens.json"
    node = make_node("web_bridge", "-p", "port:=0", "-p", f"token_file:={file}")
    node.connect()
    node.begin()
    address = node._server.address
    assert address.startswith("http://127.0.0.1:")
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    health = node.health()
    assert health.values["address"] == address
    node.end()
    node.disconnect()

    async def ask():
        async with aiohttp.ClientSession() as session:
            await session.get(address)

    with pytest.raises(aiohttp.ClientConnectionError):
        asyncio.run(ask())


def test_a_port_that_is_taken_is_told_with_the_way_out(make_node, tmp_path):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        node = make_node(
            "web_bridge", "-p", f"port:={port}", "-p", f"token_file:={tmp_path}/s/tokens.json"
        )
        node.connect()
        with pytest.raises(OSError, match=f"port {port}: .*choose another port"):
            node.begin()
        node.end()
        node.disconnect()


def test_two_robots_are_heard_and_told_apart(make_node, tmp_path, wait_until):
    node = make_node(
        "web_bridge", "-p", "port:=0", "-p", f"token_file:={tmp_path}/s/tokens.json",
        "-p", "robots:=[left, right]",
    )  # fmt: skip
    node.connect()
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
    node.disconnect()


def test_a_service_that_nobody_offers_is_told(make_node, tmp_path, monkeypatch):
    monkeypatch.setattr(bridge_gateway, "_FOUND_S", 0.0)
    node = make_node("web_bridge", "-p", "port:=0", "-p", f"token_file:={tmp_path}/s/tokens.json")
    node.connect()
    with pytest.raises(ServiceError) as error:
        asyncio.run(node._gateway.call("/supervisor/estop", {}))
    assert str(error.value) == "nobody offers /supervisor/estop: is its node running?"
    node.disconnect()


def test_the_results_of_a_session_are_kept_until_it_ends(make_node, tmp_path, wait_until):
    """1100 were, from patient to patient, and each patient's token could read them."""
    node = make_node("web_bridge", "-p", "port:=0", "-p", f"token_file:={tmp_path}/s/tokens.json")
    node.connect()
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
    node.disconnect()


def test_wishes_of_the_patient_can_be_allowed_and_taken_back(make_node, tmp_path):
    node = make_node("web_bridge", "-p", "port:=0", "-p", f"token_file:={tmp_path}/s/tokens.json")
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert not node._rights.wishes
    assert node.parameters.write(wishes=True) == ""
    assert node._rights.wishes
    assert node.parameters.write(wishes=False) == ""
    assert not node._rights.wishes
    assert "fixed once the node has started" in node.parameters.write(address="0.0.0.0")
    assert node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
