# SPDX-License-Identifier: Apache-2.0
"""A transition that fails leaves a node whose states agree, and that says why."""

from __future__ import annotations

import pytest
from lifecycle_msgs.msg import State

from screw_module_ros.clock import TimeStandsStill


@pytest.fixture
def node(make_node):
    node = make_node("endpoint_state")
    node.trigger_configure()
    node.trigger_activate()
    return node


def state(node) -> int:
    return node._state_machine.current_state[0]


def fails_once(node, name, error):
    """Let a method of the node raise an error, once."""

    def fail():
        delattr(node, name)
        raise error

    setattr(node, name, fail)


@pytest.mark.parametrize(
    ("method", "steps"),
    [("end", ("deactivate",)), ("disconnect", ("deactivate", "cleanup"))],
)
def test_after_an_error_all_is_closed_and_the_node_begins_anew(node, method, steps):
    """It kept topics and bus, refused parameters as if configured, and nothing said why."""
    fails_once(node, method, RuntimeError("device gone"))
    for step in steps:
        getattr(node, f"trigger_{step}")()
    assert state(node) == State.PRIMARY_STATE_UNCONFIGURED
    assert "device gone" in node.failure
    assert not node._inboxes and not node._topics
    assert node.parameters.write(max_age=0.2) == ""
    node.trigger_configure()
    node.trigger_activate()
    assert node.active and state(node) == State.PRIMARY_STATE_ACTIVE
    assert node.failure == ""


def test_while_simulated_time_stands_the_node_stays_active(node):
    """Its loop was left out for good, with its device as it was, and nothing said why."""
    leave_step = node._leave_step

    def stands():
        node._active.clear()
        node._leave_step = leave_step
        raise TimeStandsStill("simulated time stands still")

    node._leave_step = stands
    node.trigger_deactivate()
    assert node.active and state(node) == State.PRIMARY_STATE_ACTIVE
    node.trigger_deactivate()
    assert not node.active and state(node) == State.PRIMARY_STATE_INACTIVE
