# SPDX-License-Identifier: Apache-2.0
"""The law of the plane on its arm, and what becomes of one that fails."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from .. import plugins
from ..control.arms import FIVE_BAR, Arm, answering
from ..control.laws.plane import own_of
from ..control.laws.plane_impedance import PLANE_IMPEDANCE
from ..control.planar import PlanarInput, PlanarOutput
from ..control.planar_settings import PlanarSettings
from ..control.plane_envelope import ARM, PlaneState, enveloped, initial_state
from ..control.plane_law import PlaneLaw
from .law_runner import WorkTime, numbers_of

_NOWHERE = PlanarOutput(0.0, 0.0, 0.0, 0.0, *(math.nan,) * 6, False, 1.0)
"""No torques, and nobody knows where the handle is: the arm has answered with no number."""


class PlaneLawRunner:
    """Runs one law on one arm; this package's law stands in, without torque, for one that failed.

    The failed one begins anew when somebody has enabled again. arm: whose functions raise nothing;
    law: that runs when torque acts; state: of the envelope; wrong: why the last step was no force,
    empty if it was one; the caller latches it.
    """

    def __init__(
        self, p: PlanarSettings, law: PlaneLaw, arm: Arm, settings: Any = None,
        period_ns: int = 0, work_ns: Callable[[], int] | None = None,
    ):  # fmt: skip
        """settings: of a law of others, None = its defaults; work_ns: see `LawRunner`."""
        self.law, self.arm, self.wrong = law, answering(arm), ""
        self._chosen, self._taken = settings, True
        self._work_ns, self._work = work_ns, WorkTime(period_ns)
        self._running: PlaneLaw | None = None
        self.restart(p)

    def choose(self, settings: Any) -> None:
        """Have the next step take other settings of a law of others; for any thread."""
        self._chosen, self._taken = settings, False

    @property
    def shown(self) -> dict[str, float]:
        """Numbers that the law names, of its memory; NaN for what is none there."""
        return numbers_of(self.state.law, self.law.shown)

    def restart(self, p: PlanarSettings) -> None:
        """Forget everything: no force, the set point at the next sample."""
        self._p = p
        try:
            self._begin(self.law)
        except KeyboardInterrupt:
            raise
        except BaseException:  # told when it runs
            self._begin(PLANE_IMPEDANCE)

    def _begin(self, law: PlaneLaw) -> None:
        """Have a law run from its beginning. Raises the law's own error."""
        if law is not self._running:
            self._step = enveloped(law, self.arm)
        self._running = law
        self._own = own_of(law, self._p, self._chosen)
        self.state: PlaneState = initial_state(self._p, law, self._own)

    def step(self, p: PlanarSettings, inp: PlanarInput, dt: float) -> PlanarOutput:
        """Return the law's torques, none with `wrong` where it has none."""
        self.wrong = ""
        begun = self._work_ns() if self._work_ns else 0
        try:
            if p is not self._p or not self._taken:
                self._p, self._taken = p, True
                self._own = own_of(self._running or self.law, p, self._chosen)
            if self._running is not self.law and inp.active:
                self._begin(self.law)
            output = self._step(p, self._own, self.state, inp, dt)
        except BaseException as error:  # the law may be somebody else's: anything may come out
            return self._failed(plugins.told(error), p, inp, dt)
        if self.state.wrong == ARM:
            self.wrong = f"arm {self.arm.name}: its answer is no number"
            return _NOWHERE
        if self.state.wrong:
            return self._failed("its answer is no number", p, inp, dt)
        if self._work_ns and (late := self._work.flaw(self._work_ns() - begun)):
            shared = "" if self.arm is FIVE_BAR else f"with arm {self.arm.name}, "
            return self._failed(f"{shared}{late}", p, inp, dt)
        return output

    def _failed(self, why: str, p: PlanarSettings, inp: PlanarInput, dt: float) -> PlanarOutput:
        self.wrong = f"law {self.law.name}: {why}"
        self._work.restart()
        self._p = p
        self._begin(PLANE_IMPEDANCE)
        output = self._step(p, self._own, self.state, inp._replace(active=False), dt)
        return _NOWHERE if self.state.wrong else output
