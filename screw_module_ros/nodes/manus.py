# SPDX-License-Identifier: Apache-2.0
"""`manus`: the planar axes, MIT-MANUS: two CiA 402 drives and the planar impedance."""

from __future__ import annotations

import math
from contextlib import suppress
from operator import attrgetter
from typing import Annotated, NamedTuple

from screw_module_msgs.msg import EndpointSetpoint, PlanarState
from screw_module_msgs.srv import SetImpedance
from std_srvs.srv import SetBool, Trigger

from screw_module_ros.axes.joint import JointSettings
from screw_module_ros.axes.planar import PlanarAxes
from screw_module_ros.control.freeze import FreezeSettings
from screw_module_ros.control.gate import GateSettings
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.timing import DeadlineMeter
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.errors import DeviceError
from screw_module_ros.devices.heartbeat import Heartbeat
from screw_module_ros.settings import Setting

from .support import qos, topics
from .support.driver import DriverNode, RateSettings, device_values
from .support.flat import FORCE
from .support.freshness import MOVING_SETPOINT_NS, Newest
from .support.module_node import ERROR, OK, WARN, Done, Health
from .support.permission import Permission
from .support.runtime import main as run_node
from .support.timing_report import broken_contract

JOINTS = ("shoulder", "elbow")
_NOWHERE = (math.nan, math.nan, 0.0, 0.0)
_FORCE_AGE_NS = 200_000_000


class ManusSettings(NamedTuple):
    """What the node adds to drives and law."""

    state_every: Annotated[int, Setting("ticks per manus/state message", "", 1, 100)] = 4
    handle_force_limit: Annotated[
        float, Setting("planar handle force that stops the plane", "N", 1.0, 1000.0)
    ] = 150.0
    missed_limit: Annotated[
        int, Setting("deadlines missed in a row that stop the torque", "", 1, 1000)
    ] = 20
    master_id: Annotated[int, Setting("node id of our own heartbeat", "", 1, 127)] = 113
    allow_unguarded: Annotated[
        bool, Setting("DANGER: enable drives that do not stop by themselves when we hang")
    ] = False


class ManusNode(DriverNode):
    """One tick: SYNC, both positions, law, both torques."""

    def __init__(self):
        super().__init__("manus", port=43116, rate=500.0)
        self.parameters.declare(ManusSettings)
        shared = ("rate", "master_id", "allow_unguarded")
        for joint, node_id in zip(JOINTS, (3, 4), strict=True):
            self.parameters.declare(
                DriveSettings, joint, shared, node_id=node_id, rated_torque=10.0, max_torque=25.0,
                counts_per_turn=65536,
            )  # fmt: skip
        self.parameters.declare(JointSettings, "joints")
        self.parameters.declare(FreezeSettings, "freeze")
        self.parameters.declare(PlanarSettings)
        self.parameters.declare(GateSettings, "gate")
        self._state = PlanarState()
        self._latency_p99 = 0.0
        self._state.header.frame_id = "manus_base"
        self._axes: PlanarAxes | None = None
        self.serve(SetBool, "~/enable", self._enable)
        self.serve(Trigger, "~/clear_fault", self._clear_fault, "cleared; call ~/enable to enable")
        self.serve(Trigger, "~/home", self._home, "homed at the reference mark")
        self.serve(SetImpedance, "~/set_impedance", self._set_impedance, always=True)

    # Lifecycle -----------------------------------------------------------------------------

    def connect(self) -> None:
        """Find both drives, configure them and their guards."""
        own = self.parameters.read(ManusSettings)
        rate = self.parameters.read(RateSettings).rate
        common = {
            "rate": rate, "master_id": own.master_id, "allow_unguarded": own.allow_unguarded
        }
        settings = [self.parameters.read(DriveSettings, j)._replace(**common) for j in JOINTS]
        law = self.parameters.read(PlanarSettings).validated()
        port = self.open_port(
            *(f"drive node {each.node_id}" for each in settings), f"master {own.master_id}"
        )
        beat = Heartbeat(port, own.master_id, settings[0].heartbeat_period)
        self._drives = tuple(
            Drive(port, each, f"{joint} drive", beat)
            for joint, each in zip(JOINTS, settings, strict=True)
        )
        for drive in self._drives:
            drive.configure()
            for warning in drive.warnings:
                self.get_logger().warning(warning)
        self.hardware_id = ", ".join(drive.identity for drive in self._drives)
        self.check_bus_load([*self._drives[0].traffic, *self._drives[1].traffic[1:]])
        self._own = own
        self._axes = PlanarAxes(
            self._drives,
            self.period_ns,
            law,
            self.parameters.read(JointSettings, "joints"),
            self.parameters.read(GateSettings, "gate"),
            self.parameters.read(FreezeSettings, "freeze"),
        )
        self._make_topics()

    def _make_topics(self) -> None:
        inbox = self.new_inbox()
        take = inbox.subscribe
        self._setpoint = Newest(take(EndpointSetpoint, "setpoint", qos.COMMAND), MOVING_SETPOINT_NS)
        self._force = Newest(take(FORCE, topics.SLOW_FORCE, qos.SAMPLE), _FORCE_AGE_NS)
        self._permission = Permission(self, inbox, attrgetter("planar_permitted"))
        self._publish = self.outlet(PlanarState, "manus/state", qos.STATE)

    def begin(self) -> None:
        """Start the drives, disabled."""
        self._meter = DeadlineMeter(self.period_ns)
        for drive in self._drives:
            drive.start()
        self.start_clock()

    def end(self) -> None:
        """Torque off and a clean exit of both drives."""
        self.stop_clock()
        problem = self._axes.shutdown(self.port)
        if problem:
            self.get_logger().warning(f"drives not left cleanly: {problem}")

    def disconnect(self) -> None:
        """Close the bus."""
        if self._inbox is not None:
            self._permission.close()
        self._axes = None
        self.close_port()

    def changed(self, kind: type) -> None:
        """Take over live parameters; the law fades them in."""
        if kind is PlanarSettings and self._axes is not None:
            self._axes.settings = self.parameters.read(PlanarSettings)

    # Hot loop ------------------------------------------------------------------------------

    def step(self) -> None:
        """One tick."""
        tick = self.next_tick()
        now = tick.monotonic_ns
        # Errors of the bus are latched by the driver, shown by state and diagnostics; gate and
        # writes get their turn whatever else fails.
        with suppress(DeviceError):
            self._axes.request(now)
        self._look_around(now)
        answered = False
        with suppress(DeviceError):
            answered = self._await_drives(now)
        with suppress(DeviceError):
            if answered:
                self._axes.act(self._wanted(now), now, self._hand)
                self._meter.tick(tick.sequence, now, self.clock.now_ns())
            else:
                self._axes.idle(now)
        if tick.sequence % self._own.state_every == 0:
            self._publish_state(tick.sequence, now)

    def _await_drives(self, since: int) -> bool:
        due = self.ticker.due_ns()
        while not self._axes.answered(since):
            if self.clock.now_ns() >= due:
                return False
            self.port.pump(due)
        return True

    def _look_around(self, now: int) -> None:
        drives = self._axes.drives
        self._permission.pass_on(drives, now)
        force = self._force.fresh(now)
        self._hand = (force.fx, force.fy) if force is not None else (math.nan, math.nan)
        if force is not None and not math.hypot(force.fx, force.fy) <= self._own.handle_force_limit:
            drives.fault = drives.fault or (
                f"{math.hypot(force.fx, force.fy):.0f} N on the handle in the plane, more than "
                f"{self._own.handle_force_limit:g} N"
            )
        drives.missed(self._meter.missed_in_a_row(now), self._own.missed_limit)

    def _wanted(self, now: int) -> tuple[float, float, float, float]:
        self._setpoint.update(now)
        wanted = self._setpoint.message
        if wanted is None:
            return _NOWHERE
        position, velocity = wanted.position, wanted.velocity
        if self._setpoint.stale(now):
            return position.x, position.y, 0.0, 0.0
        return position.x, position.y, velocity.x, velocity.y

    def _publish_state(self, sequence: int, now: int) -> None:
        message, axes, meter = self._state, self._axes, self._meter
        drives, output = axes.drives, axes.output
        self.stamp(message.header)
        message.sequence, message.monotonic_ns = sequence, now
        message.homed = axes.homed
        message.enabled, message.faulted = drives.enabled, drives.faulted
        message.reason = drives.reason
        message.drive_state = [int(drive.state(now)) for drive in self._drives]
        message.error_code = [drive.error_code for drive in self._drives]
        message.joint_position = [joint.angle for joint in axes.joints]
        message.joint_velocity = [joint.velocity for joint in axes.joints]
        message.commanded_torque = list(axes.written)
        message.measured_torque = [
            drive.reading.torque if drive.reading else 0.0 for drive in self._drives
        ]
        if output is not None:
            message.position = [output.x, output.y]
            message.velocity = [output.vx, output.vy]
            message.force = [output.force_x, output.force_y]
            message.desired_position = [output.desired_x, output.desired_y]
            message.saturated = output.saturated
        message.stiffness, message.damping = axes.settings.stiffness, axes.settings.damping
        message.rate = meter.rate(now)
        self._latency_p99 = meter.latency(0.99)
        message.samples, message.late, message.lost = meter.samples, meter.late, meter.lost
        message.success_rate = meter.success_rate
        self._publish(message)

    # Services ------------------------------------------------------------------------------

    def _enable(self, request: SetBool.Request) -> str:
        if request.data:
            return self._axes.enable(self.clock) or Done("enabled")
        return self._axes.drives.disable(self.clock) or Done("disabled")

    def _clear_fault(self, request: Trigger.Request) -> str:
        return self._axes.clear_fault(self.clock)

    def _home(self, request: Trigger.Request) -> str:
        return self._axes.home(self.clock.now_ns())

    def _set_impedance(self, request: SetImpedance.Request) -> str:
        return self.parameters.write(stiffness=request.stiffness, damping=request.damping)

    def health(self) -> Health:
        """State of the drives, timing, counters."""
        # The meter belongs to the hot loop, this is another thread: what the loop told last.
        now, state, drives = self.clock.now_ns(), self._state, self._axes.drives
        values = {
            "rate [1/s]": f"{state.rate:.0f}",
            "latency p99 [us]": f"{self._latency_p99 * 1e6:.0f}",
            "late": state.late,
            "lost": state.lost,
            "homed": self._axes.homed,
            **self.port_values(),
        }
        for joint, drive in zip(JOINTS, self._drives, strict=True):
            values[f"{joint} state"] = drive.state(now).text
            counters = device_values(drive.snapshot())
            values.update({f"{joint} {name}": count for name, count in counters.items()})
        if drives.faulted:
            return Health(ERROR, drives.reason, values)
        warnings = [self._permission.warning]
        warnings += [warning for drive in self._drives for warning in drive.warnings]
        if drives.enabled:
            warnings.append(broken_contract(state))
        if warning := next(filter(None, warnings), ""):
            return Health(WARN, warning, values)
        return Health(OK, "enabled" if drives.enabled else drives.reason, values)


def main() -> int:
    """Console entry point."""
    return run_node(ManusNode)


if __name__ == "__main__":
    raise SystemExit(main())
