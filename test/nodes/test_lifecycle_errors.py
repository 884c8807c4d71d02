# SPDX-License-Identifier: Apache-2.0
"""An error in a transition is logged, whichever part raises it: rclpy drops it without a word."""

from __future__ import annotations

import pytest
from rclpy.lifecycle import TransitionCallbackReturn

from screw_module_ros.devices.errors import NotAnswering


@pytest.fixture
def node(make_node):
    made = make_node("amplifier")
    made.told = []
    made.get_logger().error = made.told.append
    made.get_logger = lambda: type("Log", (), {"error": staticmethod(made.told.append)})
    return made


def fails():
    raise NotAnswering("the drive has no supply")


@pytest.mark.parametrize("transition", ["on_configure", "on_cleanup", "on_error"])
def test_a_failing_disconnect_is_logged_and_the_topics_are_closed(node, transition):
    closed = []
    node.connect = node.disconnect = fails
    node.close_topics = lambda: closed.append(True)
    getattr(node, transition)(None)
    assert any("the drive has no supply" in line for line in node.told)
    assert closed == [True]


@pytest.mark.parametrize("transition", ["on_activate", "on_deactivate"])
def test_a_failing_end_is_logged_and_is_an_error(node, transition):
    node.begin = node.end = fails
    assert getattr(node, transition)(None) == TransitionCallbackReturn.ERROR
    assert any("the drive has no supply" in line for line in node.told)


def test_a_failed_connect_leaves_nothing_that_disconnect_stumbles_over(node):
    """The permission is followed late; before, the sentence of the failure got lost."""
    node.open_port = lambda *names: fails()
    assert node.on_configure(None) == TransitionCallbackReturn.FAILURE
    assert node.told == ["cannot configure: the drive has no supply"]
    node.new_inbox()
    node.disconnect()
