# SPDX-License-Identifier: Apache-2.0
"""The laws of one controller: which of them runs, and what becomes of one that fails."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from .. import plugins
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


class _Broken(Exception):
    """In place of what a law's functions get: why it could not be made."""


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
        if taken_ns <= MOST * self._period_ns:
            self._slow = 0
            return ""
        self._slow += 1
        often = self._slow >= RUNNING and taken_ns <= MOST_ONCE * self._period_ns
        return self.duration_flaw("a step", taken_ns, MOST if often else MOST_ONCE)

    def duration_flaw(self, what: str, taken_ns: int, most: float = MOST_ONCE) -> str:
        """Return why it took more than `most` periods, empty if it did not."""
        if taken_ns <= most * self._period_ns:
            return ""
        return (
            f"{taken_ns / 1e6:.2f} ms of processor time for {what}, more than "
            f"{most * self._period_ns / 1e6:g} ms"
        )


def numbers_of(memory: Any, shown: Iterable[str]) -> dict[str, float]:
    """Return attributes of a law's memory by their names; NaN for what is no number there."""
    return {name: _number(memory, name) for name in shown}


def _number(memory: Any, name: str) -> float:
    try:
        return float(getattr(memory, name))
    except KeyboardInterrupt:
        raise
    except BaseException:  # the law may be somebody else's: anything may come out of it
        return math.nan


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
        self._p = p
        self._owns = {law.name: self._made_own(law, p) for law in self.laws}
        self.restart()

    def choose(self, name: str, settings: Any) -> None:
        """Take other settings of a law of others; for any thread."""
        self._chosen[name] = settings
        law, p = next(law for law in self.laws if law.name == name), None
        while p is not self._p:  # which a step may replace meanwhile
            p = self._p
            self._owns[name] = self._made_own(law, p)

    def _take(self, p: VerticalSettings) -> None:
        """Take other settings within a step; a law that is slow with them, running or not, has
        itself to blame."""
        self._p = p
        for law in self.laws:
            begun = self._work_ns() if self._work_ns else 0
            own = self._made_own(law, p)
            if self._work_ns and (late := self._work.duration_flaw("own", self._work_ns() - begun)):
                own = _Broken(late)
            self._owns[law.name] = own

    def _made_own(self, law: Law, p: VerticalSettings) -> Any:
        """Return what a law's functions get, `_Broken` if that fails: it is told when it runs."""
        try:
            return own_of(law, p, self._friction, self._chosen.get(law.name))
        except BaseException as error:  # the law may be somebody else's: anything may come out
            return _Broken(plugins.told(error))

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
        except KeyboardInterrupt:
            raise
        except BaseException:
            self.law = self.laws[0]
            self.state = self._begun()

    def _begun(self) -> EnvelopeState:
        state = initial_state(self._p, self.law, self._own(self.law))
        state.mode = min(self.law.variants)  # also where OFF is the first mode that comes
        return state

    def _own(self, law: Law) -> Any:
        """Return what the law's functions get. Raises `_Broken`."""
        own = self._owns[law.name]
        if isinstance(own, _Broken):
            raise _Broken(*own.args)
        return own

    def step(self, p: VerticalSettings, inp: VerticalInput, dt: float) -> VerticalOutput | None:
        """Return the running law's command, None with `wrong` where it has none."""
        self.wrong = ""
        begun = self._work_ns() if self._work_ns else 0
        asked = wanted = self._of.get(inp.mode, self.law)
        try:
            if p is not self._p:
                self._take(p)
                begun = self._work_ns() if self._work_ns else 0
            if wanted is not self.law:
                inp = self._making_room(wanted, inp)
            asked = self.law
            own = self._owns[asked.name]
            if type(own) is _Broken:
                raise _Broken(*own.args)
            output = self._steps[asked.name](p, own, self.state, inp, dt)
        except BaseException as error:  # the law may be somebody else's: anything may come out
            self._fails(asked, str(error) if type(error) is _Broken else plugins.told(error))
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
        self.law, self.state.law, self.state.mode = wanted, memory, inp.mode
        self._work.restart()
        return inp

    def _fails(self, law: Law, why: str) -> None:
        self.wrong = f"law {law.name}: {why}"
        self._work.restart()
        self.restart()
