# SPDX-License-Identifier: Apache-2.0
"""How the recorder takes a topic that was named, and which nodes have not told their parameters."""

from __future__ import annotations

from types import SimpleNamespace
from unittest.mock import Mock

import pytest
from rclpy.duration import Infinite
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.type_hash import TypeHash

from screw_module_ros.nodes.recording_parameters import NodeParameters
from screw_module_ros.nodes.recording_topics import Taps, offered_by, satisfying
from screw_module_ros.recording.definitions import UNKNOWN
from screw_module_ros.recording.recorder import NO_ANSWER

RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
LATCHED, VOLATILE = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE


def offer(reliability, durability):
    profile = QoSProfile(depth=1, reliability=reliability, durability=durability)
    return TopicEndpointInfo(qos_profile=profile)


@pytest.mark.parametrize(
    ("offers", "reliability", "durability"),
    [
        ([(RELIABLE, VOLATILE)], RELIABLE, VOLATILE),
        ([(RELIABLE, LATCHED), (RELIABLE, LATCHED)], RELIABLE, LATCHED),
        ([(RELIABLE, LATCHED), (RELIABLE, VOLATILE)], RELIABLE, VOLATILE),
        ([(RELIABLE, VOLATILE), (BEST_EFFORT, VOLATILE)], BEST_EFFORT, VOLATILE),
    ],
)
def test_request_is_as_strict_as_all_offers_allow(offers, reliability, durability):
    assert satisfying("/scan", [offer(*each) for each in offers]) == (reliability, durability)


def test_log_lines_of_the_last_session_are_left_out():
    """They name its bag, and so its patient."""
    assert satisfying("/rosout", [offer(RELIABLE, LATCHED)]) == (RELIABLE, VOLATILE)


def test_offer_in_rosbag2s_words():
    told = offer(BEST_EFFORT, LATCHED)
    told.qos_profile.deadline = told.qos_profile.lifespan = Infinite
    told.qos_profile.liveliness_lease_duration = Infinite
    found = offered_by(told)
    assert (found["reliability"], found["durability"]) == ("best_effort", "transient_local")
    assert found["deadline"] == found["lifespan"] == {"sec": 9223372036, "nsec": 854775807}


def test_messages_of_another_version_are_recorded_without_a_definition():
    """With the one that is installed here they would be decoded to garbage."""
    said = []
    log = SimpleNamespace(error=said.append)
    taps = SimpleNamespace(_node=SimpleNamespace(get_logger=lambda: log))
    tap = SimpleNamespace(name="/x", type="screw_module_msgs/msg/EncoderSample")
    told = offer(RELIABLE, VOLATILE)
    told.topic_type_hash = TypeHash(version=1, value=b"\1" * 32)
    topic = Taps._topic(taps, tap, [told])
    assert topic.definition == UNKNOWN and topic.type_hash == "RIHS01_" + "01" * 32
    assert "/x is recorded without a definition" in said[0] and "rebuild both" in said[0]


class Silent:
    """A graph in which no node answers; names: the nodes that are there."""

    get_namespace = Mock(return_value="/")
    get_fully_qualified_name = Mock(return_value="/session_recorder")
    create_client = destroy_client = Mock()

    def __init__(self, *names: str):
        self.names = names

    def get_service_names_and_types(self):
        types = ["rcl_interfaces/srv/GetParameters"]
        return [(f"{name}/get_parameters", types) for name in self.names]


@pytest.mark.parametrize(
    ("name", "noted"),
    [("/manus", {"/manus": NO_ANSWER}), ("/left/manus", {})],
    ids=["it stays and keeps silent", "of another robot"],
)
def test_a_node_that_does_not_answer(name, noted):
    parameters = NodeParameters(Silent(name))
    for _ in range(6):
        parameters.ask()
    assert parameters.values == noted


def test_a_script_that_is_run_again_and_again_is_not_noted():
    """Each run ends before it could answer; `verify` would call the bag incomplete."""
    parameters = NodeParameters(silent := Silent())
    for names in ([], *[["/my_script"], ["/my_script"], []] * 6):
        silent.names = names
        parameters.ask()
    assert parameters.values == {}
