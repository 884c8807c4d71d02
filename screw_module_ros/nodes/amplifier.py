# SPDX-License-Identifier: Apache-2.0
"""`amplifier`: the vertical CiA 402 drive; writes the torque as soon as a command arrives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, NamedTuple

from screw_module_msgs.msg import AmplifierState

from screw_module_ros import graph
from screw_module_ros.calibration.selection import (
    CalibrationSettings,
    LinearizationSettings,
    chosen_linearization,
)
from screw_module_ros.control.limits import COLD, CommandLimits, TorqueLimits
from screw_module_ros.control.linearization import IDENTITY
from screw_module_ros.control.torque_chain import TorqueChain, largest_command
from screw_module_ros.devices import drive_group
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.geometry import Screw, torque_to_force
from screw_module_ros.loop.drive import VerticalDrive
from screw_module_ros.loop.vertical import Roles, VerticalLoop, Wires
from screw_module_ros.profiles import DRIVE, load
from screw_module_ros.safety.permit import Permit, PermitSettings
from screw_module_ros.samples import Command
from screw_module_ros.settings import Setting

from .support.driver import device_values
from .support.drives import VERTICAL, DriveNode
from .support.states import (
    Due,
    Health,
    at_base,
    fill_latencies,
    fill_permit,
    latency_values,
    timing_values,
)
from .support.topics import offered, requested

_NEXT_COMMANDS, _COMMANDS_S = 2, 0.05
_AT_REST_S = 1.0  # time in which a drive that is being disabled has come to rest


class AmplifierSettings(NamedTuple):
    """Settings of the node beside those of drive, gate and limits."""

    missed_limit: Annotated[
        int, Setting("deadlines missed in a row that stop the torque", "", 1, 1000)
    ] = 20
    state_rate: Annotated[
        float, Setting(f"{graph.AMPLIFIER_STATE} messages per second", "Hz", 1.0, 500.0)
    ] = graph.TOPICS[graph.AMPLIFIER_STATE].rate


class AmplifierNode(DriveNode):
    """SYNC and heartbeat on the tick, torque on the command.

    role: from the first `begin` on. state: the newest message.
    """

    role: VerticalDrive

    def __init__(self) -> None:
        super().__init__("amplifier")
        self.parameters.declare(
            AmplifierSettings, CalibrationSettings, LinearizationSettings, DriveSettings,
            CommandLimits, Screw, torque=TorqueLimits,
        )  # fmt: skip
        self.state = at_base(AmplifierState)
        self._heat: Callable[[int], float] = lambda now_ns: COLD  # of the motor, at a time [ns]

    # Lifecycle -----------------------------------------------------------------------------

    def connect(self) -> None:
        """Find the drive, configure it and its guards."""
        settings = self.parameters.read(DriveSettings)
        self._screw = self.parameters.read(Screw)
        linearization, self.state.calibration = chosen_linearization(
            self.parameters.read(CalibrationSettings), self.parameters.read(LinearizationSettings)
        )
        self._chain = TorqueChain(
            self.parameters.read(CommandLimits),
            self.parameters.read(TorqueLimits, "torque"),
            self._screw,
            linearization or IDENTITY,
            settings.rated_torque,
        )
        self._max_torque = settings.max_torque
        largest = min(self._max_torque, largest_command(self._chain))
        settings = settings._replace(max_torque=largest)
        port = self.open_port(*settings.claims)
        profile = load(settings.profile, DRIVE)
        self.configure_drives(
            Drive(port, settings, "vertical drive", per_turn=self._screw.lead, profile=profile)
        )
        self.check_bus_load(self.drives[0].traffic)
        self.get_logger().info(f"linearization: {self.state.calibration}")
        self._commands = self.new_inbox()
        self._take_command = self._commands.subscribe(*requested(graph.FORCE_COMMAND), wakes=True)
        self.follow(self._commands, VERTICAL, alone=graph.FORCE_COMMAND)
        self._publish = self.outlet(*offered(graph.AMPLIFIER_STATE))

    def begin(self) -> None:
        """Start the drive, disabled."""
        own = self.parameters.read(AmplifierSettings)
        (drive,) = self.drives
        # The motor does not cool by a new activation.
        heat = self._heat(self.clock.now_ns())
        self.role = VerticalDrive(
            drive,
            self.port,
            self.period_ns,
            self.parameters.read(PermitSettings, "gate"),
            self._chain,
            own.missed_limit,
            heat,
        )
        self._heat = self.role.heat
        self._state_due = Due(own.state_rate)
        self.state.success_rate = self.role.meter.success_rate
        wires = Wires(
            take_command=self.take_command,
            permission=self.permission,
            publish_drive_state=self.publish_state,
        )
        self._loop = VerticalLoop(self.clock, self.period_ns, wires)
        self.start_drives()

    def leave(self) -> str:
        """Shut the drive down cleanly; return the errors."""
        return drive_group.leave(self.drives, self.port)

    # Hot loop ------------------------------------------------------------------------------

    def step(self) -> None:
        """Do one period: SYNC on the tick, then torque on each command."""
        self._loop.step(Roles(drive=self.role))

    def take_command(self, until_ns: int) -> Command | None:
        """Wait for a command on the topic, until `until_ns` [ns] at most.

        A command that arrives exactly then belongs to the next tick: the loop takes it after that
        tick's SYNC and the drive's answer, so the result does not depend on process speed.
        """
        self._commands.wait(until_ns)
        return self._take_command(early=self.clock.now_ns() < until_ns)

    def publish_state(self, now_ns: int) -> None:
        """Publish the state when due."""
        if self._state_due(now_ns):
            self.stamp(self.state.header)
            fill_amplifier(self.state, self.role, now_ns)
            self._publish(self.state)

    # Services ------------------------------------------------------------------------------

    def prepare(self) -> str:
        """Tell the drive its own limit for the mode that is to be enabled; return why not.

        Its own limit of the laws is less than a trial needs, and must be back after it.
        """
        clock, permit, counted = self.clock, self.permit, self.role.meter
        before = counted.samples
        # A mode that was just set comes with the next commands.
        clock.wait_for(lambda: counted.samples > before + _NEXT_COMMANDS, _COMMANDS_S)
        (drive,) = self.drives
        largest = min(self._max_torque, self.role.ready())
        if largest == drive.drive_limit:
            return ""
        if not clock.wait_for(lambda: permit.at_rest(clock.now_ns()), _AT_REST_S):
            return "the drive is not off yet: disable it first"
        drive.limit(largest)
        return ""

    @property
    def permit(self) -> Permit:
        """The gate with the drive."""
        return self.role.permit

    def health(self) -> Health:
        """State of the drive, timing, counters."""
        state, role, drive = self.state, self.role, self.drives[0]
        now_ns, limits = self.clock.now_ns(), self._chain.limits
        values = {
            **timing_values(state, role.meter),
            **latency_values("own", role.own),
            "state": drive.state(now_ns).text,
            "motor heat [%]": f"{100.0 * role.heat(now_ns) / limits.continuous**2:.0f}",
            "largest force [N]": f"{torque_to_force(limits.peak, self._screw):.0f}",
            "calibration": state.calibration,
            **device_values(drive.counters),
            **self.port_values(role.skipped),
        }
        return self.drive_health(values, state)


def fill_amplifier(message: AmplifierState, role: VerticalDrive, now_ns: int) -> None:
    """Write the vertical drive's state into its message."""
    drive, reading = role.drive, role.drive.reading
    message.state = int(drive.state(now_ns))
    message.statusword = reading.statusword if reading else 0
    message.error_code = drive.error_code
    fill_permit(message, role.permit)
    message.commanded_force = role.asked
    message.commanded_torque = role.last.torque
    message.measured_torque = reading.torque if reading else 0.0
    message.position = role.position
    message.brakes = role.brakes
    message.saturated = role.last.saturated
    message.commands = role.meter.samples
    fill_latencies(message, role.meter, now_ns)
