# SPDX-License-Identifier: Apache-2.0
"""With which quality of service the recorder takes a topic that was named."""

import pytest
from rclpy.duration import Infinite
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from screw_module_ros.nodes.recording_topics import offered_by, satisfying

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
