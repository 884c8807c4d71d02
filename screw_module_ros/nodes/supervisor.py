# SPDX-License-Identifier: Apache-2.0
"""`supervisor`: permission to move, emergency stop, vertical lock.

A permission enables nothing: every drive stays off until it is enabled. `safety/supervision.py`
decides; this node collects the states and publishes the decision. An emergency stop and the lock
survive a restart of the process. A latched stop also does, unless the process ended normally.
"""

from __future__ import annotations

import threading
from typing import Annotated, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from screw_module_msgs.msg import SafetyState
from std_srvs.srv import SetBool, Trigger

from screw_module_ros import graph
from screw_module_ros.loop.ticker import BETWEEN_TICKS_NS, Ticker
from screw_module_ros.safety import supervision
from screw_module_ros.safety.announced import Announced, announce
from screw_module_ros.safety.checks import status_problem
from screw_module_ros.safety.supervision import (
    Decision,
    NodeReport,
    SupervisionSettings,
    SupervisorState,
    decide,
)
from screw_module_ros.settings import Setting
from screw_module_ros.software import software

from .support.answering import Done
from .support.node import Node
from .support.place import SavedState
from .support.states import ERROR, OK, WARN, Health, RateMeter, at_base
from .support.topics import Newest, offered, requested

_STOPPED = "stopped; call ~/reset, then enable the drives"
_TELL_S = 0.1
_STATE_TOPICS = {t.publisher: t.name for t in graph.subscribed_by("supervisor") if t.publisher}
"""Node -> the topic that shows its state; also endpoint_state, although nothing depends on it."""


class SupervisorSettings(NamedTuple):
    """Rate of the node."""

    rate: Annotated[
        float, Setting(f"decisions and {graph.SAFETY_STATE} messages per second", "Hz", 20.0, 500.0)
    ] = graph.TOPICS[graph.SAFETY_STATE].rate


class SupervisorNode(Node):
    """Publishes whether the robot may move, from the newest state of every node.

    sources: the newest state of each node, by its name; from `connect` on.
    """

    sources: dict[str, Newest]

    def __init__(self) -> None:
        super().__init__("supervisor")
        self.parameters.declare(SupervisorSettings, SupervisionSettings)
        self._message = at_base(SafetyState)
        self._message.software = software()
        self._kept = SavedState(self.get_fully_qualified_name())
        self._saved = True
        self._state = self._restored()
        # The loop decides, services change the state; both fill the same message.
        self._changing = threading.Lock()
        self._rate = RateMeter()
        self._decisions = 0
        self._decided: tuple[Decision, bool] | None = None  # the newest, and whether it is latched
        self._announced = Announced()
        self._alarms: dict[str, str] = {}
        self.create_subscription(DiagnosticArray, graph.DIAGNOSTICS, self._note_diagnostics, 50)
        self.periodic.every(self.clock, _TELL_S, self.tell)
        self.serve(Trigger, "~/estop", self._estop, _STOPPED, always=True)
        self.serve(Trigger, "~/reset", self._reset, "reset; the drives stay off until enabled")
        self.serve(SetBool, "~/lock_vertical", self._lock, always=True)

    def _restored(self) -> SupervisorState:
        """Return the state of an earlier process; an unreadable one counts as a stop."""
        try:
            state = supervision.restored(self._kept.read())
        except (OSError, ValueError) as error:
            self.get_logger().warning(
                "the saved stop and lock cannot be read, so the supervisor starts with an "
                "emergency stop; check whether the pin of the vertical axis is in "
                f"(~/lock_vertical), then call ~/reset ({self._kept.path}: {error})"
            )
            return supervision.estop(SupervisorState())
        if kept := supervision.kept(state):
            text = ", ".join(name for name, value in kept.items() if value)
            self.get_logger().warning(f"as before the supervisor was started anew: {text}")
        return state

    def _keep(self, state: SupervisorState) -> None:
        """Save the state that must survive a restart, if changed; the caller holds the lock."""
        try:
            self._kept.write(supervision.kept(state))
            self._saved = True
        except OSError as error:
            if self._saved:  # it is tried again with each decision, and said once
                self.get_logger().warning(
                    "the stop or lock cannot be saved, so a restart of the supervisor would lose "
                    f"it: {self._kept.path}: {error}"
                )
            self._saved = False

    def connect(self) -> None:
        """Make the topics."""
        self._period_ns = round(1e9 / self.parameters.read(SupervisorSettings).rate)
        self._settings = self.parameters.read(SupervisionSettings)
        unknown = set(self._settings.required) - set(_STATE_TOPICS)
        if unknown:
            raise ValueError(
                f"required names {', '.join(sorted(unknown))}; there are {', '.join(_STATE_TOPICS)}"
            )
        inbox = self.new_inbox()
        age_ns = round(self._settings.timeout * 1e9)
        self.sources = {
            node: Newest(inbox.subscribe(*requested(topic)), age_ns)
            for node, topic in _STATE_TOPICS.items()
        }
        self._senders = self.senders(*(_STATE_TOPICS[node] for node in self._settings.required))
        self._send = self.outlet(*offered(graph.SAFETY_STATE))

    def begin(self) -> None:
        """Start the ticks; what was heard before a pause of this node says nothing now."""
        for newest in self.sources.values():
            newest.forget()
        self._state = self._state._replace(enabled=False)
        self._ticker = Ticker(self.clock, self._period_ns, BETWEEN_TICKS_NS)

    def finish(self) -> None:
        """End in order: without safety_state the drives stop, and no latched stop is kept.

        An end by an error is none: its latched stop outlives the process.
        """
        if self.in_order and self.configured:
            with self._changing:  # at a graph's end the last node sees the others missing
                self._keep(self._state._replace(latched=()))

    def step(self) -> None:
        """Decide and publish the decision."""
        self.decide(self._ticker.sleep().monotonic_ns)

    def decide(self, now: int) -> None:
        """Decide at the time `now` [ns], publish the decision and save what must survive."""
        with self._changing:  # two threads must not mix their decisions in one message
            self._decide_and_publish(now)
            self._keep(self._state)

    def _decide_and_publish(self, now: int) -> None:
        decision, self._state = decide(self._settings, self._state, self._reports(now), now)
        message, state = self._message, self._state
        self.stamp(message.header)
        for name, value in decision._asdict().items():  # named as the message's fields
            setattr(message, name, value)
        message.estopped = state.estopped
        message.vertical_locked = state.locked
        message.resets = state.resets
        self._send(message)
        self._decided = decision, bool(state.latched or state.estopped)
        self._decisions += 1

    def tell(self) -> None:
        """Log what changed, in the service thread: a terminal that is held stops no decision."""
        if self._decided is None or not self.active:
            return
        decision, latched = self._decided
        self._announced, line = announce(self._announced, decision, latched, self.clock.now_ns())
        logger = self.get_logger()
        # rclpy keeps one severity for each place in the code that logs.
        if line and decision.level == supervision.STOPPED:
            logger.error(line)
        elif line and decision.level == supervision.OK:
            logger.info(line)
        elif line:
            logger.warning(line)

    def _reports(self, now: int) -> dict[str, NodeReport]:
        for newest in self.sources.values():
            newest.update(now)
        return {node: self._report(node, newest, now) for node, newest in self.sources.items()}

    def _report(self, node: str, newest: Newest, now: int) -> NodeReport:
        message = newest.message
        if message is None:
            return NodeReport(seen=False)
        age = (now - newest.arrival_ns) * 1e-9
        if doubt := self._senders.warnings.get(_STATE_TOPICS[node]):
            return NodeReport(True, age, error=True, reason=doubt)  # whose state it was is unknown
        if not hasattr(message, "faulted"):  # a sample: its status and the diagnostics show errors
            # An alarm stands until the node itself says otherwise, however long it says nothing.
            alarm = status_problem(getattr(message, "status", 0)) or self._alarms.get(node, "")
            return NodeReport(True, age, error=bool(alarm), reason=alarm)
        enabled = getattr(message, "enabled", False) and not newest.stale(now)
        return NodeReport(True, age, False, message.faulted, enabled, message.reason)

    def _note_diagnostics(self, array: DiagnosticArray) -> None:
        mine = self.get_namespace().strip("/")
        for status in array.status:
            namespace, _, node = status.name.rpartition("/")
            if namespace == mine and node in _STATE_TOPICS:
                self._alarms[node] = status.message if status.level == ERROR else ""

    # Services ------------------------------------------------------------------------------

    def _estop(self, request: Trigger.Request) -> str:
        with self._changing:
            self._state = supervision.estop(self._state)
            if self.active:
                self._decide_and_publish(self.clock.now_ns())
            self._keep(self._state)
        if not self.active:
            self.get_logger().error("emergency stop")
        return ""

    def _reset(self, request: Trigger.Request) -> str:
        now = self.clock.now_ns()
        with self._changing:
            self._state, refused = supervision.reset(
                self._settings, self._state, self._reports(now), now
            )
            self._keep(self._state)
        return refused

    def _lock(self, request: SetBool.Request) -> str:
        with self._changing:
            self._state = supervision.lock(self._state, request.data)
            self._keep(self._state)
        return Done("vertical locked" if request.data else "vertical unlocked")

    @property
    def alarm(self) -> str:
        """Why it has stopped the robot."""
        message = self._message
        return "; ".join(message.reasons) if message.level == SafetyState.STOPPED else ""

    def health(self) -> Health:
        """Permission, and the reasons against it."""
        message, now = self._message, self.clock.now_ns()
        ages = {f"age {node} [s]": newest.age_text(now) for node, newest in self.sources.items()}
        values = {"rate [1/s]": f"{self._rate.rate(self._decisions, now):.1f}", **ages}
        reason = "; ".join(message.reasons)
        if message.level == SafetyState.STOPPED:
            return Health(ERROR, reason, values)
        if message.level == SafetyState.WAITING:
            return Health(WARN, f"waiting: {reason}", values)
        return Health(OK, "motion permitted", values)
