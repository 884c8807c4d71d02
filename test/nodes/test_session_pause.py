# SPDX-License-Identifier: Apache-2.0
"""A session whose process pauses for a while misses no sample: a measure counts each of them."""

from __future__ import annotations

from screw_module_msgs.msg import EndpointState

from screw_module_ros.nodes.support import topics

MESSAGES = 150  # three quarters of a second


def test_samples_of_a_pause_are_all_taken(make_node, wait_until):
    """The queue held ten, 50 ms: trials counted samples as missing that the bag had."""
    node = make_node("therapy_session")
    node.connect()
    node.begin()
    taken = []
    node._take_sample = lambda message, now_ns: taken.append(message.sequence)
    publisher = node.create_publisher(EndpointState, "endpoint_state", topics.EACH_STATE)
    wait_until(lambda: publisher.get_subscription_count() == 1, what="discovery")
    for number in range(MESSAGES):
        publisher.publish(EndpointState(sequence=number))
    node.step()
    wait_until(lambda: node.step() or len(taken) >= MESSAGES, what="all samples")
    assert taken == list(range(MESSAGES))
    node.disconnect()
    node.close_topics()
