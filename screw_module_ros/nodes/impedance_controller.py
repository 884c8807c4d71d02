# SPDX-License-Identifier: Apache-2.0
"""`impedance_controller`: the vertical law, once per encoder sample with the newest force sample.

Every number it computes comes from `control/`; here the samples come in and the command goes out.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from screw_module_msgs.msg import (
    AmplifierState,
    EndpointSetpoint,
    ForceCommand,
    ImpedanceState,
    SafetyState,
)
from screw_module_msgs.srv import SetControlMode, SetImpedance

from screw_module_ros.calibration.file import calibration_identity
from screw_module_ros.calibration.friction import load_friction_model
from screw_module_ros.calibration.module import (
    CalibrationSettings,
    ModuleCalibration,
    chosen_calibration,
)
from screw_module_ros.control.agreement import AgreementSettings
from screw_module_ros.control.modes import MODE_NAMES
from screw_module_ros.control.vertical import VerticalOutput
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.control.watch import WatchSettings
from screw_module_ros.loop.controller import NO_FORCE, VerticalController
from screw_module_ros.loop.ticker import period_of
from screw_module_ros.loop.vertical import Parts, VerticalLoop, Wires
from screw_module_ros.loop.wanted import Wanted
from screw_module_ros.resources import resource_path
from screw_module_ros.samples import EncoderReading, ForceReading
from screw_module_ros.settings import Setting

from .support import qos
from .support.driver import RateSettings
from .support.due import Due
from .support.flat import ENCODER, FORCE, pack_command
from .support.freshness import Newest
from .support.module_node import ERROR, OK, WARN, Health, ModuleNode
from .support.realtime import Inbox
from .support.runtime import main as run_node
from .support.states import fill_controller
from .support.timing_report import broken_contract, timing_values

FRICTION_FILE = "params/friction_thesis.yaml"
_SAFETY_AGE_NS = 200_000_000


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
        self.part: VerticalController | None = None
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
        self._wanted = Wanted(axes=1)
        inbox = self.new_inbox()
        self._forces = Inbox(self, self.clock, self.direct)
        self._take_encoder = inbox.subscribe(ENCODER, "screw/encoder", qos.SAMPLE, wakes=True)
        self._take_force = self._forces.subscribe(FORCE, "handle/force", qos.SAMPLE, wakes=True)
        self._take_setpoint = inbox.subscribe(EndpointSetpoint, "setpoint", qos.COMMAND)
        self._take_amplifier = inbox.subscribe(
            AmplifierState, "screw/amplifier_state", qos.NEWEST
        )
        take_safety = inbox.subscribe(SafetyState, "safety_state", qos.COMMAND)
        self._safety = Newest(take_safety, _SAFETY_AGE_NS)
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
        chosen = self.parameters.read(ControllerSettings)
        self.part = VerticalController(
            self.parameters.read(VerticalSettings).validated(),
            self._friction,
            self.parameters.read(WatchSettings, "watch"),
            self.parameters.read(AgreementSettings, "agreement"),
            self._period_ns,
            chosen.mode,
        )
        self.part.wanted = self._wanted
        self._state_message.success_rate = self.part.meter.success_rate
        self._state_due = Due(chosen.state_rate)
        self._resets: int | None = None
        wires = Wires(
            take_sample=self._next_sample,
            take_force=self._next_force,
            command=self.tell,
            hear=self.hear,
            controller_state=self.tell_state,
        )
        self._loop = VerticalLoop(self.clock, self._period_ns, wires)

    def end(self) -> None:
        """Send one last zero, so that nobody goes on with the last force."""
        if self._inbox is not None and self.part is not None and self.part.answered is not None:
            self.tell(self.part.answered, NO_FORCE, self.part.mode)

    def disconnect(self) -> None:
        """Remove the topics."""
        if self._inbox is not None:
            self._forces.close()

    def changed(self, kind: type) -> None:
        """Take over live parameters; the law fades them in."""
        if kind is VerticalSettings:
            self._follow_gravity()
        if self.part is None:
            return
        if kind is VerticalSettings:
            self.part.settings = self.parameters.read(VerticalSettings)
        elif kind is ControllerSettings:
            self.part.mode = self.parameters.read(ControllerSettings).mode

    # Hot loop ------------------------------------------------------------------------------

    def step(self) -> None:
        """Wait for an encoder sample and answer it with a command."""
        self._loop.step(Parts(controller=self.part))

    def _next_sample(self, until_ns: int) -> EncoderReading | None:
        self._inbox.wait(until_ns)
        return self._take_encoder()

    def _next_force(self, until_ns: int) -> ForceReading | None:
        if until_ns:
            self._forces.wait(until_ns)
        return self._take_force()

    def tell(self, sample: EncoderReading, output: VerticalOutput, mode: int) -> None:
        """Publish the answer to a sample."""
        self._publish(pack_command(sample, output, mode))

    def hear(self, now_ns: int) -> None:
        """Take set point and amplifier state, where they come by a topic."""
        wanted = self._take_setpoint()
        if wanted is not None:
            self._wanted.ask((wanted.position.z,), (wanted.velocity.z,), now_ns)
        state = self._take_amplifier()
        if state is not None:
            self.part.on_drive(state.enabled, state.position, now_ns)

    def tell_state(self, now_ns: int) -> None:
        """Follow the supervisor and publish the state, when it is due."""
        if self._state_due(now_ns):
            self._follow_supervisor(now_ns)
            self.stamp(self._state_message.header)
            fill_controller(self._state_message, self.part, now_ns)
            self._state_message.calibration = self._calibration
            self._publish_state(self._state_message)

    def _follow_supervisor(self, now_ns: int) -> None:
        """A reset there clears a fault here; one that was started anew counts from 0 again."""
        safety = self._safety.fresh(now_ns)
        if safety is None:
            return
        if self._resets is not None and safety.resets > self._resets:
            self.part.reset(now_ns)
        self._resets = safety.resets

    # Services ------------------------------------------------------------------------------

    def _set_impedance(self, request: SetImpedance.Request) -> str:
        return self.parameters.write(stiffness=request.stiffness, damping=request.damping)

    def _set_mode(self, request: SetControlMode.Request) -> str:
        return self.parameters.write(mode=request.mode)

    def health(self) -> Health:
        """Reason of a zero force, timing."""
        told, controller = self._state_message, self.part
        values = {
            **timing_values(told, controller.meter),
            "age [s]": self._age_text(self.clock.now_ns()),
            "mode": MODE_NAMES[controller.mode],
            "calibration": self._calibration,
        }
        if controller.reason:
            return Health(ERROR if controller.faulted else WARN, controller.reason, values)
        if warning := broken_contract(told):
            return Health(WARN, warning, values)
        return Health(OK, f"running in {MODE_NAMES[controller.mode]}", values)

    def _age_text(self, now_ns: int) -> str:
        sample = self.part.answered
        return "never" if sample is None else f"{(now_ns - sample.monotonic_ns) * 1e-9:.4f}"


def main() -> int:
    """Console entry point."""
    return run_node(ImpedanceControllerNode)


if __name__ == "__main__":
    raise SystemExit(main())
