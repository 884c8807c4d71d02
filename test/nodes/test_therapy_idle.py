# SPDX-License-Identifier: Apache-2.0
"""Without a session `therapy/state` says nothing about an earlier one."""

from screw_module_msgs.msg import EndpointState, TherapyState
from screw_module_msgs.srv import StartTherapy

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
    state.header.stamp.sec = state.header.stamp.nanosec = state.monotonic_ns = 0
    idle = TherapyState(state=TherapyState.IDLE)
    idle.header.frame_id = "manus_base"
    assert state == idle


def test_an_unrecorded_session_does_not_begin_in_the_bag_of_another(make_node):
    """After a kill of this node the recorder goes on, with the name of the patient before."""
    node = make_node("therapy_session")
    node.connect()
    node.begin()
    node._take_sample(EndpointState(sequence=5), node.clock.now_ns())
    node._recording.of_another = lambda patient, now_ns: "P-33333"
    request = StartTherapy.Request(protocol="evaluation", patient="P-22222")
    answer = node._start(request)
    node._recording.of_another = lambda patient, now_ns: ""
    begun = node._start(request)
    node.disconnect()
    node.close_topics()
    assert "still records a session of P-33333" in answer and "session_recorder/stop" in answer
    assert begun == ""
