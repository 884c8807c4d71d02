# SPDX-License-Identifier: Apache-2.0
"""What the thread that serves a node survives, and what ends the node."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from rclpy.exceptions import InvalidHandle

from screw_module_ros.nodes.support import threads


class Executor:
    """Raises what it is given, one after the other, and then lets the thread end."""

    def __init__(self, end: Callable[[], None], *errors: Exception):
        self.left, self._end = list(errors), end

    def spin_once(self, timeout_sec=None):
        if not self.left:
            self._end()
            return
        raise self.left.pop(0)

    def add_node(self, node):
        pass

    create_task = add_node

    def shutdown(self, timeout_sec):
        pass


@pytest.fixture
def served(make_node, monkeypatch):
    """Return a node whose service thread has run until its end, with these errors on the way."""

    def serve(*errors: Exception):
        node = make_node("endpoint_state")
        executor = Executor(node.service._ended.set, *errors)
        monkeypatch.setattr(threads, "SingleThreadedExecutor", lambda: executor)
        node.service.start(lambda: None)
        node.service._thread.join(20.0)
        assert not node.service._thread.is_alive() and not executor.left
        return node

    return serve


def test_a_publisher_destroyed_by_another_thread_does_not_end_the_node(served):
    assert not served(InvalidHandle("destruction was requested")).service.failed


def test_any_other_error_ends_the_node(served):
    node = served(RuntimeError())
    assert node.service.failed and node.stopping.is_set()
