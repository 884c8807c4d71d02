# SPDX-License-Identifier: Apache-2.0
"""A lifecycle node with the clock of its process, whose services report errors as text.

In simulated time a request holds time until the service processes it, and the answer holds time
until the client has it. A periodic call that is due holds time until the service thread makes it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import contextmanager
from typing import Any

from rclpy.lifecycle import LifecycleNode

from screw_module_ros.clock import Clock, TimeStandsStill, WallClock
from screw_module_ros.devices.errors import DeviceError
from screw_module_ros.simulated_clock import simulated_clock

from .command_line import arguments, overrides


class Done(str):
    """Message of a service that succeeded; a plain string is the message of a failure."""

    __slots__ = ()


class ServingNode(LifecycleNode):
    """A lifecycle node with services.

    clock: the one clock of this process. stopping: set when the process is to end.
    """

    def __init__(self, name: str):
        super().__init__(name, parameter_overrides=overrides(name, arguments()))
        self.stopping = threading.Event()
        self.clock = self._chosen_clock()
        self._active = threading.Event()
        self._phase = "unconfigured"
        self._failure = ""
        self._requests = self._answers = self._calls = self._calls_due = None

    def _chosen_clock(self) -> Clock:
        if not self.get_parameter("use_sim_time").value:
            return WallClock()
        # Our time comes from the page: the topic /clock would only cost 100 callbacks a second.
        for subscription in list(self.subscriptions):
            if subscription.topic_name == "/clock":
                self.destroy_subscription(subscription)
        name, namespace = self.get_name(), self.get_namespace()
        return simulated_clock(name, namespace, lambda: self.stopping.is_set())

    def start_serving(self) -> None:
        """Make requests and due calls hold simulated time until they are served; ends __init__."""
        if not self.clock.simulated:
            return
        name = self.get_fully_qualified_name()
        self._requests = self.clock.hop(request_topic(name))
        self._answers = self.clock.source(answer_topic(name))
        self._calls = self.clock.source(_due_topic(name))
        self._calls_due = self.clock.hop(_due_topic(name))
        for hop in (self._requests, self._calls_due):
            hop.hold(self.clock.member.slot)
        self.clock.idle()

    def hold_for_calls(self) -> None:
        """Hold simulated time until the service thread has made the calls that are due."""
        if self._calls is not None and not self._calls_due.pending():
            self._calls.publishing()

    @contextmanager
    def working(self):
        """Hold simulated time while the service thread works, except in its waits.

        Requests and due calls do not hold time meanwhile: the work may need it.
        """
        if self._requests is None:
            yield
            return
        with self.clock.working(), self._requests.paused(), self._calls_due.paused():
            try:
                yield
            finally:
                self._calls_due.catch_up()

    @property
    def active(self) -> bool:
        """Whether the node is in the lifecycle state active."""
        return self._active.is_set()

    def serve(
        self,
        kind: type,
        name: str,
        action: Callable[[Any], str],
        done: str = "",
        always: bool = False,
    ) -> None:
        """Offer a service whose response has `success` and `message`.

        action: takes the request and returns the reason of a failure, an empty string for success,
        or `Done` with a message. An exception becomes the answer, and the node continues. done: the
        message for an empty string. always: serve also while the node is not active.
        """

        def answer(request: Any, response: Any) -> Any:
            with self._holding_time():
                answered = self._carried_out(action, request, name, always)
            response.success = not answered or isinstance(answered, Done)
            response.message = str(answered) or done
            return response

        self.create_service(kind, name, answer)

    def _carried_out(self, action: Callable, request: Any, name: str, always: bool) -> str:
        if not (always or self.active):
            return f"the node is not active: {self._failure or f'it is {self._phase}'}"
        try:
            return action(request) or ""
        except (DeviceError, TimeStandsStill) as error:
            return str(error)
        except Exception as error:
            self.get_logger().error(f"{name}: {type(error).__name__}: {error}")
            return str(error) or type(error).__name__

    @contextmanager
    def _holding_time(self):
        """Hold simulated time while a service runs, and until the client has the answer."""
        if self._requests is None:
            yield
            return
        with self.working():
            yield
            self._answers.publishing()
            self._requests.catch_up()
        self._answers.published()

    def stop_serving(self) -> None:
        """Stop holding simulated time: nothing is served from now on."""
        if self._requests is not None:
            self._requests.let_go()
            self._calls_due.let_go()


def request_topic(node: str) -> str:
    """Return the name under which simulated time counts requests to a node (full name)."""
    return f"request {node}"


def answer_topic(node: str) -> str:
    """Return the name under which simulated time counts answers of a node (full name)."""
    return f"answer {node}"


def _due_topic(node: str) -> str:
    return f"calls {node}"
