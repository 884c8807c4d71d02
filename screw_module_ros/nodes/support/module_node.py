# SPDX-License-Identifier: Apache-2.0
"""A lifecycle node with parameters, diagnostics and a hot loop: what every node here is.

`runtime` gives it a process.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection
from typing import Annotated, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.timer import Timer

from screw_module_ros.settings import Setting

from .parameters import Parameters
from .realtime import RealtimeSettings

_LEAVE_STEP_S = 2.0
_RETRY_S = 1.0
_IDLE_S = 0.05

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


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
        self.parameters = Parameters(self, self.changed, self._is_configured)
        self.parameters.declare(StartSettings)
        self.parameters.declare(RealtimeSettings, "realtime")
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_timer(1.0, self.publish_health)
        self._start_timer: Timer | None = None

    # What subclasses fill in ---------------------------------------------------------------

    hardware_id = ""

    direct: Collection[str] = ()
    """Topics that other parts of this process hand over by calls (see `Inbox`)."""

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

    def _is_configured(self) -> bool:
        return self._phase in ("inactive", "active")

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

    def close(self, ended: Callable[[], None] = lambda: None) -> None:
        """Stop and disconnect from wherever the node is; safe to call twice.

        ended: called when the node's work is done and only topics and buses are left to close.
        """
        if self._active.is_set():
            self._leave_step()
            self.end()
        ended()
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
        try:
            while not self.stopping.is_set():
                if self.takes_part():
                    self.step()
                else:
                    self._active.wait(_IDLE_S)
        finally:
            self.leaves()

    def takes_part(self) -> bool:
        """Return whether the loop may run this node's part now.

        The loop's thread asks before each step; until it asks again, or calls `leaves`, nothing
        the step uses is taken away.
        """
        if self._active.is_set():
            if not self._outside_step.is_set():
                return True
            self._outside_step.clear()
            if self._active.is_set():  # whoever clears it waits for us from now on
                return True
        self._outside_step.set()
        return False

    def leaves(self) -> None:
        """Tell that the loop has ended its last step."""
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
