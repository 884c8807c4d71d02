# SPDX-License-Identifier: Apache-2.0
"""Starts and stops the session recorder from another node, without waiting for its answer."""

from __future__ import annotations

from functools import partial

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from std_srvs.srv import Trigger

from screw_module_ros.clock import Clock

from .support.topics import is_served

RECORDER = "session_recorder"
_FOUND_NS = 5_000_000_000  # for which a recorder that was just started may stay undiscovered
_ANSWER_NS = 10_000_000_000  # in which a recorder that was found must answer
_CLOSING_NS = 10_000_000_000  # after which a recorder that does not answer is waited for no more


class RecorderClient:
    """Sets the name of the bag, then starts the recording, and takes the name back.

    message: the recorder's answer, for diagnostics; refused: it does not record.
    """

    def __init__(self, node: Node, clock: Clock):
        self.message = ""
        self.refused = False
        self._node, self._clock = node, clock
        self._started_ns: int | None = None
        self._unsent: tuple[int, SetParameters.Request] | None = None
        self._due_ns: int | None = None  # of the awaited answer
        self._request = 0  # number of the request whose answer counts
        self._parameters = node.create_client(SetParameters, f"{RECORDER}/set_parameters")
        self._starter = node.create_client(Trigger, f"{RECORDER}/start")
        self._stopper = node.create_client(Trigger, f"{RECORDER}/stop")
        self._stop_ns: int | None = None

    def since(self, now_ns: int) -> int:
        """Return the time since the start of the recording [ns], -1 while none runs."""
        return -1 if self._started_ns is None else now_ns - self._started_ns

    def is_closing(self, now_ns: int) -> bool:
        """Return whether the recorder has been asked to stop and has not answered yet."""
        return self._stop_ns is not None and now_ns - self._stop_ns < _CLOSING_NS

    def stop(self) -> None:
        """Ask for the bag to be closed; the log has the outcome."""
        self._started_ns, self._stop_ns = None, self._clock.now_ns()
        self._stopper.call_async(Trigger.Request()).add_done_callback(self._stopped)

    def start(self, name: str) -> None:
        """Request a recording under a name; the log shows the result."""
        self.refused, self._started_ns, self._due_ns = False, None, None
        self._request += 1
        self._unsent = self._clock.now_ns() + _FOUND_NS, _naming(name)
        self.message = "asked for"

    def look(self, now_ns: int) -> None:
        """Send the request of `start` as soon as there is a recorder; give up one that is mute."""
        if self._unsent is None:
            if self._due_ns is not None and now_ns >= self._due_ns:
                self._refuse("not recorded: the session_recorder does not answer")
            return
        due_ns, request = self._unsent
        if is_served(self._node, self._parameters):
            self._unsent, self._due_ns = None, now_ns + _ANSWER_NS
            named = partial(self._named, self._request)
            self._parameters.call_async(request).add_done_callback(named)
        elif now_ns >= due_ns:
            self._unsent = None
            self._refuse("not recorded: no session_recorder answers")

    def _named(self, number: int, future) -> None:
        if number != self._request:
            self._unname()
            return
        answer = future.result()
        if answer is None or not all(result.successful for result in answer.results):
            reason = answer.results[0].reason if answer else "no answer"
            self._refuse(f"not recorded: the bag cannot be named: {reason}")
            return
        started = partial(self._started, number)
        self._starter.call_async(Trigger.Request()).add_done_callback(started)

    def _started(self, number: int, future) -> None:
        answer = future.result()
        if number != self._request:  # too late: it would record whoever comes next
            if answer is not None and answer.success:
                self.stop()
        elif answer is not None and answer.success:
            self.message = f"recording to {answer.message}"
            self._started_ns, self._due_ns = self._clock.now_ns(), None
            self._node.get_logger().info(self.message)
        else:
            self._refuse(f"not recorded: {answer.message if answer else 'no answer'}")
        self._unname()

    def _unname(self) -> None:
        """Take the name back: a recording that is started by hand later is somebody else's.

        Not while another request is under way, whose name the recorder may have already.
        """
        if self._unsent is None and self._due_ns is None:
            self._parameters.call_async(_naming(""))

    def _stopped(self, future) -> None:
        answer = future.result()
        self._stop_ns = None
        if answer is not None and answer.success:
            self.message = f"recorded to {answer.message}"
            self._node.get_logger().info(self.message)
        else:
            self.message = f"the bag was not closed: {answer.message if answer else 'no answer'}"
            self._node.get_logger().warning(self.message)

    def _refuse(self, problem: str) -> None:
        self.message, self.refused, self._due_ns = problem, True, None
        self._request += 1
        self._node.get_logger().warning(problem)


def _naming(name: str) -> SetParameters.Request:
    """Return the request that names the recorder's next bag; empty: by date and time."""
    value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=name)
    return SetParameters.Request(parameters=[Parameter(name="name", value=value)])
