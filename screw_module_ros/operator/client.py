# SPDX-License-Identifier: Apache-2.0
"""A client of the running graph: waits, services with deadlines, newest states, diagnostics.

Every call either succeeds or raises RobotError, which names the node and quotes its message.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from screw_module_msgs.msg import (
    AmplifierState,
    EncoderSample,
    ImpedanceState,
    PlanarState,
    SafetyState,
)

from screw_module_ros import graph
from screw_module_ros.clock import TimeStandsStill, WallClock
from screw_module_ros.lockstep.clock import Calls, SimulatedClock, simulated_clock
from screw_module_ros.lockstep.end import End
from screw_module_ros.loop.ticker import BACK_OFF_S

from ..nodes.support import topics
from ..nodes.support.inbox import Inbox
from ..nodes.support.place import choose_transport
from ..nodes.support.topics import Newest, is_served

ANSWER_S = 10.0
_SERVE_S = 0.5
_POLL_NS = 20_000_000
_AT_ONCE_NS = 500_000_000  # the lock step drops whoever holds its time for 1 s
_STANDS_NS = 60_000_000_000  # wall clock: a stopped rig, as in a debugger, may continue
_LOST_S = 1.0
_READY_S = 90.0
_FIRST_ASK_NS, _ASK_AGAIN_NS = 200_000_000, 300_000_000
_WALL = WallClock()  # clock of the start of processes, independent of the robot's time
_FRESH_NS = 300_000_000
_STATE_S = 5.0
STATES = {
    SafetyState: graph.SAFETY_STATE,
    ImpedanceState: graph.CONTROLLER_STATE,
    AmplifierState: graph.AMPLIFIER_STATE,
    PlanarState: graph.MANUS_STATE,
    EncoderSample: graph.ENCODER_DECIMATED,
    WrenchStamped: graph.WRENCH,
}


class RobotError(RuntimeError):
    """A request to the robot failed; the message names the node and quotes it."""


Me = TypeVar("Me", bound="Client")


def _busy() -> str:
    """Return what the load says about a start that took long, empty on an idle machine."""
    load, cores = os.getloadavg()[0], len(os.sched_getaffinity(0))
    if load <= cores:
        return ""
    return (
        f". The load of this machine was {load:.1f} on {cores} cores in the last minute: end what "
        "else runs, or start again"
    )


class Client:
    """A client of the whole graph. Not thread-safe: one thread calls it.

    watch: called in every wait; may raise to end it, for instance when a process died. simulated:
    use the rig's time: waits use it, and it does not advance before a request is answered. clock:
    of the waits.
    """

    def __init__(
        self,
        name: str = "operator",
        namespace: str = "",
        watch: Callable[[], None] = lambda: None,
        simulated: bool = False,
    ):
        self.clock = simulated_clock(name, namespace) if simulated else WallClock()
        self.watch = watch
        reach = choose_transport()
        self._context = Context()
        self._context.init()
        self.node = Node(name, namespace=namespace or None, context=self._context)
        if reach:
            self.node.get_logger().warning(reach)
        self._clients: dict[str, Any] = {}
        self._statuses: dict[str, DiagnosticStatus] = {}
        self._calls: dict[str, Calls] = {}
        self._closing = threading.Event()
        self._inbox = Inbox(self.node, self.clock)
        self._states = {
            kind: Newest(self._inbox.subscribe(kind, topic, topics.SAMPLE), _FRESH_NS)
            for kind, topic in STATES.items()
        }
        self.node.create_subscription(DiagnosticArray, graph.DIAGNOSTICS, self._diagnose, 50)
        # Its trigger ends a `spin_once`, in contrast to `Executor.wake`, whose caller sleeps again.
        self._leaving = self.node.create_guard_condition(lambda: None)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._serve, name=name, daemon=True)
        self._thread.start()

    def __enter__(self: Me) -> Me:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the graph."""
        self._closing.set()
        self._leaving.trigger()
        self._thread.join(timeout=2.0)
        self._executor.shutdown(timeout_sec=2.0)
        self._inbox.close()
        for calls in self._calls.values():
            calls.close()
        self.node.destroy_node()
        self._context.try_shutdown()
        self.clock.leave()
        self.clock.close()

    def _serve(self) -> None:
        # Not `spin`: a shutdown from another thread destroys objects that it still uses.
        while not self._closing.is_set():
            try:
                self._executor.spin_once(timeout_sec=_SERVE_S)
            except InvalidHandle:  # the client's thread destroyed what rclpy was about to wait for
                self._closing.wait(BACK_OFF_S)

    # Waits ---------------------------------------------------------------------------------

    def pause(self, seconds: float) -> None:
        """Wait, watching."""
        self.pause_until(self.clock.now_ns() + round(seconds * 1e9))

    def pause_until(self, due_ns: int) -> None:
        """Wait until it is `due_ns` by the client's clock [ns], watching."""
        while (now_ns := self.clock.now_ns()) < due_ns:
            self.watch()
            self._sleep_until(min(due_ns, now_ns + _POLL_NS))

    def _sleep_until(self, until_ns: int, ends: Sequence[End] = ()) -> None:
        """Wait until `until_ns`, or for an answer at `ends`.

        Raises RobotError when simulated time stands because its rig has ended, or for long.
        """
        end_ns = _WALL.now_ns() + _STANDS_NS
        while True:
            try:
                if ends and isinstance(self.clock, SimulatedClock):
                    self.clock.member.wait(until_ns, ends)
                else:
                    self.clock.sleep_until(until_ns)
                return
            except TimeStandsStill as error:
                self.watch()  # a process that has ended gives a better message
                has_rig = isinstance(self.clock, SimulatedClock) and self.clock.has_rig
                if not has_rig or _WALL.now_ns() > end_ns:
                    raise RobotError(str(error)) from None

    def wait_until(self, condition: Callable[[], Any], deadline_s: float, what: str) -> None:
        """Wait for `condition`, watching. Raises RobotError(`what` ...) at the deadline."""
        if not self.met(condition, deadline_s):
            raise RobotError(f"{what} (waited {deadline_s:g} s){self.complaints_text()}")

    def met(self, condition: Callable[[], Any], deadline_s: float) -> bool:
        """Wait for `condition`, watching; return whether it was met before the deadline."""
        end_ns = self.clock.now_ns() + round(deadline_s * 1e9)
        while not condition():
            if self.clock.now_ns() > end_ns:
                return False
            self.pause(_POLL_NS * 1e-9)
        return True

    def met_by_wall(self, condition: Callable[[], Any], deadline_s: float) -> bool:
        """Like `met`, by wall clock, for the start of processes."""
        end_ns = _WALL.now_ns() + round(deadline_s * 1e9)
        self.clock.idle()
        while not condition():
            if _WALL.now_ns() > end_ns:
                return False
            self.watch()
            self.clock.idle()  # each time: a condition that calls a service holds time afterwards
            _WALL.sleep_until(_WALL.now_ns() + _POLL_NS)
        return True

    def met_at_once(self, condition: Callable[[], Any]) -> bool:
        """Like `met`, by wall clock for half a second, while simulated time stands still."""
        end_ns = _WALL.now_ns() + _AT_ONCE_NS
        while not condition():
            if _WALL.now_ns() > end_ns:
                return False
            _WALL.sleep_until(_WALL.now_ns() + _POLL_NS)
        return True

    # Nodes ---------------------------------------------------------------------------------

    def wait_until_ready(
        self,
        nodes: Iterable[str],
        deadline_s: float = _READY_S,
        on_waiting: Callable[[list[str]], None] = lambda waiting: None,
    ) -> None:
        """Wait until the lifecycle state of all `nodes` is active.

        deadline_s: of wall clock. on_waiting: called with the names of those that are not yet.
        """
        waiting = list(nodes)
        asked: dict[str, tuple[Any, int]] = {}

        def ready() -> bool:
            waiting[:] = [name for name in waiting if not self._is_active(name, asked)]
            on_waiting(waiting)
            return not waiting

        if not self.met_by_wall(ready, deadline_s):
            said = "; ".join(f"{name}: {self._missing(name)}" for name in waiting)
            raise RobotError(f"not ready after {deadline_s:g} s: {said}{_busy()}")

    def _missing(self, name: str) -> str:
        """Return what a node lacks that is not ready."""
        client = self.client(GetState, f"{name}/get_state")
        missing = "" if self.is_offered(client) else f"; nobody offers {client.service_name}"
        return self.said(name) + missing

    def _is_active(self, name: str, asked: dict[str, tuple[Any, int]]) -> bool:
        """Return whether the node has reported the state active.

        A node may lose a request during its discovery, so the first request follows a moment after
        it appeared, and the client repeats a request without an answer.
        """
        future, due_ns = asked.get(name, (None, 0))
        if future is not None and future.done():
            del asked[name]
            return future.result().current_state.id == State.PRIMARY_STATE_ACTIVE
        now_ns = _WALL.now_ns()
        client = self.client(GetState, f"{name}/get_state")
        if not self.is_offered(client):
            asked.pop(name, None)
        elif name not in asked:
            asked[name] = (None, now_ns + _FIRST_ASK_NS)
        elif now_ns > due_ns:
            asked[name] = (client.call_async(GetState.Request()), now_ns + _ASK_AGAIN_NS)
        return False

    # Diagnostics and states ----------------------------------------------------------------

    def _diagnose(self, message: DiagnosticArray) -> None:
        mine = self.node.get_namespace().strip("/")
        for status in message.status:
            namespace, _, name = status.name.rpartition("/")
            if namespace == mine:  # /diagnostics is common to all robots of a domain
                self._statuses[name] = status

    def forget(self, nodes: Iterable[str]) -> None:
        """Forget what nodes said that have ended: their successors have said nothing yet."""
        for node in nodes:
            self._statuses.pop(node, None)

    def said(self, node: str) -> str:
        """Return the node's last message on /diagnostics."""
        status = self._statuses.get(node)
        return status.message if status else "nothing heard of it on /diagnostics"

    def level(self, node: str) -> bytes | None:
        """Return the level of the node's last entry on /diagnostics, None before the first."""
        status = self._statuses.get(node)
        return status.level if status else None

    def reported(self, key: str, node: str) -> str | None:
        """Return a named value of the node's last entry on /diagnostics, None if it has none."""
        status = self._statuses.get(node)
        values = status.values if status else ()
        return next((value.value for value in values if value.key == key), None)

    def complaints(self) -> list[str]:
        """Return `node: message` of every node that reports an error."""
        bad = (DiagnosticStatus.ERROR, DiagnosticStatus.STALE)
        statuses = sorted(self._statuses.items())
        return [f"{name}: {status.message}" for name, status in statuses if status.level in bad]

    def complaints_text(self) -> str:
        """Return the complaints as the end of a sentence, empty without any."""
        found = self.complaints()
        return f"; /diagnostics: {'; '.join(found)}" if found else ""

    def state(self, kind: type) -> Any:
        """Return the newest message of a kind in `STATES`, None when it is older than 0.3 s."""
        return self._states[kind].fresh(self.clock.now_ns())

    def newest(self, kind: type, deadline_s: float = _STATE_S) -> Any:
        """Like `state`, but wait for one. Raises RobotError when none comes in time."""
        self.wait_until(
            lambda: self.state(kind), deadline_s, f"nobody publishes {STATES[kind]}"
        )
        return self._states[kind].message

    # Services ------------------------------------------------------------------------------

    def client(self, kind: type[Any], service: str) -> Any:
        """Return the client of a service; create it once."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(kind, service)
        return self._clients[service]

    def is_offered(self, client: Any) -> bool:
        """Return whether a node offers the service of a client that `client()` has returned."""
        return is_served(self.node, client)

    def call(
        self, kind: type[Any], service: str, request: Any = None, deadline_s: float = ANSWER_S
    ) -> Any:
        """Call a service and return its response. Raises RobotError without an answer in time."""
        client = self.client(kind, service)
        self.wait_until(lambda: self.is_offered(client), deadline_s, f"nobody offers {service}")
        answer = self._announced(kind, service)
        answered = threading.Event()
        future = client.call_async(request or kind.Request())
        future.add_done_callback(lambda _: answered.set())
        end_ns = self.clock.now_ns() + round(deadline_s * 1e9)
        while not future.done():
            self.watch()
            now_ns = self.clock.now_ns()
            if now_ns > end_ns:
                self.wait_until(future.done, 0.0, f"{service} did not answer")
            elif answer is not None:
                self._await(answered, now_ns + _POLL_NS, answer)
            elif not answered.wait(_POLL_NS * 1e-9) and self.clock.simulated:
                self.clock.sleep_until(now_ns + _POLL_NS)  # its node may need time for the answer
        return future.result()

    def parameters(self, node: str, names: Iterable[str]) -> dict[str, Any]:
        """Return parameters of a node by name, without undeclared ones. Raises RobotError."""
        names = list(names)
        request = GetParameters.Request(names=names)
        values = self.call(GetParameters, f"{node}/get_parameters", request).values
        found = zip(names, map(parameter_value_to_python, values), strict=False)
        return {name: value for name, value in found if value is not None}

    def _announced(self, kind: type[Any], service: str) -> End | None:
        """Make a request hold simulated time until its node has it; return the answer's end.

        Only services that the node offers with `Node.serve` count; rclpy's own do not.
        """
        clock = self.clock
        if not (isinstance(clock, SimulatedClock) and hasattr(kind.Response, "message")):
            return None
        node = self.node.resolve_service_name(service).rpartition("/")[0]
        if node not in self._calls:
            self._calls[node] = clock.calls(node)
        self._calls[node].begin()
        return self._calls[node].answer

    def _await(self, answered: threading.Event, until_ns: int, answer: End) -> None:
        """Wait until `until_ns` for an answer; simulated time waits for one that was sent."""
        self._sleep_until(until_ns, (answer,))
        if answer.pending:
            if answered.wait(_LOST_S):
                answer.catch_up()
            else:
                answer.stop_following()
