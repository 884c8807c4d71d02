# SPDX-License-Identifier: Apache-2.0
"""Without a session `therapy/state` says nothing about an earlier one."""

from screw_module_msgs.msg import TherapyState

S = 1_000_000_000


def test_a_node_that_was_deactivated_forgets_the_patient(make_node):
    node, published = make_node("therapy_session"), []
    node.connect()
    node.begin()
    node._state.patient, node._state.trial, node._state.reason = "P-7K3QX", 12, "it was ended"
    node._state.definition_sha256 = "0" * 64
    node.begin()
    node._publish_state = published.append
    node._send(node.clock.now_ns() + S)
    node.disconnect()
    node.close_topics()
    (state,) = published
    state.header.stamp.sec = state.header.stamp.nanosec = 0
    idle = TherapyState(state=TherapyState.IDLE)
    idle.header.frame_id = "manus_base"
    assert state == idle
