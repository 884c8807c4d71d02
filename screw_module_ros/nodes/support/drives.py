# SPDX-License-Identifier: Apache-2.0
"""Base of `amplifier` and `manus`: drives behind one gate, opened by services and supervisor."""

from __future__ import annotations

from itertools import islice
from typing import Any

from rclpy.lifecycle import LifecycleState
from rclpy.lifecycle import TransitionCallbackReturn as Outcome
from screw_module_msgs.msg import SafetyState
from std_srvs.srv import SetBool, Trigger

from screw_module_ros import graph
from screw_module_ros.devices import drive_group
from screw_module_ros.devices.drive import Drive
from screw_module_ros.loop import gate
from screw_module_ros.safety.permit import Permit, PermitSettings

from . import topics
from .answering import Done
from .driver import DriverNode
from .inbox import Inbox
from .node import Node
from .states import ERROR, OK, WARN, Health, broken_contract
from .topics import requested

_SLOW_POLL_S = 0.2
_ASKED_EARLY = "asked for while the drive was made ready: call ~/enable again"
_CLEARED = "cleared; call ~/enable to enable"
VERTICAL, PLANAR = "vertical_permitted", "planar_permitted"
"""Fields of SafetyState."""


class DriveNode(DriverNode):
    """A node with drives. Subclasses define `permit` and override further methods."""

    def __init__(self, name: str, rate: float = 1000.0):
        super().__init__(name, rate)
        self.parameters.declare(gate=PermitSettings)
        self.periodic.every(self.clock, _SLOW_POLL_S, self._poll_slow)
        self._enabling = self.serve(SetBool, "~/enable", self._enable)
        self.serve(
            Trigger, "~/clear_fault", lambda request: self.clear_fault(), _CLEARED,
            then=self._refuse_waiting,
        )  # fmt: skip

    def on_activate(self, state: LifecycleState) -> Outcome:
        """Lifecycle activate."""
        outcome = super().on_activate(state)
        self._refuse_waiting()
        return outcome

    @property
    def permit(self) -> Permit:
        """The gate with its drives."""
        raise NotImplementedError

    def enable(self) -> str:
        """Enable; return why it failed, empty when done."""
        self._poll_slow()  # the mode, where nothing has brought it of late
        return self._senders.count() or self.prepare() or gate.enable(self.permit, self.requests)

    def prepare(self) -> str:
        """Tell the drives what this enabling needs; return why they cannot be enabled."""
        return ""

    def clear_fault(self) -> str:
        """Recover; return the remaining fault, empty if none."""
        return gate.clear_fault(self.permit, self.requests)

    def leave(self) -> str:
        """Shut the drives down cleanly, after the loop has ended; return the errors."""
        raise NotImplementedError

    def configure_drives(self, *drives: Drive) -> None:
        """Configure the drives, one after the other. Raises DeviceError."""
        self.drives = drives
        for drive in drives:
            self.configure_device(drive)
            self._log_warnings(drive)
        self.hardware_id = ", ".join(drive.identity for drive in drives)

    def start_drives(self) -> None:
        """Start the drives, disabled and with their guards. Raises DeviceError."""
        for drive in drive_group.start(self.drives):
            self._log_warnings(drive)

    def _refuse_waiting(self) -> None:
        """Enable nothing for a client that asked while the drives were made ready: it may be gone.

        To clear a fault, or to activate, can take seconds, and torque would come when nobody
        expects it any more.
        """
        self.refuse_waiting(self._enabling, _ASKED_EARLY, lambda request: request.data)

    def _poll_slow(self) -> None:
        """Read what the drives do not report by themselves."""
        for drive in self.drives if self.active else ():
            drive.poll_slow()

    def _log_warnings(self, drive: Drive) -> None:
        for warning in drive.warnings:
            self.get_logger().warning(warning)

    def follow(self, inbox: Inbox, field: str, alone: str) -> None:
        """Follow this field of safety_state.

        alone: a topic that only one node may publish; else enabling is refused, and an open gate
        closes.
        """
        self._permission = Permission(self, inbox, field)
        self._senders = self.senders(alone)

    def permission(self, permit: Permit, now_ns: int) -> None:
        """Pass the supervisor's permission to the gate; two senders close an open gate."""
        self._permission.pass_on(permit, now_ns)
        if permit.enabled:
            permit.fault.set(self._senders.warning)

    def end(self) -> None:
        """Switch the torque off and exit cleanly, so that the next start finds no fault."""
        problem = self.leave()
        if problem:
            self.get_logger().warning(f"not shut down cleanly: {problem}")

    def _enable(self, request: SetBool.Request) -> str:
        if request.data:
            refused = self.enable()
            for drive in () if refused else self.drives:
                if drive.danger:
                    self.get_logger().error(drive.danger)
            return refused or Done("enabled")
        gate.disable(self.permit, self.requests)
        return Done("disabled")

    @property
    def alarm(self) -> str:
        """The gate's latched fault."""
        return self.permit.reason if self.permit.faulted else ""

    def drive_health(self, values: dict, state: Any) -> Health:
        """Return the diagnostics with these values; state: the newest state message."""
        permit = self.permit
        if alarm := self.alarm:  # once: the loop may end it meanwhile
            return Health(ERROR, alarm, values)
        warnings = [drive.danger for drive in self.drives] if permit.enabled else []
        warnings.append(self._permission.warning)
        warnings += [warning for drive in self.drives for warning in drive.warnings]
        if permit.enabled:
            warnings.append(broken_contract(state))
        if warning := next(filter(None, warnings), ""):
            return Health(WARN, warning, values)
        return Health(OK, "enabled" if permit.enabled else permit.reason, values)


class Permission:
    """Subscribes `safety_state` for the hot loop and counts its senders.

    field: of the message, with the axis group's permission.
    """

    def __init__(self, node: Node, inbox: Inbox, field: str):
        self._field = field
        self._take = inbox.subscribe(*requested(graph.SAFETY_STATE, topics.PERMISSION))
        self._senders = node.senders(graph.SAFETY_STATE)

    @property
    def warning(self) -> str:
        """Message when more than one node publishes safety_state, else empty."""
        return self._senders.warning

    def pass_on(self, permit: Permit, now_ns: int) -> None:
        """Pass new messages to the gate, each with the time at which it came.

        Two senders count as a refusal. now_ns [ns].
        """
        for safety in islice(iter(self._take, None), topics.PERMISSION.depth):
            came_ns = getattr(self._take, "arrived_ns", now_ns)
            permit.supervise(
                getattr(safety, self._field), _permission_refusal(safety, self._field), came_ns
            )
        if self.warning:
            permit.supervise(False, self.warning, now_ns)


def _permission_refusal(safety: SafetyState, field: str) -> str:
    """Return why this field withholds the permission of its axes, empty if it does not.

    The message's reasons are those against all motion: the lock and a node that is not required
    leave the other axes alone.
    """
    if getattr(safety, field):
        return ""
    if safety.reasons:
        return safety.reasons[0]
    if safety.vertical_locked and field == VERTICAL:
        return "the vertical axis is locked; pin out, then supervisor/lock_vertical with false"
    return "the supervisor's parameter `required` does not name this node"
