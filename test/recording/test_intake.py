# SPDX-License-Identifier: Apache-2.0
"""Which topics the recorder takes, and with which quality of service."""

from types import SimpleNamespace

import pytest
from rclpy.duration import Infinite
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from screw_module_ros.nodes.session_intake import Selection, _Tap
from screw_module_ros.nodes.session_qos import offered_by, recorded_class, satisfying
from screw_module_ros.nodes.session_recorder import SessionRecorder
from screw_module_ros.recording import BagError, Qos

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
    request = satisfying("/scan", [offer(*each) for each in offers])
    assert (request.reliability, request.durability) == (reliability, durability)
    assert request.depth >= 1000


def test_log_lines_of_the_last_session_are_left_out():
    """They name its bag, and so its patient."""
    assert satisfying("/rosout", [offer(RELIABLE, LATCHED)]).durability == VOLATILE


def test_offer_in_rosbag2s_words():
    told = offer(BEST_EFFORT, LATCHED)
    told.qos_profile.deadline = told.qos_profile.lifespan = Infinite
    told.qos_profile.liveliness_lease_duration = Infinite
    found = offered_by(told)
    assert (found.reliability, found.durability) == ("best_effort", "transient_local")
    assert found.deadline == found.lifespan == found.lease == Qos().deadline


@pytest.mark.parametrize(
    ("selection", "name", "taken"),
    [
        (Selection(), "/anything/at/all", True),
        (Selection(), "/node/_action/feedback", False),
        (Selection(hidden=True), "/node/_action/feedback", True),
        (Selection(("/screw/*",)), "/screw/encoder", True),
        (Selection(("/screw/*",)), "/handle/force", False),
        (Selection(("*",), ("/rosout", "")), "/rosout", False),
        (Selection(("*",), ("",)), "/rosout", True),
    ],
)
def test_selection(selection, name, taken):
    assert selection.takes(name) is taken


def test_class_of_a_type():
    assert recorded_class("std_msgs/msg/String").__name__ == "String"
    feedback = recorded_class("screw_module_msgs/action/RunExperiment_FeedbackMessage")
    assert "feedback" in feedback.get_fields_and_field_types()


@pytest.mark.parametrize("name", ["nowhere_msgs/msg/X", "std_msgs/msg/Nothing"])
def test_unknown_type_is_named(name):
    with pytest.raises(BagError, match=f"{name} is not installed"):
        recorded_class(name)


def test_what_is_refused_is_noted_in_the_bag():
    noted = {}
    recorder = SimpleNamespace(_noted_parameters=SimpleNamespace(values={"/encoder": "{}"}))
    session = SimpleNamespace(add_metadata=noted.__setitem__)
    intake = SimpleNamespace(calibrations=dict, refused={})
    SessionRecorder._note(recorder, session, intake)
    assert noted == {"calibration": {}, "parameters": {"/encoder": "{}"}}
    intake.refused["/odd"] = "its type is not installed"
    SessionRecorder._note(recorder, session, intake)
    assert noted["not recorded"] == intake.refused


@pytest.mark.parametrize(("kind", "is_noted"), [("string", True), ("uint8", False)])
def test_a_calibration_is_noted_only_where_it_is_a_text(kind, is_noted):
    """A number in a message of somebody else could not be hashed: no bag was ever closed."""
    fields = {"header": "std_msgs/Header", "calibration": kind}
    tap = _Tap("/other", SimpleNamespace(get_fields_and_field_types=lambda: fields), 1)
    assert tap.has_calibration is is_noted
