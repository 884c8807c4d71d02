# SPDX-License-Identifier: Apache-2.0
"""The vertical controller: samples in, force out, zero whenever the watch doubts them.

What the node `impedance_controller` runs, without ROS.
"""

from __future__ import annotations

import math

from ..control.agreement import Agreement, AgreementSettings
from ..control.friction import FrictionModel
from ..control.modes import OFF
from ..control.vertical import (
    VerticalInput,
    VerticalOutput,
    VerticalState,
    initial_state,
    vertical_step,
)
from ..control.vertical_settings import VerticalSettings
from ..control.watch import EncoderLike, ForceLike, VerticalWatch, WatchSettings

NO_FORCE = VerticalOutput(0.0, 0.0, 0.0, 0.0, 0.0, False, math.nan, 0.0)


class VerticalController:
    """Watch and law of the vertical axis; all times are passed in [ns].

    mode, settings: may be replaced at any time, the law fades over. output: of the last step.
    reason: why the force is held at zero, empty while it is not. A fault seen while the amplifier
    is on or a force is out stays until `reset`; any other goes when its cause does.
    """

    def __init__(
        self,
        settings: VerticalSettings,
        friction: FrictionModel,
        watch: WatchSettings,
        agreement: AgreementSettings,
        period_ns: int,
        mode: int = OFF,
    ):
        self.settings = settings
        self.mode = mode
        self.output = NO_FORCE
        self.state: VerticalState = initial_state(settings)
        self.reason = ""
        self.handle_force = 0.0
        self._friction = friction
        self._watch = VerticalWatch(watch, period_ns)
        self._agreement = Agreement(agreement)
        self._disagreement = ""
        self._period_ns = period_ns
        self._last: EncoderLike | None = None
        self._enabled: bool | None = None
        self._must_reset = False

    @property
    def faulted(self) -> bool:
        """Whether a fault is latched."""
        return bool(self._watch.fault or self._disagreement)

    def force(self, sample: ForceLike, now_ns: int) -> None:
        """Take a force sample."""
        if self._watch.force(sample, now_ns):
            self.handle_force = sample.fz
        self._keep_fault()

    def amplifier(self, enabled: bool | None, position: float, now_ns: int) -> None:
        """Take what the amplifier says: torque on or off, None = unknown; nut travel [m]."""
        if not enabled and self.faulted and not self._must_reset:
            self.reset(now_ns)
        if enabled != self._enabled or not enabled or self._last is None:
            self._agreement.restart()
        else:
            last = self._last
            wrong = self._agreement.check(last.position, position, last.velocity, now_ns)
            self._disagreement = self._disagreement or wrong or ""
        self._enabled = enabled
        self._keep_fault()

    def act(
        self, sample: EncoderLike, setpoint: tuple[float, float], now_ns: int
    ) -> VerticalOutput | None:
        """Return the force for an encoder sample, None when it is not to be acted upon.

        setpoint: height [m], NaN = none, and velocity [m/s].
        """
        if not self._watch.encoder(sample, now_ns):
            self._keep_fault()
            return None
        last, self._last = self._last, sample
        elapsed_ns = sample.monotonic_ns - last.monotonic_ns if last else self._period_ns
        self._check(now_ns)
        inp = VerticalInput(
            self.mode,
            sample.position,
            sample.velocity,
            self.handle_force,
            *setpoint,
            not self.reason and self._enabled is not False,
        )
        self.output, self.state = vertical_step(
            self.settings, self._friction, self.state, inp, elapsed_ns * 1e-9
        )
        return self.output

    def idle(self, now_ns: int) -> VerticalOutput | None:
        """Return the zero to send when samples fail to come while a force is out, else None."""
        self._check(now_ns)
        if not self.reason or self.output.force == 0.0:
            return None
        self.state = initial_state(self.settings)
        self.output = NO_FORCE._replace(desired_position=self.output.desired_position)
        return self.output

    def reset(self, now_ns: int) -> None:
        """Forget a latched fault; it comes back at once while its cause persists."""
        self._disagreement = ""
        self._must_reset = False
        self._agreement.restart()
        self._watch.reset(now_ns)
        self._check(now_ns)

    def _check(self, now_ns: int) -> None:
        self.reason = self._watch.check(now_ns) or self._disagreement
        self._keep_fault()

    def _keep_fault(self) -> None:
        """Note at once, before the amplifier goes off over it, that a fault came in operation."""
        if self.faulted and (self._enabled or self.output.force != 0.0):
            self._must_reset = True
        self.reason = self.reason or self._watch.fault or self._disagreement
