# SPDX-License-Identifier: Apache-2.0
"""`amplifier`: the vertical CiA 402 drive; writes the torque as soon as a command comes."""

from __future__ import annotations

from contextlib import suppress
from operator import attrgetter
from typing import Annotated, NamedTuple

from screw_module_msgs.msg import AmplifierState
from std_srvs.srv import SetBool, Trigger

from screw_module_ros.axes.vertical import VerticalAxis
from screw_module_ros.calibration.file import calibration_identity
from screw_module_ros.calibration.linearization import load_linearization
from screw_module_ros.calibration.module import CalibrationSettings, chosen_calibration
from screw_module_ros.control.gate import GateSettings
from screw_module_ros.control.limits import CommandLimits, TorqueLimits
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.timing import (
    DeadlineMeter,
    empty_histogram,
    note_latency,
)
from screw_module_ros.control.torque_chain import torque_chain
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.errors import DeviceError
from screw_module_ros.geometry import Screw, torque_to_force
from screw_module_ros.settings import Setting

from .support import qos
from .support.driver import DriverNode, RateSettings, device_values
from .support.flat import COMMAND
from .support.module_node import ERROR, OK, WARN, Done, Health
from .support.permission import Permission
from .support.realtime import BREATH_S, Tick
from .support.runtime import main as run_node
from .support.timing_report import broken_contract, latency_values, timing_values

_CLEARED = "cleared; call ~/enable to enable"
_ANSWER = 0.1  # periods that the drive has to answer SYNC before the command is waited for
_LOOK_S = 0.004  # between looks at safety_state and the missed deadlines


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
        self._load_linearization(own)
        port = self.open_port(f"drive node {settings.node_id}", f"master {settings.master_id}")
        self._screw = self.parameters.read(Screw)
        self._drive = Drive(port, settings, "vertical drive", per_turn=self._screw.lead)
        self._drive.configure()
        self.hardware_id = self._drive.identity
        for warning in self._drive.warnings:
            self.get_logger().warning(warning)
        self.check_bus_load(self._drive.traffic)
        self.get_logger().info(f"linearization: {self._calibration}")
        self._state_period_ns = round(1e9 / own.state_rate)
        self._missed_limit = own.missed_limit
        inbox = self.new_inbox()
        self._take_command = inbox.subscribe(
            COMMAND, "screw/force_command", qos.COMMAND, wakes=True
        )
        self._permission = Permission(self, inbox, attrgetter("vertical_permitted"))
        self._publish = self.outlet(AmplifierState, "screw/amplifier_state", qos.STATE)

    def _load_linearization(self, own: AmplifierSettings) -> None:
        path, settings = own.linearization_file, self.parameters.read(CalibrationSettings)
        module = chosen_calibration(settings, "linearization_file", path)
        if not own.linearize:
            self._linearization, self._calibration = None, "none"
        elif module is not None:
            self._linearization = module.linearization
            self._calibration = module.identity(settings.calibration_file)
        else:
            self._linearization = load_linearization(path) if path else default_linearization()
            self._calibration = calibration_identity(path) if path else "thesis 4.1.1"

    def begin(self) -> None:
        """Start the drive, disabled."""
        self._axis = VerticalAxis(
            self._drive,
            self.period_ns,
            self.parameters.read(GateSettings, "gate"),
            torque_chain(
                self.parameters.read(CommandLimits),
                self.parameters.read(TorqueLimits, "torque"),
                self._linearization,
                self._screw,
                self._drive.settings.rated_torque,
            ),
        )
        self._meter = DeadlineMeter(self.period_ns)
        self._own = empty_histogram()
        self._state.success_rate = self._meter.success_rate
        self._force = 0.0
        self._look_every = max(1, round(_LOOK_S * 1e9 / self.period_ns))
        self._pumped_ns = 0
        self._state_due_ns = 0
        self._drive.start()
        self.start_clock()

    def end(self) -> None:
        """Torque off and a clean exit, so that the next start does not begin in fault."""
        self.stop_clock()
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
        """Wait for a command or the tick and do what is due."""
        due_ns = self.ticker.due_ns()
        self.listen(due_ns)
        if self.clock.now_ns() >= due_ns:
            tick = self.ticker.take()
            self.begin_tick(tick)
            self._await_drive(tick.monotonic_ns)
            self.end_tick(tick)

    def _await_drive(self, since_ns: int) -> None:
        """Give the drive a moment to answer SYNC: the command is then judged by its state of now."""
        until_ns = since_ns + round(_ANSWER * self.period_ns)
        with suppress(DeviceError):
            while self.clock.now_ns() < until_ns:
                reading = self._drive.reading
                if reading is not None and reading.monotonic_ns >= since_ns:
                    return
                self._pump(since_ns, until_ns)

    def listen(self, until_ns: int) -> None:
        """Wait for a command on the topic until `until_ns` and act upon it."""
        self._inbox.wait(until_ns)
        command, now = self._take_command(), self.clock.now_ns()
        if command is not None:
            self.act(command.sequence, command.monotonic_ns, command.force, now)
        elif now < until_ns:
            self.clock.sleep_until(min(until_ns, now + round(BREATH_S * 1e9)))

    def act(self, sequence: int, monotonic_ns: int, force: float, now: int) -> None:
        """Turn a command [N] into torque at once.

        sequence, monotonic_ns: of the sample behind it; now: when its cause was in hand [ns].
        """
        # Torque first: the status read last time is one period old, ten are allowed.
        self._force = force
        with suppress(DeviceError):  # latched by the driver, shown by state and diagnostics
            if self._axis.command(sequence, monotonic_ns, force, now):
                done = self.clock.now_ns()
                self._meter.tick(sequence, monotonic_ns, done)
                note_latency(self._own, done - now)
            self._pump(now)

    def _pump(self, now: int, until_ns: int = 0) -> None:
        self._pumped_ns = now
        self.port.pump(until_ns)

    def begin_tick(self, tick: Tick) -> None:
        """Send what goes out on the tick: SYNC and, when due, the heartbeat."""
        self.skipped += tick.skipped
        with suppress(DeviceError):
            self._drive.sync(tick.monotonic_ns)
            self._drive.heartbeat(tick.monotonic_ns)

    def end_tick(self, tick: Tick) -> AmplifierState | None:
        """Look after gate, drive and state; return the state when one was published."""
        now = tick.monotonic_ns
        if tick.sequence % self._look_every == 0:
            self._look_around(now)
        with suppress(DeviceError):
            if now - self._pumped_ns > self.period_ns:
                self._pump(now)  # no command came that would have done it
        with suppress(DeviceError):
            self._axis.idle(now)
        if now < self._state_due_ns:
            return None
        self._state_due_ns = (now // self._state_period_ns + 1) * self._state_period_ns
        self._publish_state(now)
        return self._state

    def _look_around(self, now: int) -> None:
        drives = self._axis.drives
        self._permission.pass_on(drives, now)
        drives.missed(self._meter.missed_in_a_row(now), self._missed_limit)

    def _publish_state(self, now: int) -> None:
        message, drives, meter, drive = self._state, self._axis.drives, self._meter, self._drive
        reading, written = drive.reading, self._axis.last
        self.stamp(message.header)
        message.state = int(drive.state(now))
        message.statusword = reading.statusword if reading else 0
        message.error_code = drive.error_code
        message.enabled = drives.enabled
        message.faulted = drives.faulted
        message.reason = drives.reason
        message.commanded_force = self._force
        message.commanded_torque = written.torque
        message.measured_torque = reading.torque if reading else 0.0
        message.position = reading.position if reading else 0.0
        message.rate = meter.rate(now)
        message.latency_p50, message.latency_p99 = meter.latency(0.5), meter.latency(0.99)
        message.commands, message.late, message.lost = meter.samples, meter.late, meter.lost
        message.consecutive_missed = meter.missed_in_a_row(now)
        message.success_rate = meter.success_rate
        message.saturated = written.saturated
        message.calibration = self._calibration
        self._publish(message)

    # Services ------------------------------------------------------------------------------

    def _enable(self, request: SetBool.Request) -> str:
        drives = self._axis.drives
        if not request.data:
            return drives.disable(self.clock) or Done("disabled")
        publishers = self._inbox.publishers("screw/force_command")
        if publishers > 1:
            return f"{publishers} nodes publish screw/force_command: one is allowed"
        return drives.enable(self.clock) or Done("enabled")

    def _clear_fault(self, request: Trigger.Request) -> str:
        return self._axis.drives.clear_fault(self.clock)

    def health(self) -> Health:
        """State of the drive, timing, counters."""
        told, meter, drives = self._state, self._meter, self._axis.drives
        peak = torque_to_force(self.parameters.read(TorqueLimits, "torque").peak, self._screw)
        values = {
            **timing_values(told, meter),
            **latency_values("own", self._own),
            "state": self._drive.state(self.clock.now_ns()).text,
            "largest force [N]": f"{peak:.0f}",
            "calibration": self._calibration,
            **device_values(self._drive.snapshot()),
            **self.port_values(),
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
