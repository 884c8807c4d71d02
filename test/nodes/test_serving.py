# SPDX-License-Identifier: Apache-2.0
"""What the thread that serves a node survives, and what ends the node."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest
from rclpy.exceptions import InvalidHandle

from screw_module_ros.nodes.support.runtime import _serve
from screw_module_ros.nodes.support.timers import Timers


class Executor:
    """Raises what it is given, one after the other, and then lets the thread end."""

    def __init__(self, ended, *errors):
        self.left, self.ended = list(errors), ended

    def spin_once(self, timeout_sec=None):
        if not self.left:
            self.ended.set()
            return
        raise self.left.pop(0)


def _node() -> SimpleNamespace:
    return SimpleNamespace(
        stopping=threading.Event(), periodic=Timers(), make_calls=lambda: None
    )


def test_a_publisher_destroyed_by_another_thread_does_not_end_the_node():
    ended = threading.Event()
    executor = Executor(ended, InvalidHandle("destruction was requested"))
    _serve(executor, _node(), ended)
    assert not executor.left and ended.is_set()


def test_any_other_error_ends_the_node():
    node = _node()
    with pytest.raises(RuntimeError):
        _serve(Executor(threading.Event(), RuntimeError()), node, threading.Event())
    assert node.stopping.is_set()
