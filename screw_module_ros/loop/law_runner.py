# SPDX-License-Identifier: Apache-2.0
"""The laws of one controller: which of them runs, and what becomes of one that fails."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from ..control.envelope import LEAVE, EnvelopeState, enveloped, initial_state
from ..control.friction import FrictionModel
from ..control.law import Law, Robot
from ..control.laws import LAWS, names
from ..control.laws.thesis import THESIS
from ..control.vertical import VerticalInput, VerticalOutput
from ..control.vertical_settings import VerticalSettings

MOST, MOST_ONCE = 0.5, 2.0
"""Periods of processor time that a law may take: three steps running, and once."""
RUNNING = 3


class LawRunner:
    """Runs one law; another one takes over when the running one has faded out.

    While it fades the weight stays carried. law: that runs; state: of the envelope; wrong: why the
    last step was no force, empty if it was one; the caller latches it.
    """

    def __init__(
        self,
        p: VerticalSettings,
        friction: FrictionModel,
        laws: Iterable[Law] = LAWS,
        settings: Mapping[str, Any] | None = None,
        period_ns: int = 0,
        work_ns: Callable[[], int] | None = None,
    ):
        """settings: of laws of others, by the law's name; the defaults where it is missing.

        work_ns: processor time of this thread [ns]; without it no step is too long.
        """
        self.laws = tuple(laws)
        self.law, self.wrong = self.laws[0], ""
        self._of = {mode: law for law in self.laws for mode in law.variants}
        self._steps = {law.name: enveloped(law) for law in self.laws}
        others = (law for law in self.laws if law.settings is not VerticalSettings)
        self._chosen = {law.name: law.settings() for law in others} | dict(settings or {})
        self._friction, self._work_ns, self._period_ns = friction, work_ns, period_ns
        self._slow = 0
        self._take(p)
        self.restart()

    def choose(self, name: str, settings: Any) -> None:
        """Take other settings of a law of others."""
        self._chosen[name] = settings
        self._take(self._p)

    def _take(self, p: VerticalSettings) -> None:
        self._p = p
        robot = Robot(self._friction, p.mass, p.gravity)
        self._owns = {law.name: law.own(self._chosen.get(law.name, p), robot) for law in self.laws}

    def needs_force(self, mode: int) -> bool:
        """Return whether a mode cannot begin before a sample of the handle's force."""
        law = self._of.get(mode)
        return law is not None and law.variants[mode].force

    def name_of(self, mode: int) -> str:
        """Return the name of a mode."""
        return names(self.laws).get(mode, str(mode))

    @property
    def shown(self) -> dict[str, float]:
        """Numbers that the running law names, of its memory."""
        return {name: float(getattr(self.state.law, name)) for name in self.law.shown}

    @property
    def force_gain(self) -> float:
        """Gain Kf in use, 0 where the running law has none."""
        return self.state.law.gain if self.law is THESIS else 0.0

    def restart(self) -> None:
        """Forget everything: no force, the set point at the next sample."""
        self.state: EnvelopeState = initial_state(self._p, self.law, self._owns[self.law.name])

    def step(self, p: VerticalSettings, inp: VerticalInput, dt: float) -> VerticalOutput | None:
        """Return the running law's command, None with `wrong` where it has none."""
        if p is not self._p:
            self._take(p)
        if (wanted := self._of.get(inp.mode, self.law)) is not self.law:
            if self.state.weight == 0.0 or not inp.active:
                self.law, self._slow = wanted, 0
                self.state.law = wanted.memory(self._owns[wanted.name])
            else:
                inp = inp._replace(mode=LEAVE)
        self.wrong = ""
        begun = self._work_ns() if self._work_ns else 0
        try:
            output = self._steps[self.law.name](p, self._owns[self.law.name], self.state, inp, dt)
        except Exception as error:  # the law may be somebody else's: anything may come out of it
            self._fails(f"{type(error).__name__}: {error}")
            return None
        if self.state.wrong:
            self._fails("its answer is no number")
            return None
        if self._work_ns:
            self._judge(self._work_ns() - begun)
        return None if self.wrong else output

    def _fails(self, why: str) -> None:
        self.wrong = f"law {self.law.name}: {why}"
        self._slow = 0
        self.restart()

    def _judge(self, taken_ns: int) -> None:
        """Fail when a step took too much processor time: the next sample would wait for it."""
        periods = taken_ns / self._period_ns
        self._slow = self._slow + 1 if periods > MOST else 0
        if periods > MOST_ONCE or self._slow >= RUNNING:
            most = MOST_ONCE if periods > MOST_ONCE else MOST
            self._fails(
                f"{taken_ns / 1e6:.2f} ms of processor time for a step, more than "
                f"{most * self._period_ns / 1e6:g} ms"
            )
