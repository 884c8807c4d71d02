# SPDX-License-Identifier: Apache-2.0
"""Base of `amplifier` and `manus`: drives behind one gate, opened by services and supervisor."""

from __future__ import annotations

from typing import Any

from std_srvs.srv import SetBool, Trigger

from screw_module_ros.devices import drive_group
from screw_module_ros.devices.drive import Drive
from screw_module_ros.safety.permit import Permit, PermitSettings

from .driver import DriverNode
from .health import ERROR, OK, WARN, Health
from .hot_topics import Inbox
from .permission import Permission
from .senders import Senders, too_many_senders
from .serving_node import Done
from .timing_report import broken_contract

_CLEARED = "cleared; call ~/enable to enable"


class DriveNode(DriverNode):
    """A node with drives. Subclasses define `permit` and override further methods."""

    def __init__(self, name: str, rate: float = 1000.0):
        super().__init__(name, rate)
        self.parameters.declare(PermitSettings, "gate")
        self.drives: tuple[Drive, ...] = ()
        self._alone: tuple[str, ...] = ()
        self._senders: Senders | None = None
        self._permission: Permission | None = None
        self.serve(SetBool, "~/enable", self._enable)
        self.serve(Trigger, "~/clear_fault", lambda request: self.clear_fault(), _CLEARED)

    @property
    def permit(self) -> Permit:
        """The gate with its drives."""
        raise NotImplementedError

    def enable(self) -> str:
        """Enable; return why it failed, empty when done."""
        return self.two_senders() or self.permit.enable(self.clock)

    def two_senders(self) -> str:
        """Return a message if a topic of `want_one_sender` has several now, else empty."""
        found = (too_many_senders(self, topic) for topic in self._alone)
        return next(filter(None, found), "")

    def want_one_sender(self, topic: str) -> None:
        """Refuse to enable, and stop, while more than one node publishes this topic."""
        self._alone = (topic,)
        self._senders = Senders(self, self._alone)

    def clear_fault(self) -> str:
        """Recover; return the remaining fault, empty if none."""
        return self.permit.clear_fault(self.clock)

    def leave(self) -> str:
        """Shut the drives down cleanly, after the loop has ended; return the errors."""
        raise NotImplementedError

    def configure_drives(self, *drives: Drive) -> None:
        """Configure the drives, one after the other. Raises DeviceError."""
        self.drives = drives
        for drive in drives:
            drive.configure()
            self._tell_warnings(drive)
        self.hardware_id = ", ".join(drive.identity for drive in drives)

    def start_drives(self) -> None:
        """Start the drives, disabled and with their guards. Raises DeviceError."""
        for drive in drive_group.start(self.drives):
            self._tell_warnings(drive)

    def _tell_warnings(self, drive: Drive) -> None:
        for warning in drive.warnings:
            self.get_logger().warning(warning)

    def follow_permission(self, inbox: Inbox, field: str) -> None:
        """Follow this field of safety_state."""
        self._permission = Permission(self, inbox, field)

    def permission(self, permit: Permit, now_ns: int) -> None:
        """Pass the supervisor's permission to the gate; two senders close an open gate."""
        self._permission.pass_on(permit, now_ns)
        if self._senders is not None and permit.enabled:
            permit.fault.set(self._senders.warning)

    def end(self) -> None:
        """Switch the torque off and exit cleanly, so that the next start finds no fault."""
        self.stop_polls()
        problem = self.leave()
        if problem:
            self.get_logger().warning(f"not shut down cleanly: {problem}")

    def disconnect(self) -> None:
        """Close the bus."""
        if self._permission is not None:
            self._permission.close()
            self._permission = None
        if self._senders is not None:
            self._senders.close()
            self._senders = None
        self.drives = ()
        self.close_port()

    def _enable(self, request: SetBool.Request) -> str:
        if request.data:
            return self.enable() or Done("enabled")
        return self.permit.disable(self.clock) or Done("disabled")

    def drive_health(self, values: dict, state: Any) -> Health:
        """Return the diagnostics with these values; state: the newest state message."""
        permit = self.permit
        if permit.faulted:
            return Health(ERROR, permit.reason, values)
        warnings = [self._permission.warning]
        warnings += [warning for drive in self.drives for warning in drive.warnings]
        if permit.enabled:
            warnings.append(broken_contract(state))
        if warning := next(filter(None, warnings), ""):
            return Health(WARN, warning, values)
        return Health(OK, "enabled" if permit.enabled else permit.reason, values)
