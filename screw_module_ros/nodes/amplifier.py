# SPDX-License-Identifier: Apache-2.0
"""`amplifier`: the vertical CiA 402 drive; writes the torque as soon as a command comes."""

from __future__ import annotations

from operator import attrgetter
from typing import Annotated, NamedTuple

from screw_module_msgs.msg import AmplifierState
from std_srvs.srv import SetBool, Trigger

from screw_module_ros.calibration.chosen import chosen_linearization
from screw_module_ros.calibration.module import CalibrationSettings
from screw_module_ros.control.gate import GateSettings
from screw_module_ros.control.limits import CommandLimits, TorqueLimits
from screw_module_ros.control.torque_chain import torque_chain
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.geometry import Screw, torque_to_force
from screw_module_ros.loop.drive import VerticalDrive
from screw_module_ros.loop.gated_drives import GatedDrives
from screw_module_ros.loop.vertical import Parts, VerticalLoop, Wires
from screw_module_ros.settings import Setting

from .support import qos
from .support.driver import DriverNode, RateSettings, device_values
from .support.due import Due
from .support.flat import COMMAND, Command
from .support.module_node import ERROR, OK, WARN, Done, Health
from .support.permission import Permission
from .support.runtime import main as run_node
from .support.states import fill_amplifier
from .support.timing_report import broken_contract, latency_values, timing_values

_CLEARED = "cleared; call ~/enable to enable"


class AmplifierSettings(NamedTuple):
    """What stands between the force command and the drive."""

    linearize: Annotated[
        bool, Setting("undo the amplifier's dead zone around zero (thesis 4.1.1)")
    ] = True
    linearization_file: Annotated[
        str, Setting("linearization file, empty for the thesis's dead zone of 0.025 Nm or when "
                     "calibration_file is set")
    ] = ""
    missed_limit: Annotated[
        int, Setting("deadlines missed in a row that stop the torque", "", 1, 1000)
    ] = 20
    state_rate: Annotated[
        float, Setting("screw/amplifier_state messages per second", "Hz", 1.0, 500.0)
    ] = 100.0


class AmplifierNode(DriverNode):
    """SYNC and heartbeat on the tick, torque on the command."""

    def __init__(self):
        super().__init__("amplifier", port=43114)
        self.parameters.declare(AmplifierSettings)
        self.parameters.declare(CalibrationSettings)
        self.parameters.declare(DriveSettings, without=("rate",))
        self.parameters.declare(GateSettings, "gate")
        self.parameters.declare(TorqueLimits, "torque")
        self.parameters.declare(CommandLimits)
        self.parameters.declare(Screw)
        self._state = AmplifierState()
        self._state.header.frame_id = "manus_base"
        self._drive: Drive | None = None
        self.serve(SetBool, "~/enable", self._enable)
        self.serve(Trigger, "~/clear_fault", self._clear_fault, _CLEARED)

    # Lifecycle -----------------------------------------------------------------------------

    def connect(self) -> None:
        """Find the drive, configure it and its guards."""
        own = self.parameters.read(AmplifierSettings)
        rate = self.parameters.read(RateSettings).rate
        settings = self.parameters.read(DriveSettings)._replace(rate=rate)
        self._linearization, self._state.calibration = chosen_linearization(
            self.parameters.read(CalibrationSettings), own.linearization_file, own.linearize
        )
        port = self.open_port(f"drive node {settings.node_id}", f"master {settings.master_id}")
        self._screw = self.parameters.read(Screw)
        self._drive = Drive(port, settings, "vertical drive", per_turn=self._screw.lead)
        self._drive.configure()
        self.hardware_id = self._drive.identity
        for warning in self._drive.warnings:
            self.get_logger().warning(warning)
        self.check_bus_load(self._drive.traffic)
        self.get_logger().info(f"linearization: {self._state.calibration}")
        inbox = self.new_inbox()
        self._take_command = inbox.subscribe(
            COMMAND, "screw/force_command", qos.COMMAND, wakes=True
        )
        self._permission = Permission(self, inbox, attrgetter("vertical_permitted"))
        self._publish = self.outlet(AmplifierState, "screw/amplifier_state", qos.STATE)

    def begin(self) -> None:
        """Start the drive, disabled."""
        own = self.parameters.read(AmplifierSettings)
        self.part = VerticalDrive(
            self._drive,
            self.port,
            self.period_ns,
            self.parameters.read(GateSettings, "gate"),
            torque_chain(
                self.parameters.read(CommandLimits),
                self.parameters.read(TorqueLimits, "torque"),
                self._linearization,
                self._screw,
                self._drive.settings.rated_torque,
            ),
            own.missed_limit,
        )
        self._state_due = Due(own.state_rate)
        self._state.success_rate = self.part.meter.success_rate
        wires = Wires(
            take_command=self.take_command, permission=self.permission, drive_state=self.tell_state
        )
        self._loop = VerticalLoop(self.clock, self.period_ns, wires)
        self._drive.start()
        self.start_polls()

    def end(self) -> None:
        """Torque off and a clean exit, so that the next start does not begin in fault."""
        self.stop_polls()
        problem = self._drive.shutdown()
        if problem:
            self.get_logger().warning(f"drive not left cleanly: {problem}")

    def disconnect(self) -> None:
        """Close the bus."""
        if self._inbox is not None:
            self._permission.close()
        self._drive = None
        self.close_port()

    # Hot loop ------------------------------------------------------------------------------

    def step(self) -> None:
        """Do what commands and the tick ask for."""
        self._loop.step(Parts(drive=self.part))

    def take_command(self, until_ns: int) -> Command | None:
        """Wait for a command on the topic, until `until_ns` [ns] at most."""
        self._inbox.wait(until_ns)
        return self._take_command()

    def permission(self, drives: GatedDrives, now_ns: int) -> None:
        """Tell the gate what the supervisor permits."""
        self._permission.pass_on(drives, now_ns)

    def tell_state(self, now_ns: int) -> None:
        """Publish the state when it is due."""
        if self._state_due(now_ns):
            self.stamp(self._state.header)
            fill_amplifier(self._state, self.part, now_ns)
            self._publish(self._state)

    # Services ------------------------------------------------------------------------------

    def _enable(self, request: SetBool.Request) -> str:
        drives = self.part.drives
        if not request.data:
            return drives.disable(self.clock) or Done("disabled")
        publishers = self._inbox.publishers("screw/force_command")
        if publishers > 1:
            return f"{publishers} nodes publish screw/force_command: one is allowed"
        return drives.enable(self.clock) or Done("enabled")

    def _clear_fault(self, request: Trigger.Request) -> str:
        return self.part.drives.clear_fault(self.clock)

    def health(self) -> Health:
        """State of the drive, timing, counters."""
        told, part, drives = self._state, self.part, self.part.drives
        peak = torque_to_force(self.parameters.read(TorqueLimits, "torque").peak, self._screw)
        values = {
            **timing_values(told, part.meter),
            **latency_values("own", part.own),
            "state": self._drive.state(self.clock.now_ns()).text,
            "largest force [N]": f"{peak:.0f}",
            "calibration": told.calibration,
            **device_values(self._drive.snapshot()),
            **self.port_values(part.skipped),
        }
        if drives.faulted:
            return Health(ERROR, drives.reason, values)
        warnings = [self._permission.warning, *self._drive.warnings]
        if drives.enabled:
            warnings.append(broken_contract(told))
        if warning := next(filter(None, warnings), ""):
            return Health(WARN, warning, values)
        return Health(OK, "enabled" if drives.enabled else drives.reason, values)


def main() -> int:
    """Console entry point."""
    return run_node(AmplifierNode)


if __name__ == "__main__":
    raise SystemExit(main())
