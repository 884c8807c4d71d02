# SPDX-License-Identifier: Apache-2.0
"""Laws of others that answer anything, under any samples and modes: bounded, or zero."""

from __future__ import annotations

import math
from dataclasses import replace

from anything import ROUNDING, absurd, all_finite, fixed, near
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control.law import Asked, Help, Law, Variant
from screw_module_ros.control.laws import LAWS
from screw_module_ros.control.limits import LONGEST_STEP
from screw_module_ros.control.vertical import VerticalInput
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.loop.law_runner import LawRunner

ONE, OTHER = 100, 150
SETTINGS = VerticalSettings()
REAL = {"foresee": 0.0, "ask": Asked(0.0, 1.0, 0.0), "help": Help(0.0, 0.0, 0.0, 0.0)}
numbers = near(-500.0, 500.0, wild=False)
odd = st.one_of(absurd, st.sampled_from((None, "65", "much", (1.0, 2.0), 1j, True, 10**400)))
errors = st.sampled_from((ValueError("no"), SystemExit(1), GeneratorExit(), OverflowError()))
ticks = st.sampled_from((1, 20, 200))


def is_number(value):
    """Return whether a law may answer with this."""
    try:
        return abs(float(value)) <= 1e9
    except (TypeError, ValueError, OverflowError):
        return False


class Settings(tuple):
    """Settings of a law that has none."""

    _fields = ()


class LawsOfOthers(RuleBasedStateMachine):
    """Two laws whose answers are drawn, beside that of the package."""

    def __init__(self):
        super().__init__()
        self.answers, self.raises, self.asked = dict(REAL), {}, set()
        functions = {name: self.function(name) for name in (*REAL, "rest")}
        one = Law("one", {ONE: Variant("ONE"), ONE + 1: Variant("TWO")}, Settings, **functions)
        other = replace(one, name="other", variants={OTHER: Variant("OTHER")})
        self.runner = LawRunner(SETTINGS, thesis_friction(), (*LAWS, one, other))
        self.inp = VerticalInput(ONE, 0.2, 0.0, 0.0, math.nan, 0.0, True)
        self.dt, self.force = 0.001, 0.0
        self.run(700)

    def function(self, name):
        def asked(*given):
            self.asked.add(name)
            if name in self.raises:
                raise self.raises[name]
            return self.answers.get(name)

        return asked

    @rule(mode=st.sampled_from((0, 1, 3, ONE, ONE + 1, OTHER)), ticks=ticks)
    def switch(self, mode, ticks):
        self.inp = self.inp._replace(mode=mode)
        self.run(ticks)

    @rule(
        position=near(-0.05, 0.41, wild=False), velocity=near(-1.5, 1.5, wild=False),
        force=near(-150.0, 150.0, wild=False), active=st.sampled_from((True, True, True, False)),
        slot=st.sampled_from(((0.0, 0.0), (0.0, 0.0), (45.0, 1.0), (-45.0, 0.5))),
        dt=st.sampled_from((0.0005, 0.001, 0.002, 0.05)), ticks=ticks,
    )  # fmt: skip
    def move(self, position, velocity, force, active, slot, dt, ticks):
        self.dt = dt
        changed = {"position": position, "velocity": velocity, "force": force, "active": active}
        self.inp = self.inp._replace(**changed, slot_force=slot[0], slot_weight=slot[1])
        self.run(ticks)

    @rule(
        fed=numbers, pull=numbers, helped=st.tuples(numbers, numbers, numbers, numbers), ticks=ticks
    )
    def answer(self, fed, pull, helped, ticks):
        self.answers = {"foresee": fed, "ask": Asked(pull, 1e9, -1e9), "help": Help(*helped)}
        self.run(ticks)

    @rule(name=st.sampled_from(("foresee", *Asked._fields[:1], *Help._fields)), value=odd)
    def answer_oddly(self, name, value):
        kept, self.asked, of = dict(self.answers), set(), "foresee"
        if name == "foresee":
            self.answers[name] = value
        else:
            of = "ask" if name in Asked._fields else "help"
            self.answers[of] = kept[of]._replace(**{name: value})
        self.run(1)
        assert of not in self.asked or is_number(value) or self.runner.wrong
        self.answers = kept

    @rule(name=st.sampled_from((*REAL, "rest")), error=errors)
    def fail(self, name, error):
        self.raises = {name: error}
        self.run(1)
        self.raises = {}

    def run(self, ticks):
        for _ in range(ticks):
            output = self.runner.step(SETTINGS, self.inp, self.dt)
            if output is None:
                assert self.runner.wrong.startswith(("law one: ", "law other: "))
                assert self.runner.state.weight == self.runner.state.base == 0.0
                self.force = 0.0
                return
            self.judge(self.inp, min(self.dt, LONGEST_STEP), output)
        assert all_finite(replace(self.runner.state, law=0.0))

    def judge(self, inp, dt, output):
        assert not self.runner.wrong and all_finite(output)
        assert -SETTINGS.command_down <= output.force <= SETTINGS.command_up
        assert -SETTINGS.force_down <= output.impedance <= SETTINGS.force_up
        assert abs(output.carried) <= SETTINGS.force_up + SETTINGS.force_down
        assert abs(output.friction + output.feedback) <= 200.0
        assert inp.active or output.force == 0.0
        step = abs(output.force - self.force)
        assert output.force == 0.0 or step <= SETTINGS.force_rate * dt + ROUNDING
        self.force = output.force


TestLawsOfOthers = LawsOfOthers.TestCase
TestLawsOfOthers.settings = fixed(20, 25)
