# SPDX-License-Identifier: Apache-2.0
"""The vertical controller: turns samples into a force, zero while a check rejects them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from ..control.excitation import Excitation, Excited, excitation_step
from ..control.friction import FrictionModel
from ..control.law import Law
from ..control.laws import LAWS
from ..control.modes import EXCITATION, OFF
from ..control.slot import Reach, SlotLimits
from ..control.support import SupportSettings, SupportState, largest_support
from ..control.vertical import VerticalInput, VerticalOutput
from ..control.vertical_settings import VerticalSettings
from ..safety.checks import Agreement, AgreementSettings, VerticalChecks, WatchSettings
from ..safety.latch import Age
from ..safety.timing import DeadlineMeter
from ..samples import EncoderReading, ForceReading
from .inputs import Guide, Lease, SetpointInput
from .law_runner import LawRunner
from .support import Support

_DRIVE_AGE_NS = 200_000_000
_SLOT_LIMITS, _SUPPORT = SlotLimits(), SupportSettings()
_NO_SPRING = (OFF, EXCITATION)
LAPSED = "excitation: its sender has fallen silent, and with it the trial ends"
NO_FORCE = VerticalOutput(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False, math.nan, 0.0)


class VerticalController:
    """Checks and law of the vertical axis; all times are passed in [ns].

    mode, settings: may be replaced at any time; the law fades to the new ones. laws: one of them
    runs, as the mode says. output: of the last step. wanted: the set point, height only. guide: the
    slot, if there is one. support: what carries the patient's arm. fault: what is latched.
    answered: newest sample turned into a command, None before the first. handle_force: newest
    accepted one [N]. meter: latency from a sample to
    its command. reason: why the force is zero, empty if it is not. activation: its number, other
    than those of controllers before. lease: of a trial; where it lapses while torque may act, that
    is a fault. A fault while the amplifier is on or a force is commanded stays latched until
    `reset`; any other fault ends with its cause.
    """

    def __init__(
        self,
        settings: VerticalSettings,
        friction: FrictionModel,
        watch: WatchSettings,
        agreement: AgreementSettings,
        period_ns: int,
        mode: int = OFF,
        slot_limits: SlotLimits = _SLOT_LIMITS,
        activation: int = 0,
        laws: tuple[Law, ...] = LAWS,
        own: Mapping[str, Any] | None = None,
        work_ns: Callable[[], int] | None = None,
        support: SupportSettings = _SUPPORT,
    ):
        """laws: with those of others, own: their settings by the laws' names, work_ns: processor
        time of the loop's thread [ns], for `LawRunner`."""
        self.settings = settings
        self.mode = mode
        self.activation = activation
        self.output = NO_FORCE
        self.laws = LawRunner(settings, friction, laws, own, period_ns, work_ns)
        self.reason = ""
        self.handle_force = 0.0
        self.wanted = SetpointInput(axes=1)
        self.guide = Guide(slot_limits, Reach(settings.travel_low, settings.travel_high))
        self.support = Support(support)
        self.lease = Lease()
        self._excited = Excited()
        self.answered: EncoderReading | None = None
        self.meter = DeadlineMeter(period_ns)
        self._checks = VerticalChecks(watch, period_ns)
        self.fault = self._checks.fault
        self._agreement = Agreement(agreement)
        self._period_ns = period_ns
        self._enabled: bool | None = None
        self._brakes = False
        self._hand: ForceReading | None = None
        self._drive = Age(_DRIVE_AGE_NS)
        self._must_reset = False

    @property
    def faulted(self) -> bool:
        """Whether a fault is latched."""
        return bool(self.fault.reason)

    def on_force(self, sample: ForceReading, now_ns: int) -> None:
        """Process a force sample."""
        if self._checks.force(sample, now_ns):
            self.handle_force, self._hand = sample.fz, sample
        self._keep_fault()

    def on_encoder(self, sample: EncoderReading, now_ns: int) -> VerticalOutput | None:
        """Return the force for an encoder sample, None if the checks reject the sample."""
        if not self._checks.encoder(sample, now_ns):
            self._keep_fault()
            return None
        last, self.answered = self.answered, sample
        if last is not None and sample.homings != last.homings:
            self._agreement.restart()
        elapsed_ns = sample.monotonic_ns - last.monotonic_ns if last else self._period_ns
        dt = elapsed_ns * 1e-9
        self._check(now_ns)
        slot = self.guide.guidance(sample.position, 0.0, sample.velocity, 0.0, now_ns, dt)
        active = not self.reason and self._enabled is True
        excites = self.mode == EXCITATION
        support, acts, hand = 0.0, active and not excites, self._hand
        if not self.support.idle(now_ns):  # most ticks carry nothing, and have no time to spare
            largest = self.support_limit
            support = self.support.force(largest, acts, sample.velocity, hand, now_ns, dt)
        # Where no spring pulls, a set point that nobody repeats is forgotten too.
        pulls = active and self.mode not in _NO_SPRING
        target, target_speed = self.wanted.at(now_ns, pulls)
        inp = VerticalInput(
            self.mode,
            sample.position,
            sample.velocity,
            self.handle_force,
            target,
            target_speed,
            acts,
            slot.force_x,
            slot.weight,
            support,
        )
        output = self.laws.step(self.settings, inp, dt)
        if output is None:
            self.set_fault(self.laws.wrong)
            output = self._no_force()
        self.output = output
        if excites and not self.laws.wrong:
            self.output = self.output._replace(force=self._excitation(sample, active))
        return self.output

    def _excitation(self, sample: EncoderReading, active: bool) -> float:
        force, wrong = excitation_step(
            self.lease.request, self._excited, sample.sequence, sample.position,
            1e9 / self._period_ns, active,
        )  # fmt: skip
        self.fault.set(wrong)
        self._keep_fault()
        return force

    @property
    def support_limit(self) -> float:
        """Largest support of the arm that mode and drive allow now [N]."""
        feeds_back = self.laws.needs_force(self.mode)
        return largest_support(self.support.settings, feeds_back, self._brakes)

    def excite(self, request: Excitation, now_ns: int) -> None:
        """Take a trial's request; its lease begins only while no torque passes."""
        if self.lease.held or not self._enabled:
            self.lease.renew(request, now_ns)

    @property
    def home_in_doubt(self) -> bool:
        """Whether only a homing of the encoder lets the force return."""
        return self._checks.home_in_doubt

    @property
    def may_act(self) -> bool:
        """Whether the drive is enabled, or a force is commanded."""
        return self._enabled is True or self.output.force != 0.0

    def on_drive(
        self, enabled: bool, position: float, now_ns: int, brakes: bool = False
    ) -> None:
        """Process the drive's report: torque on or off, travel of the nut [m].

        brakes: it shorts the motor when its torque goes off, so that the arm does not fall.
        While the torque is off, encoder and drive are compared too, so that a slip at each enabling
        adds up; where they disagree then, one of them counts anew, and so does the comparison.
        """
        self._drive.note(now_ns)
        self._brakes = brakes
        if not enabled and self.faulted and not self._must_reset:
            self.reset(now_ns)
        if self._enabled is None:
            self._agreement.restart()
        if last := self.answered:
            apart = self._agreement.check(last.position, position, last.velocity, now_ns)
            if apart and enabled:
                self._checks.doubt_home(apart)
            elif apart:
                self._agreement.restart()
        self._enabled = enabled
        self._keep_fault()

    def set_fault(self, reason: str) -> None:
        """Hold the force at zero for a reason that the samples do not show."""
        self.fault.set(reason)
        self._keep_fault()

    def end_tick(self, now_ns: int) -> None:
        """Detect a drive that has not reported for a while.

        While it is enabled, its position is what the encoder is compared with: its silence is a
        fault.
        """
        if self._drive.fresh(now_ns):
            return
        if self._enabled:
            self.fault.set(
                f"amplifier: no state for {_DRIVE_AGE_NS / 1e6:g} ms, with which the encoder is "
                "compared"
            )
            self._keep_fault()
        elif self.faulted and not self._must_reset:
            self.reset(now_ns)
        self._enabled = None  # the next report begins a new comparison

    def count(self, now_ns: int) -> None:
        """Count the newest sample as answered at now_ns [ns]."""
        assert self.answered is not None, "nothing was answered yet"
        self.meter.tick(self.answered.sequence, self.answered.monotonic_ns, now_ns)

    def stop_when_silent(self, now_ns: int) -> VerticalOutput | None:
        """Return zero force when samples stop while a force is commanded, else None."""
        self._check(now_ns)
        if not self.reason or self.output.force == 0.0:
            return None
        self.laws.restart()
        self.output = self._no_force()
        return self.output

    def _no_force(self) -> VerticalOutput:
        self.support.state = SupportState()
        return NO_FORCE._replace(desired_position=self.output.desired_position)

    def reset(self, now_ns: int) -> None:
        """Clear a latched fault; it returns at once while its cause persists.

        After a jump or a disagreement the force stays at zero until the next homing.
        """
        self._must_reset = False
        self._agreement.restart()
        self._checks.reset(now_ns)
        self._check(now_ns)

    def _check(self, now_ns: int) -> None:
        if self.lease.check(now_ns) and self.may_act:
            self.fault.set(LAPSED)
        self.reason = self._checks.check(now_ns) or self._force_refusal()
        self._keep_fault()

    def _force_refusal(self) -> str:
        """Return why the mode cannot run: it feeds back a force that was never measured."""
        if self._checks.force_seen or not self.laws.needs_force(self.mode):
            return ""
        return (
            f"force sensor: no sample yet, and mode {self.laws.name_of(self.mode)} feeds its force "
            "back: start it, or choose another mode"
        )

    def _keep_fault(self) -> None:
        """Record a fault in operation at once, before it switches the amplifier off."""
        if self.faulted and self.may_act:
            self._must_reset = True
        self.reason = self.reason or self.fault.reason
