# SPDX-License-Identifier: Apache-2.0
"""Two publishers of what one node alone may publish stop who hears them; no graph."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from screw_module_msgs.msg import EncoderSample, ForceCommand, ForceSample

from screw_module_ros.loop.requests import Requests
from screw_module_ros.nodes.support import topics
from screw_module_ros.nodes.support.drives import VERTICAL
from screw_module_ros.nodes.support.topics import too_many_senders
from screw_module_ros.safety.permit import OPEN, Permit, PermitSettings

MS = 1_000_000


def publish(node, kind, topic, count):
    return [node.create_publisher(kind, topic, topics.SAMPLE) for _ in range(count)]


@pytest.mark.parametrize(
    ("kind", "topic"), [(EncoderSample, "screw/encoder"), (ForceSample, "handle/force")]
)
def test_the_controller_holds_its_force_at_zero_while_there_are_two(make_node, kind, topic):
    node = make_node("impedance_controller")
    node.connect()
    node.begin()
    voices = publish(node, kind, topic, 1)
    node._senders.count()
    node.read_inputs(MS)
    assert "publish" not in node.part.reason
    voices += publish(node, kind, topic, 1)
    node._senders.count()
    node.read_inputs(2 * MS)
    assert f"2 nodes publish {topic}: one is allowed (/impedance_controller)" in node.part.reason
    assert node.part.faulted
    node.destroy_publisher(voices.pop())
    node._senders.count()
    node.part.reset(3 * MS)
    node.read_inputs(3 * MS)
    assert not node.part.faulted
    node.close()


def test_in_one_process_with_the_sensors_their_topics_do_not_matter(make_node):
    node = make_node("impedance_controller")
    node.direct = ("screw/encoder", "handle/force", "screw/amplifier_state")
    node.connect()
    voices = publish(node, ForceSample, "handle/force", 2)
    node._senders.count()
    assert node._senders.warning == "" and len(voices) == 2
    node.close()


@pytest.mark.parametrize(
    ("name", "kind", "topic"),
    [("amplifier", ForceCommand, "screw/force_command"),
     ("manus", ForceSample, "handle/force")],
)  # fmt: skip
def test_a_drive_node_stops_while_open_and_refuses_to_open(make_node, name, kind, topic):
    node = make_node(name)
    node.follow(node.new_inbox(), VERTICAL, alone=topic)
    node._permission = SimpleNamespace(pass_on=lambda permit, now_ns: None)
    permit = Permit([], Requests(), PermitSettings(), MS)
    publish(node, kind, topic, 2)
    node._senders.count()
    node.permission(permit, MS)
    assert permit.fault.reason == "", "nothing passes: the next enable is refused"
    assert node.enable() == too_many_senders(node, topic) != ""
    permit.phase = OPEN
    node.permission(permit, 2 * MS)
    assert permit.fault.reason.startswith(f"2 nodes publish {topic}")
    node.close_topics()
