# SPDX-License-Identifier: Apache-2.0
"""The life of a node's process: start, lifecycle, hot loop, orderly end.

Two threads share the work. The executor's thread serves services, parameters, lifecycle
transitions and diagnostics. The main thread runs `ModuleNode.step` over and over while the node is
active, and nothing else, so that no callback stands between a sample and its command.
"""

from __future__ import annotations

import logging
import signal
import sys
import threading
from collections.abc import Callable
from typing import Annotated, NamedTuple

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.signals import SignalHandlerOptions
from rclpy.timer import Timer

from screw_module_ros.settings import Setting

from .parameters import ParameterError, Parameters
from .realtime import RealtimeSettings, prepare
from .single import AlreadyRunning, lock_node

_LEAVE_STEP_S = 2.0
_RETRY_S = 1.0

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE
)


class StartSettings(NamedTuple):
    """How the node starts."""

    autostart: Annotated[
        bool, Setting("configure and activate by itself, trying again until it works")
    ] = True


class Health(NamedTuple):
    """One diagnostics entry: level, a sentence, and named values."""

    level: bytes
    message: str
    values: dict


class ModuleNode(LifecycleNode):
    """A lifecycle node with parameters, diagnostics and a hot loop.

    Subclasses override what they need of `connect`, `begin`, `step`, `end`, `disconnect` (each in
    lifecycle order), `health` and `changed`.
    """

    def __init__(self, name: str):
        super().__init__(name)
        self.stopping = threading.Event()
        self._active = threading.Event()
        self._outside_step = threading.Event()
        self._outside_step.set()
        self._phase = "unconfigured"
        self._failure = ""
        self.parameters = Parameters(self, self.changed, self._active.is_set)
        self.parameters.declare(StartSettings)
        self.parameters.declare(RealtimeSettings, "realtime")
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_timer(1.0, self.publish_health)
        self._start_timer: Timer | None = None

    # What subclasses fill in ---------------------------------------------------------------

    hardware_id = ""

    def connect(self) -> None:
        """Open what is needed (lifecycle configure). Raise with a clear sentence on failure."""

    def begin(self) -> None:
        """Start streaming (lifecycle activate). Raise with a clear sentence on failure."""

    def step(self) -> None:
        """One pass of the hot loop; must return within some periods, blocking is its own affair."""
        self.stopping.wait(0.05)

    def end(self) -> None:
        """Stop streaming with the torque off (lifecycle deactivate)."""

    def disconnect(self) -> None:
        """Close what `connect` opened (lifecycle cleanup); must bear a half-done `connect`."""

    def health(self) -> Health:
        """Return the diagnostics entry while active."""
        return Health(OK, "running", {})

    def changed(self, kind: type) -> None:
        """Take over parameters of the settings tuple `kind`, changed at run time."""

    # Lifecycle -----------------------------------------------------------------------------

    @property
    def active(self) -> bool:
        """Whether the node is in the lifecycle state active."""
        return self._active.is_set()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle configure."""
        try:
            self.connect()
        except Exception as error:  # the sentence is what the user acts on, whatever its type
            self._fail("configure", error)
            self.disconnect()
            return TransitionCallbackReturn.FAILURE
        self._phase, self._failure = "inactive", ""
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle activate."""
        try:
            self.begin()
        except Exception as error:
            self._fail("activate", error)
            self.end()
            return TransitionCallbackReturn.FAILURE
        self._phase, self._failure = "active", ""
        self._active.set()
        self.get_logger().info("active")
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle deactivate."""
        self._leave_step()
        self.end()
        self._phase = "inactive"
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle cleanup."""
        self.disconnect()
        self._phase = "unconfigured"
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle shutdown: from any state, torque off, everything closed."""
        self.close()
        return TransitionCallbackReturn.SUCCESS

    def close(self) -> None:
        """Stop and disconnect from wherever the node is; safe to call twice."""
        if self._active.is_set():
            self._leave_step()
            self.end()
        if self._phase != "finalized":
            self.disconnect()
        self._phase = "finalized"

    def _leave_step(self) -> None:
        self._active.clear()
        if not self._outside_step.wait(_LEAVE_STEP_S):
            self.get_logger().error("the loop did not end its step in time")

    def _fail(self, doing: str, error: Exception) -> None:
        text = str(error) or type(error).__name__
        if text != self._failure:
            self.get_logger().error(f"cannot {doing}: {text}")
        self._failure = text

    def start_by_itself(self) -> None:
        """Configure and activate when `autostart` says so, again each second until it works."""
        if self.parameters.read(StartSettings).autostart:
            self._start_timer = self.create_timer(_RETRY_S, self._try_start)
            self._try_start()

    def _try_start(self) -> None:
        if self._phase == "unconfigured":
            self.trigger_configure()
        if self._phase == "inactive":
            self.trigger_activate()
        if self._phase in ("active", "finalized"):
            self.destroy_timer(self._start_timer)

    # Hot loop ------------------------------------------------------------------------------

    def run(self) -> None:
        """Run `step` while active, until `stop`; an error in it ends the process."""
        while not self.stopping.is_set():
            if not self._active.wait(0.05):
                continue
            self._outside_step.clear()
            try:
                while self._active.is_set() and not self.stopping.is_set():
                    self.step()
            finally:
                self._outside_step.set()

    # Diagnostics and parameters ------------------------------------------------------------

    def publish_health(self) -> None:
        """Publish the diagnostics entry of now on /diagnostics."""
        if self._active.is_set():
            health = self.health()
        elif self._failure:
            health = Health(ERROR, self._failure, {})
        else:
            health = Health(WARN, f"lifecycle state {self._phase}", {})
        status = DiagnosticStatus(
            level=health.level,
            name=self.get_fully_qualified_name().lstrip("/"),
            message=health.message,
            hardware_id=self.hardware_id,
            values=[KeyValue(key=key, value=str(value)) for key, value in health.values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)


def main(factory: Callable[[], ModuleNode], args: list[str] | None = None) -> int:
    """Run the node `factory` makes until SIGINT or SIGTERM; return the exit code.

    0 after a signal, 1 after an error of the loop, 2 when a parameter or the start was refused.
    """
    stopping = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopping.set())
    # What canopen logs, our errors say with the node id and the way out.
    logging.getLogger("canopen").setLevel(logging.CRITICAL)
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    node, lock = None, None
    try:
        node = factory()
        node.stopping = stopping
        node.parameters.finish()
        lock = lock_node(node.get_fully_qualified_name())
        _live(node)
        return 0
    except (ParameterError, AlreadyRunning) as error:
        print(f"{factory.__name__}: {error}", file=sys.stderr)
        return 2
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
        if lock is not None:
            lock.release()


def _live(node: ModuleNode) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    ended = threading.Event()
    serving = threading.Thread(target=_serve, args=(executor, node, ended), daemon=True)
    serving.start()
    try:
        executor.create_task(node.start_by_itself)
        scheduling = node.parameters.read(RealtimeSettings, "realtime")
        for refused in prepare(scheduling):
            node.get_logger().warning(refused)
        node.run()
    except Exception as error:
        node.get_logger().fatal(f"the loop failed: {type(error).__name__}: {error}")
        raise
    finally:
        ended.set()
        executor.wake()
        serving.join(timeout=_LEAVE_STEP_S)
        node.close()
        executor.shutdown(timeout_sec=0.0)


def _serve(executor: SingleThreadedExecutor, node: ModuleNode, ended: threading.Event) -> None:
    # Not `spin`: an executor that is shut down while it spins trips over its own guard condition.
    try:
        while not ended.is_set():
            executor.spin_once()
    finally:
        node.stopping.set()  # without services and diagnostics the node is no use
