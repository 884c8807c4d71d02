# SPDX-License-Identifier: Apache-2.0
"""The laws of one controller: which of them runs, and what becomes of one that fails."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from ..control.envelope import LEAVE, EnvelopeState, enveloped, initial_state
from ..control.friction import FrictionModel
from ..control.law import Law
from ..control.laws import LAWS, names, own_of
from ..control.laws.thesis import THESIS
from ..control.vertical import VerticalInput, VerticalOutput
from ..control.vertical_settings import VerticalSettings

MOST, MOST_ONCE = 0.5, 2.0
"""Periods of processor time that a law may take: three steps running, and once."""
RUNNING = 3


class _Broken(NamedTuple):
    """In place of what a law's functions get: making it raised this error."""

    error: Exception


class WorkTime:
    """The processor time that a law takes: the next sample would wait for a step of too much."""

    def __init__(self, period_ns: int):
        self._period_ns = period_ns
        self.restart()

    def restart(self) -> None:
        """Begin to count anew: for another law."""
        self._slow = 0

    def flaw(self, taken_ns: int) -> str:
        """Return why a step took too much, empty if it did not; taken_ns: processor time [ns]."""
        periods = taken_ns / self._period_ns
        self._slow = self._slow + 1 if periods > MOST else 0
        if periods <= MOST_ONCE and self._slow < RUNNING:
            return ""
        most = MOST_ONCE if periods > MOST_ONCE else MOST
        return (
            f"{taken_ns / 1e6:.2f} ms of processor time for a step, more than "
            f"{most * self._period_ns / 1e6:g} ms"
        )


def numbers_of(memory: Any, shown: Iterable[str]) -> dict[str, float]:
    """Return attributes of a law's memory by their names; NaN for what is no number there."""
    values = {name: getattr(memory, name, math.nan) for name in shown}
    return {name: v if isinstance(v, (int, float)) else math.nan for name, v in values.items()}


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
        self._chosen = dict(settings or {})
        self._friction, self._work_ns, self._work = friction, work_ns, WorkTime(period_ns)
        self._owns: dict[str, Any] = {}
        self._take(p)
        self.restart()

    def choose(self, name: str, settings: Any) -> None:
        """Take other settings of a law of others."""
        self._chosen[name] = settings
        self._take(self._p)

    def _take(self, p: VerticalSettings) -> None:
        self._p = p
        for law in self.laws:
            try:
                self._owns[law.name] = own_of(law, p, self._friction, self._chosen.get(law.name))
            except Exception as error:  # told when the law runs: the others need not know
                self._owns[law.name] = _Broken(error)

    def needs_force(self, mode: int) -> bool:
        """Return whether a mode cannot begin before a sample of the handle's force."""
        law = self._of.get(mode)
        return law is not None and law.variants[mode].force

    def name_of(self, mode: int) -> str:
        """Return the name of a mode."""
        return names(self.laws).get(mode, str(mode))

    @property
    def shown(self) -> dict[str, float]:
        """Numbers that the running law names, of its memory; NaN for what is none there."""
        return numbers_of(self.state.law, self.law.shown)

    @property
    def force_gain(self) -> float:
        """Gain Kf in use, 0 where the running law has none."""
        return self.state.law.gain if self.law is THESIS else 0.0

    def restart(self) -> None:
        """Forget everything: no force, the set point at the next sample.

        A law that cannot even begin anew makes room for the first one of this package.
        """
        try:
            self.state: EnvelopeState = self._begun()
        except Exception:
            self.law = self.laws[0]
            self.state = self._begun()

    def _begun(self) -> EnvelopeState:
        return initial_state(self._p, self.law, self._own(self.law))

    def _own(self, law: Law) -> Any:
        """Return what the law's functions get. Raises the law's own error."""
        own = self._owns[law.name]
        if isinstance(own, _Broken):
            raise own.error
        return own

    def step(self, p: VerticalSettings, inp: VerticalInput, dt: float) -> VerticalOutput | None:
        """Return the running law's command, None with `wrong` where it has none."""
        self.wrong = ""
        begun = self._work_ns() if self._work_ns else 0
        wanted = self._of.get(inp.mode, self.law)
        try:
            if p is not self._p:
                self._take(p)
            if wanted is not self.law:
                inp = self._making_room(wanted, inp)
            own = self._owns[self.law.name]
            if type(own) is _Broken:
                raise own.error
            output = self._steps[self.law.name](p, own, self.state, inp, dt)
        except Exception as error:  # the law may be somebody else's: anything may come out of it
            self._fails(wanted, f"{type(error).__name__}: {error}")
            return None
        if self.state.wrong:
            self._fails(self.law, "its answer is no number")
            return None
        if self._work_ns and (late := self._work.flaw(self._work_ns() - begun)):
            self._fails(self.law, late)
            return None
        return output

    def _making_room(self, wanted: Law, inp: VerticalInput) -> VerticalInput:
        """Let another law take over once the running one has faded out; until then it leaves."""
        if self.state.weight > 0.0 and inp.active:
            return inp._replace(mode=LEAVE)
        memory = wanted.memory(self._own(wanted))
        self.law, self.state.law = wanted, memory
        self._work.restart()
        return inp

    def _fails(self, law: Law, why: str) -> None:
        self.wrong = f"law {law.name}: {why}"
        self._work.restart()
        self.restart()
