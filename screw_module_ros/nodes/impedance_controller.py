# SPDX-License-Identifier: Apache-2.0
"""`impedance_controller`: the vertical law, once per encoder sample with the newest force sample.

Every number it computes comes from `control/`; here the samples come in and the command goes out.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from screw_module_msgs.msg import (
    AmplifierState,
    EndpointSetpoint,
    ForceCommand,
    ImpedanceState,
    SafetyState,
)
from screw_module_msgs.srv import SetControlMode, SetImpedance

from screw_module_ros.axes.controller import NO_FORCE, VerticalController
from screw_module_ros.calibration.file import calibration_identity
from screw_module_ros.calibration.friction import load_friction_model
from screw_module_ros.calibration.module import (
    CalibrationSettings,
    ModuleCalibration,
    chosen_calibration,
)
from screw_module_ros.control.agreement import AgreementSettings
from screw_module_ros.control.modes import MODE_NAMES, OFF
from screw_module_ros.control.timing import DeadlineMeter
from screw_module_ros.control.vertical import VerticalOutput
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.control.watch import WatchSettings
from screw_module_ros.resources import resource_path
from screw_module_ros.samples import EncoderReading, ForceReading
from screw_module_ros.settings import Setting

from .support import qos
from .support.driver import RateSettings, period_of
from .support.flat import ENCODER, FORCE, pack_command
from .support.freshness import MOVING_SETPOINT_NS, Newest
from .support.module_node import ERROR, OK, WARN, Health, ModuleNode
from .support.pace import Pace
from .support.realtime import BREATH_S, Inbox
from .support.runtime import main as run_node
from .support.timing_report import broken_contract, timing_values

FRICTION_FILE = "params/friction_thesis.yaml"
_AMPLIFIER_AGE_NS = 200_000_000


class ControllerSettings(NamedTuple):
    """What the node starts with."""

    mode: Annotated[
        int, Setting("control mode: 0 OFF, 1 IMPEDANCE, 2 FRICTION_COMPENSATION, "
                     "3 FORCE_FEEDBACK, 4 COMBINED", choices=tuple(MODE_NAMES), live=True)
    ] = 1
    friction_file: Annotated[
        str, Setting("friction model file, empty for the thesis's polynomials or when "
                     "calibration_file is set")
    ] = ""
    state_rate: Annotated[
        float, Setting("screw/controller_state messages per second", "Hz", 1.0, 500.0)
    ] = 100.0


class ImpedanceControllerNode(ModuleNode):
    """Encoder sample in, force command out; a latched watch holds the force at zero."""

    def __init__(self):
        super().__init__("impedance_controller")
        self.parameters.declare(ControllerSettings)
        self.parameters.declare(CalibrationSettings)
        self.parameters.declare(RateSettings)
        self.parameters.declare(VerticalSettings)
        self.parameters.declare(WatchSettings, "watch")
        self.parameters.declare(AgreementSettings, "agreement")
        self._state_message = ImpedanceState()
        self._state_message.header.frame_id = "manus_base"
        self._module: ModuleCalibration | None = None
        self._calibration = ""
        self.serve(SetImpedance, "~/set_impedance", self._set_impedance, always=True)
        self.serve(SetControlMode, "~/set_mode", self._set_mode, always=True)

    # Lifecycle -----------------------------------------------------------------------------

    def connect(self) -> None:
        """Load the calibration or friction model and make the topics."""
        chosen = self.parameters.read(ControllerSettings)
        self.parameters.read(VerticalSettings).validated()
        self._period_ns = period_of(self.parameters.read(RateSettings).rate)
        self._load(chosen.friction_file)
        self._state_period_ns = round(1e9 / chosen.state_rate)
        inbox = self.new_inbox()
        self._take_encoder = inbox.subscribe(
            ENCODER, "screw/encoder", qos.SAMPLE, wakes=True
        )
        self._forces = Inbox(self, self.clock, self.direct)
        self._take_force = self._forces.subscribe(
            FORCE, "handle/force", qos.SAMPLE, wakes=True
        )
        take = inbox.subscribe
        self._setpoint = Newest(take(EndpointSetpoint, "setpoint", qos.COMMAND), MOVING_SETPOINT_NS)
        self._amplifier = Newest(
            take(AmplifierState, "screw/amplifier_state", qos.NEWEST), _AMPLIFIER_AGE_NS
        )
        self._safety = Newest(take(SafetyState, "safety_state", qos.COMMAND), _AMPLIFIER_AGE_NS)
        self._publish = self.outlet(ForceCommand, "screw/force_command", qos.COMMAND, raw=True)
        self._publish_state = self.outlet(ImpedanceState, "screw/controller_state", qos.STATE)

    def _load(self, friction_file: str) -> None:
        settings = self.parameters.read(CalibrationSettings)
        self._module = chosen_calibration(settings, "friction_file", friction_file)
        if self._module is None:
            path = friction_file or resource_path(FRICTION_FILE)
            self._friction = load_friction_model(path)
            self._calibration = calibration_identity(path)
            return
        self._friction = self._module.friction
        self._file_identity = self._module.identity(settings.calibration_file)
        before = self.parameters.read(VerticalSettings).gravity
        refused = self.parameters.write(gravity=self._module.gravity)
        if refused:
            raise ValueError(f"{settings.calibration_file}: gravity_N: {refused}")
        self._follow_gravity()
        self.get_logger().info(
            f"calibration {self._file_identity}: gravity set to {self._module.gravity:g} N "
            f"(the parameter was {before:g} N)"
        )

    def _follow_gravity(self) -> None:
        """Say in the identity when the calibration's gravity was replaced by hand."""
        if self._module is None:
            return
        gravity = self.parameters.read(VerticalSettings).gravity
        by_hand = "" if gravity == self._module.gravity else f", gravity {gravity:g} N by hand"
        self._calibration = self._file_identity + by_hand

    def begin(self) -> None:
        """Start from nothing: zero force, set point at the measured position."""
        self._controller = VerticalController(
            self.parameters.read(VerticalSettings).validated(),
            self._friction,
            self.parameters.read(WatchSettings, "watch"),
            self.parameters.read(AgreementSettings, "agreement"),
            self._period_ns,
            self.parameters.read(ControllerSettings).mode,
        )
        self._meter = DeadlineMeter(self._period_ns)
        self._state_message.success_rate = self._meter.success_rate
        self._force_pace = Pace(self._period_ns)
        self._encoder: EncoderReading | None = None
        self._resets: int | None = None
        self._state_due_ns = 0

    def end(self) -> None:
        """Send one last zero, so that nobody goes on with the last force."""
        if self._inbox is not None and self._encoder is not None:
            self.tell(NO_FORCE)

    def disconnect(self) -> None:
        """Remove the topics."""
        if self._inbox is not None:
            self._forces.close()

    def changed(self, kind: type) -> None:
        """Take over live parameters; the law fades them in."""
        if kind is VerticalSettings:
            self._follow_gravity()
        if not hasattr(self, "_controller"):
            return
        if kind is VerticalSettings:
            self._controller.settings = self.parameters.read(VerticalSettings)
        elif kind is ControllerSettings:
            self._controller.mode = self.parameters.read(ControllerSettings).mode

    # Hot loop ------------------------------------------------------------------------------

    def step(self) -> None:
        """Wait for an encoder sample and answer it with a command."""
        self._inbox.wait(self.clock.now_ns() + 2 * self._period_ns)
        sample = self._take_encoder()
        force = self._force_of(sample)
        now = self.clock.now_ns()
        if force is not None:
            self.feel(force, now)
        output = self.respond(sample, now) if sample is not None else None
        if output is not None:
            self.tell(output)
            self.count()
        elif (zero := self.idle(now)) is not None:
            self.tell(zero)
        if sample is None and force is None:
            self.clock.sleep(BREATH_S)
        self._hear_amplifier(now)
        self.follow(now)

    def _force_of(self, sample: EncoderReading | None) -> ForceReading | None:
        """Return the newest force sample; that of the encoder sample's tick is waited for a moment."""
        force = self._take_force()
        if sample is None or (force is not None and force.sequence == sample.sequence):
            return force
        if not self._force_pace.worth_waiting():
            return force
        self._forces.wait(self.clock.now_ns() + self._force_pace.wait_ns)
        newer = self._take_force()
        self._force_pace.came(newer is not None)
        return newer or force

    def feel(self, force: ForceReading, now: int) -> None:
        """Take a force sample."""
        self._controller.force(force, now)

    def respond(self, sample: EncoderReading, now: int) -> VerticalOutput | None:
        """Return the force for an encoder sample, None when it is not to be acted upon."""
        wanted = self._setpoint.message
        setpoint = (math.nan, 0.0)
        if wanted is not None:
            moving = not self._setpoint.stale(now)
            setpoint = (wanted.position.z, wanted.velocity.z if moving else 0.0)
        output = self._controller.act(sample, setpoint, now)
        if output is not None:
            self._encoder = sample
        return output

    @property
    def answered(self) -> EncoderReading | None:
        """The newest sample that was acted upon, None before the first."""
        return self._encoder

    def count(self) -> None:
        """Count the newest sample as answered now."""
        sample = self._encoder
        self._meter.tick(sample.sequence, sample.monotonic_ns, self.clock.now_ns())

    def idle(self, now: int) -> VerticalOutput | None:
        """Return the zero to send when no sample came that can be acted upon, None when not due."""
        return self._controller.idle(now)

    def tell(self, output: VerticalOutput) -> None:
        """Publish the answer to the newest sample."""
        self._publish(pack_command(self._encoder, output, self._controller.mode))

    def _hear_amplifier(self, now: int) -> None:
        state = self._amplifier.update(now)
        if state is not None:
            self._controller.amplifier(state.enabled, state.position, now)

    def hear_amplifier(self, state: AmplifierState, now: int) -> None:
        """Take the amplifier's state as if it had come by the topic."""
        self._amplifier.put(state, now)
        self._controller.amplifier(state.enabled, state.position, now)

    def follow(self, now: int) -> None:
        """Follow set point, amplifier and supervisor; publish the state when due."""
        self._setpoint.update(now)  # here, where no command waits for it
        if self._amplifier.stale(now):
            self._controller.amplifier(None, math.nan, now)
        if now >= self._state_due_ns:
            self._state_due_ns = (now // self._state_period_ns + 1) * self._state_period_ns
            self._follow_supervisor(now)
            self._show_state(now)

    def _follow_supervisor(self, now: int) -> None:
        """A reset there clears a fault here; one that was started anew counts from 0 again."""
        safety = self._safety.fresh(now)
        if safety is None:
            return
        if self._resets is not None and safety.resets > self._resets:
            self._controller.reset(now)
        self._resets = safety.resets

    def _show_state(self, now: int) -> None:
        message, meter, controller = self._state_message, self._meter, self._controller
        output = controller.output
        self.stamp(message.header)
        message.mode = controller.mode
        message.faulted = controller.faulted
        message.reason = controller.reason
        message.active = not controller.reason and controller.mode != OFF
        if self._encoder is not None:
            message.position = self._encoder.position
            message.velocity = self._encoder.velocity
        message.desired_position = output.desired_position
        message.desired_velocity = output.desired_velocity
        blend = controller.state.blend
        message.stiffness, message.damping = blend.stiffness, blend.damping
        message.force_gain = blend.gain
        message.measured_force = controller.handle_force
        message.commanded_force = output.force
        message.rate = meter.rate(now)
        message.latency_p50, message.latency_p99 = meter.latency(0.5), meter.latency(0.99)
        message.samples, message.late, message.lost = meter.samples, meter.late, meter.lost
        message.consecutive_missed = meter.missed_in_a_row(now)
        message.success_rate = meter.success_rate
        message.calibration = self._calibration
        self._publish_state(message)

    # Services ------------------------------------------------------------------------------

    def _set_impedance(self, request: SetImpedance.Request) -> str:
        return self.parameters.write(stiffness=request.stiffness, damping=request.damping)

    def _set_mode(self, request: SetControlMode.Request) -> str:
        return self.parameters.write(mode=request.mode)

    def health(self) -> Health:
        """Reason of a zero force, timing."""
        told, controller = self._state_message, self._controller
        values = {
            **timing_values(told, self._meter),
            "age [s]": self._age_text(self.clock.now_ns()),
            "mode": MODE_NAMES[controller.mode],
            "calibration": self._calibration,
        }
        if controller.reason:
            return Health(ERROR if controller.faulted else WARN, controller.reason, values)
        if warning := broken_contract(told):
            return Health(WARN, warning, values)
        return Health(OK, f"running in {MODE_NAMES[controller.mode]}", values)

    def _age_text(self, now: int) -> str:
        if self._encoder is None:
            return "never"
        return f"{(now - self._encoder.monotonic_ns) * 1e-9:.4f}"


def main() -> int:
    """Console entry point."""
    return run_node(ImpedanceControllerNode)


if __name__ == "__main__":
    raise SystemExit(main())
