# SPDX-License-Identifier: Apache-2.0
"""`impedance_controller`: the vertical law, once per encoder sample with the newest force sample.

`control/` computes the force; this node receives the samples and publishes the command.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Annotated, Any, NamedTuple

from screw_module_msgs.msg import (
    AmplifierState,
    EndpointSetpoint,
    ExcitationRequest,
    ImpedanceState,
)
from screw_module_msgs.srv import SetControlMode, SetImpedance

from screw_module_ros import graph
from screw_module_ros.calibration.gain_limits import GainLimits
from screw_module_ros.calibration.limits_file import GainLimitsSettings
from screw_module_ros.calibration.selection import (
    CalibrationSettings,
    chosen_friction,
    chosen_gain_limits,
)
from screw_module_ros.calibration.version import law_version
from screw_module_ros.control.excitation import Excitation, from_numbers
from screw_module_ros.control.gain_guard import guarded
from screw_module_ros.control.law import Law
from screw_module_ros.control.laws import (
    FIRST,
    GROUP,
    LAST,
    LAWS,
    all_names,
    law_of,
    loaded,
    parameter_of,
    refusal,
)
from screw_module_ros.control.modes import EXCITATION, OFF
from screw_module_ros.control.slot import SlotLimits
from screw_module_ros.control.support import SupportSettings
from screw_module_ros.control.vertical import VerticalOutput
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.loop.controller import NO_FORCE, VerticalController
from screw_module_ros.loop.ticker import period_of
from screw_module_ros.loop.vertical import Roles, VerticalLoop, Wires
from screw_module_ros.safety.checks import AgreementSettings, WatchSettings
from screw_module_ros.samples import EncoderReading, ForceReading
from screw_module_ros.settings import Setting

from .support.answering import Done
from .support.driver import RateSettings
from .support.inbox import Inbox
from .support.law_inputs import SlotInbox, set_impedance
from .support.node import Node
from .support.states import (
    ERROR,
    OK,
    WARN,
    Due,
    Health,
    at_base,
    broken_contract,
    fill_latencies,
    timing_values,
)
from .support.topics import Newest, offered, requested
from .support.wire import pack_command

_MODES = ", ".join(f"{mode} {name}" for mode, name in all_names().items())
_SAFETY_AGE_NS = 200_000_000
_LOOK_NS = 10_000_000  # time between looks at the supervisor's resets, which come at 50 Hz
_WITHOUT_LIMITS = (
    "this mode feeds the handle's force back, and the module has no gain limits of its own: "
    "set beyond_gain_limits on your own word, as it must be for the trials that write them too"
)
_NOT_JUDGED = (
    "mode {mode} is law {law}'s, of which no gain limits are known: set beyond_gain_limits on your "
    "own word, with nobody strapped in at first"
)
_NO_LEASE = (
    "mode EXCITATION is a trial's, whose sender repeats its ExcitationRequest while the torque is "
    "off: run an experiment of `characterize`"
)
_NOT_NOW = "mode EXCITATION does not begin or end while the torque is on: disable it first"
_PUT_BACK_S = 0.1
_ONE_SENDER = (graph.ENCODER, graph.FORCE, graph.AMPLIFIER_STATE)


class ControllerSettings(NamedTuple):
    """Settings of the node beside those of the law."""

    mode: Annotated[
        int, Setting(f"control mode: {_MODES} (trials only), {FIRST} to {LAST} laws of others",
                     "", OFF, LAST, live=True)
    ] = 1
    laws: Annotated[
        tuple[str, ...], Setting("laws of other packages, each as package.module:NAME or by its "
                                 f"entry point of {GROUP}", at_start=True)
    ] = ("",)
    friction_file: Annotated[
        str, Setting("friction model file, empty for the thesis's polynomials or when "
                     "calibration_file is set")
    ] = ""
    state_rate: Annotated[
        float, Setting(f"{graph.CONTROLLER_STATE} messages per second", "Hz", 1.0, 500.0)
    ] = graph.TOPICS[graph.CONTROLLER_STATE].rate


class Inputs(NamedTuple):
    """What the node hears, each a call that returns the next message, None without one.

    samples, forces: the inboxes that wait for encoder and force samples.
    """

    samples: Inbox
    forces: Inbox
    sample: Callable[[], EncoderReading | None]
    force: Callable[[], ForceReading | None]
    setpoint: Callable[[], EndpointSetpoint | None]
    excitation: Callable[[], ExcitationRequest | None]
    amplifier: Callable[[], AmplifierState | None]
    slot: SlotInbox
    safety: Newest


class ImpedanceControllerNode(Node):
    """Encoder sample in, force command out; zero force while the watch has a latched fault.

    inputs: from `connect` on. role: from the first `begin` on. state: the newest message.
    """

    inputs: Inputs
    role: VerticalController

    def __init__(self) -> None:
        super().__init__("impedance_controller")
        self.parameters.declare(
            ControllerSettings, CalibrationSettings, GainLimitsSettings, RateSettings,
            VerticalSettings, watch=WatchSettings, agreement=AgreementSettings, slot=SlotLimits,
            support=SupportSettings,
        )  # fmt: skip
        self._laws = loaded(self.parameters.read(ControllerSettings).laws)
        self._foreign = self._laws[len(LAWS) :]
        self._apart = [law for law in self._laws if law.settings is not VerticalSettings]
        self._names = all_names(self._laws)
        self._versions = {law.name: f"{law.name} {law_version(law)}" for law in self._laws}
        for law in self._apart:
            self.parameters.declare_law(law.name, law.settings)
        self.state = at_base(ImpedanceState)
        self._replaced: dict[str, tuple[float, float]] = {}  # by a calibration: before, after
        self._limits: GainLimits | None = None
        self._activations = 0
        self._latency = 0.0  # to the drive, of the last second [s]; 0 = not told
        self._before_trial: dict[str, Any] = {}  # settings and mode, while a trial has the lease
        self.periodic.every(self.clock, _PUT_BACK_S, self._end_lease)
        impedance = partial(set_impedance, self.parameters, VerticalSettings)
        self.serve(SetImpedance, "~/set_impedance", impedance, always=True)
        self.serve(SetControlMode, "~/set_mode", self._set_mode, always=True)

    # Lifecycle -----------------------------------------------------------------------------

    def connect(self) -> None:
        """Load gain limits and calibration or friction model, and make the topics."""
        self._leave_calibration()
        chosen = self.parameters.read(ControllerSettings)
        self._limits = chosen_gain_limits(
            self.parameters.read(GainLimitsSettings),
            self.parameters.read(CalibrationSettings).module_serial,
        )
        self._period_ns = period_of(self.parameters.read(RateSettings).rate)
        self._load(chosen)
        self._subscribe()
        self._senders = self.senders(*(topic for topic in _ONE_SENDER if topic not in self.direct))
        self._pullers = self.senders(graph.SETPOINT)
        self._publish = self.outlet(*offered(graph.FORCE_COMMAND), raw=True)
        self._publish_state = self.outlet(*offered(graph.CONTROLLER_STATE))

    def _subscribe(self) -> None:
        samples, forces = self.new_inbox(), self.new_inbox()
        take = samples.subscribe
        self.inputs = Inputs(
            samples,
            forces,
            sample=take(*requested(graph.ENCODER), wakes=True),
            force=forces.subscribe(*requested(graph.FORCE), wakes=True),
            setpoint=take(*requested(graph.SETPOINT)),
            excitation=take(*requested(graph.EXCITATION)),
            amplifier=take(*requested(graph.AMPLIFIER_STATE)),
            slot=SlotInbox(samples, vertical=True),
            safety=Newest(take(*requested(graph.SAFETY_STATE)), _SAFETY_AGE_NS),
        )

    def _load(self, own: ControllerSettings) -> None:
        settings = self.parameters.read(CalibrationSettings)
        chosen = self._friction = chosen_friction(settings, own.friction_file)
        law = known = self.parameters.read(VerticalSettings).validated()
        if chosen.gravity is not None:
            known = law.calibrated(chosen.gravity, chosen.mass, chosen.delay)
        values: dict[str, Any] = {}
        if self._limits and not self.parameters.read(GainLimitsSettings).beyond_gain_limits:
            known, values = self._limited(self._limits, known)
        if refused := self._problem(known, own.mode, values):
            raise ValueError(refused)
        values |= {name: new for name, new in known._asdict().items() if new != getattr(law, name)}
        before = {name: self.get_parameter(name).value for name in values}
        if refused := self.parameters.write(**values):
            raise ValueError(f"the module's calibration and gain limits: {refused}")
        self._replaced = {name: (before[name], new) for name, new in values.items()}
        for name, (was, now) in self._replaced.items():
            self.get_logger().info(f"this module's {name}: {now:g} (the parameter was {was:g})")
        self._name_calibration()
        for law in self._laws:
            self._tell_limits(law, known)

    def _limited(
        self, limits: GainLimits, known: VerticalSettings
    ) -> tuple[VerticalSettings, dict[str, Any]]:
        """Return the settings, and other laws' parameters, with gains within the limits."""
        values: dict[str, Any] = {}
        for law in self._laws:
            if law in self._apart:
                own = self._settings_of(law)
                within = limits.chosen(law, own)._asdict().items()
                values |= {
                    parameter_of(law, n): new for n, new in within if new != getattr(own, n)
                }
            else:
                known = limits.chosen(law, known)
        return known, values

    def _tell_limits(self, law: Law, known: VerticalSettings) -> None:
        """Log what a law's gains are worth in the model from which their limits come."""
        limits, log = self._limits, self.get_logger()
        if law in self._foreign and not law.judged:
            log.warning(
                f"law {self._versions[law.name]}: no linear model judges its gains, so no limits "
                "of them are known: it is on your word that it runs"
            )
        elif limits and (refused := limits.feedback_refusal(law)):
            log.warning(refused)
        elif limits and (exceeded := limits.exceeded(law, self._own(law, known))):
            log.warning(
                f"gain limits are those of a linear model, in which these gains are unstable on "
                f"some loads (largest stable gain): {exceeded}; there the guard ends what grows"
            )

    def _leave_calibration(self) -> None:
        """Undo what the last module's calibration set, unless somebody has changed it since."""
        replaced, self._replaced = self._replaced, {}
        back = {
            name: old for name, (old, new) in replaced.items()
            if self.get_parameter(name).value == new
        }  # fmt: skip
        if refused := self.parameters.write(**back):
            self._replaced = replaced
            raise ValueError(f"without the last calibration: {refused}")

    def _name_calibration(self) -> None:
        law = self.parameters.read(VerticalSettings)
        self.state.calibration = self._friction.described(law.gravity, law.mass)

    def begin(self) -> None:
        """Start with zero force and the set point at the measured position."""
        chosen = self.parameters.read(ControllerSettings)
        number = self._activations + 1
        self.role = VerticalController(
            self._friction.law(self.parameters.read(VerticalSettings).validated()),
            self._friction.model,
            self.parameters.read(WatchSettings, "watch"),
            self.parameters.read(AgreementSettings, "agreement"),
            self._period_ns,
            chosen.mode,
            self.parameters.read(SlotLimits, "slot"),
            number,
            self._laws,
            {law.name: self._settings_of(law) for law in self._apart},
            self.clock.work_ns,
            self.parameters.read(SupportSettings, "support"),
        )
        self._activations = number  # a new process takes longer than the gate waits for a command
        self._resets: int | None = None  # as the supervisor counts them
        self._look_ns = 0  # when to look at them next
        self.state.success_rate = self.role.meter.success_rate
        self._state_due = Due(chosen.state_rate)
        wires = Wires(
            take_sample=self.next_sample,
            take_force=self.next_force,
            publish_command=self.publish_command,
            read_inputs=self.read_inputs,
            publish_controller_state=self.publish_state,
        )
        self._loop = VerticalLoop(self.clock, self._period_ns, wires)

    def end(self) -> None:
        """Send a last zero, so that the amplifier does not continue with the last force."""
        role = self.role if self._activations else None
        if role and role.answered is not None:
            self.publish_command(role.answered, NO_FORCE, role.mode, role.activation)
        self._put_back()

    def disconnect(self) -> None:
        """No gain limits hold any more."""
        self._limits = None
        super().disconnect()

    def refusal(self, changes: Mapping[str, Any]) -> str:
        """Return why the law cannot run with these parameters, or goes beyond its gain limits.

        Before it is configured there is none: `connect` loads it, and compares the law with it.
        """
        law = self.parameters.read(VerticalSettings, changes=changes)
        mode = self.parameters.read(ControllerSettings, changes=changes).mode
        if mode not in self._names:
            known = ", ".join(f"{number} {name}" for number, name in self._names.items())
            return f"mode = {mode}: one of {known} is wanted; `laws` brings those of others"
        if not self.configured:
            return self._law_refusal(law, mode, changes)
        if self._may_act and mode != self.role.mode and EXCITATION in (mode, self.role.mode):
            return _NOT_NOW
        return self._problem(law, mode, changes)

    def _settings_of(self, law: Law, changes: Mapping[str, Any] = {}) -> Any:
        """Return the settings of a law that has its own."""
        return self.parameters.read(law.settings, law.name, changes)

    def _law_refusal(
        self, settings: VerticalSettings, mode: int, changes: Mapping[str, Any]
    ) -> str:
        """Return why the law of a mode cannot run with its settings."""
        law = law_of(mode, self._laws)
        if law is None:
            return ""
        return refusal(law, self._own(law, settings, changes), mode)

    def _own(
        self, law: Law, settings: VerticalSettings, changes: Mapping[str, Any] = {}
    ) -> Any:
        """Return a law's settings; settings: of the envelope, and of laws without their own."""
        return self._settings_of(law, changes) if law in self._apart else settings

    @property
    def _may_act(self) -> bool:
        return self.active and self.role.may_act

    def fixed(self, kind: type) -> bool:
        """Let a trial, which has a lease, have any law while no torque acts."""
        leased = kind is VerticalSettings and self._before_trial and not self._may_act
        return super().fixed(kind) and not leased

    def _problem(
        self, settings: VerticalSettings, mode: int, changes: Mapping[str, Any] = {}
    ) -> str:
        if mode == EXCITATION and not self._before_trial:
            return _NO_LEASE
        own, limits = self.parameters.read(GainLimitsSettings), self._limits
        law = law_of(mode, self._laws)
        if law is None or own.beyond_gain_limits:
            return self._law_refusal(settings, mode, changes)
        gains = law.variants[mode].gains
        if own.gain_limits_required:
            if law in self._foreign and not (law.judged and gains):
                return _NOT_JUDGED.format(law=law.name, mode=self._names[mode])
            if gains and limits is None:
                return _WITHOUT_LIMITS
            if gains and limits and (refused := limits.feedback_refusal(law)):
                return f"{refused}, or set beyond_gain_limits on your own word"
        if limits:
            rate = self.parameters.read(RateSettings).rate
            chosen = self._own(law, settings, changes)
            if refused := limits.refusal(law, mode, settings, chosen, rate):
                return refused
        return self._law_refusal(settings, mode, changes)

    def changed(self, kind: type) -> None:
        """Apply live parameters; the law fades them in."""
        if kind is VerticalSettings and self.configured:
            self._name_calibration()
        if kind is VerticalSettings and self.active:
            self.role.settings = self._friction.law(self.parameters.read(VerticalSettings))
        elif kind is ControllerSettings and self.active:
            self.role.mode = self.parameters.read(ControllerSettings).mode
        elif self.active:
            for law in (law for law in self._apart if law.settings is kind):
                self.role.laws.choose(law.name, self._settings_of(law))

    # Hot loop ------------------------------------------------------------------------------

    def step(self) -> None:
        """Wait for an encoder sample and answer it with a command."""
        self._loop.step(Roles(controller=self.role))

    def next_sample(self, until_ns: int) -> EncoderReading | None:
        """Return the newest encoder sample; wait for it until `until_ns` at most."""
        self.inputs.samples.wait(until_ns)
        return self.inputs.sample()

    def next_force(self, until_ns: int) -> ForceReading | None:
        """Return the newest force sample; wait for it until `until_ns` at most, 0 = no wait."""
        if until_ns:
            self.inputs.forces.wait(until_ns)
        return self.inputs.force()

    def publish_command(
        self, sample: EncoderReading, output: VerticalOutput, mode: int, activation: int
    ) -> None:
        """Publish the answer to a sample."""
        self._publish(pack_command(sample, output, mode, activation))

    def read_inputs(self, now_ns: int) -> None:
        """Read set point, slot, amplifier state and resets, if they come by a topic."""
        controller, inputs = self.role, self.inputs
        if slot := inputs.slot.read(controller.guide, now_ns):
            controller.support.ask(slot.support, now_ns)
        wanted = inputs.setpoint()
        if wanted is not None:
            controller.wanted.ask((wanted.position.z,), (wanted.velocity.z,), now_ns)
        request = inputs.excitation()
        if request is not None:
            self._excite(request, now_ns)
        state = inputs.amplifier()
        if state is not None:
            self._latency = state.latency_p50
            controller.on_drive(state.enabled, state.position, now_ns, state.brakes)
        if self._senders.warning:
            controller.set_fault(self._senders.warning)
        if now_ns >= self._look_ns:
            self._look_ns = now_ns + _LOOK_NS
            self._follow_supervisor(now_ns)

    def _excite(self, request: ExcitationRequest, now_ns: int) -> None:
        """Take a trial's request; with the first one, note what is put back at the end."""
        linearization = from_numbers(request.linearization) if request.linearized else None
        wanted = Excitation(
            request.id, request.amplitude, request.frequency, request.ticks, linearization
        )
        controller = self.role
        if refused := wanted.refusal(1e9 / self._period_ns):
            controller.set_fault(f"excitation: {refused}" if controller.lease.held else "")
            return
        begins = not controller.lease.held
        controller.excite(wanted, now_ns)
        if begins and controller.lease.held:
            law = self.parameters.read(VerticalSettings)
            self._before_trial = {**law._asdict(), "mode": controller.mode}

    def _end_lease(self) -> None:
        """Put back what a trial has changed when its lease has lapsed and no torque acts."""
        if self._before_trial and self.role.lease.lapsed and not self._may_act:
            self._put_back()

    def _put_back(self) -> None:
        if not self._before_trial:
            return
        if refused := self.parameters.write(**self._before_trial):
            self.get_logger().error(f"settings before the trial not put back: {refused}")
            return
        self._before_trial = {}
        self.role.lease.end()

    def publish_state(self, now_ns: int) -> None:
        """Publish the state, when it is due."""
        if self._state_due(now_ns):
            self.stamp(self.state.header)
            fill_controller(self.state, self.role, now_ns)
            self.state.law = self._versions[self.role.laws.law.name]
            self._publish_state(self.state)

    def _follow_supervisor(self, now_ns: int) -> None:
        """Clear the fault when the supervisor's count of resets rises; it restarts from 0."""
        safety = self.inputs.safety.fresh(now_ns)
        if safety is None:
            return
        if self._resets is not None and safety.resets > self._resets:
            self.role.reset(now_ns)
        self._resets = safety.resets

    # Services ------------------------------------------------------------------------------

    def _set_mode(self, request: SetControlMode.Request) -> str:
        refused = self.parameters.write(mode=request.mode)
        mode = self.parameters.read(ControllerSettings).mode
        return refused or Done(f"mode {mode}, {self._names[mode]}")

    @property
    def alarm(self) -> str:
        """The controller's latched fault."""
        return self.role.fault.reason

    def health(self) -> Health:
        """Reason of a zero force, timing."""
        state, controller = self.state, self.role
        # By the rig's time a computation takes none, and the rig adds a latency of its own.
        latency = 0.0 if self.clock.simulated else max(self._latency, state.latency_p50)
        slow = self._friction.delay_flaw(latency)
        values = {
            **timing_values(state, controller.meter),
            "age [s]": self._age_text(self.clock.now_ns()),
            "mode": self._names[controller.mode],
            "law": self._versions[controller.laws.law.name],
            "calibration": state.calibration,
            "gain limits": self._limits.identity if self._limits else "none",
            "unstable in the linear model": self._exceeded(),
            "delay off": slow or "no",
            "slot refused": self.inputs.slot.refused or "no",
        }
        if controller.reason:
            return Health(ERROR if self.alarm else WARN, controller.reason, values)
        if controller.output.share < 1.0 and controller.mode != OFF:
            return Health(WARN, guarded(controller.output.share), values)
        if warning := broken_contract(state) or self._pullers.warning or slow:
            return Health(WARN, warning, values)
        return Health(OK, f"running in {self._names[controller.mode]}", values)

    def _exceeded(self) -> str:
        """Return which gains in use are unstable in the limits' model, and on which loads."""
        law, limits = self.role.laws.law, self._limits
        if limits is None or limits.feedback_refusal(law):
            return "not known"
        return limits.exceeded(law, self._own(law, self.role.settings)) or "none"

    def _age_text(self, now_ns: int) -> str:
        sample = self.role.answered
        return "never" if sample is None else f"{(now_ns - sample.monotonic_ns) * 1e-9:.4f}"


def fill_controller(message: ImpedanceState, controller: VerticalController, now_ns: int) -> None:
    """Write the controller's state into its message."""
    output, law = controller.output, controller.laws.state
    message.mode = controller.mode
    message.faulted = controller.faulted
    message.reason = controller.reason
    message.home_in_doubt = controller.home_in_doubt
    message.active = not controller.reason and controller.mode != OFF
    if controller.answered is not None:
        message.position = controller.answered.position
        message.velocity = controller.answered.velocity
    message.desired_position = output.desired_position
    message.desired_velocity = output.desired_velocity
    message.stiffness, message.damping = law.stiffness, law.damping
    message.force_gain = controller.laws.force_gain
    shown = controller.laws.shown
    message.law_names, message.law_values = list(shown), list(shown.values())
    message.gain_share = output.share
    message.measured_force = controller.handle_force
    message.commanded_force = output.force
    support = controller.support.state
    message.support, message.hand_off = support.force, support.hand_off
    message.support_limit = controller.support_limit
    message.samples = controller.meter.samples
    fill_latencies(message, controller.meter, now_ns)
