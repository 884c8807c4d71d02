# SPDX-License-Identifier: Apache-2.0
"""Laws of others that fail in unusual ways: a fault with the law's name, and nothing else ends."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace

import pytest
from laws_of_others import FLOOR, ODD, THE_FLOOR, THE_ODD, OddSettings
from plane_laws_of_others import THE_ASKED as ODD_IN_THE_PLANE

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import modes
from screw_module_ros.control.arms import FIVE_BAR, answering, kinematics_flaw
from screw_module_ros.control.excitation import Excitation
from screw_module_ros.control.law import feeds, pulls
from screw_module_ros.control.laws import LAWS
from screw_module_ros.control.planar import PlanarInput
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.vertical import VerticalInput
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.loop.law_runner import LawRunner
from screw_module_ros.loop.plane_law_runner import PlaneLawRunner
from screw_module_ros.trials.one_thread import PERIOD_NS, OneThreadRobot

SETTINGS = VerticalSettings()
SAMPLE = VerticalInput(ODD, 0.2, 0.0, 0.0, math.nan, 0.0, True)
AT_REST = SAMPLE._replace(active=False)


class Untold(Exception):
    """An error without a text."""

    def __str__(self):
        raise ValueError("no text either")


class Unruly:
    """A function of a law that does as it is asked when `error` is None, and raises it else."""

    def __init__(self, answer=None):
        self.answer, self.error = answer, None

    def __call__(self, *given):
        if self.error is not None:
            raise self.error
        return self.answer(*given) if callable(self.answer) else self.answer


def runner(*laws, **more):
    """Return what runs these laws beside the package's."""
    return LawRunner(SETTINGS, thesis_friction(), (*LAWS, *laws), **more)


def run(laws, mode=ODD, ticks=600, settings=SETTINGS):
    """Run a law until it has all of its weight; return the last output."""
    outputs = [laws.step(settings, SAMPLE._replace(mode=mode), 1e-3) for _ in range(ticks)]
    return outputs[-1]


ERRORS = [
    (SystemExit(3), "SystemExit: 3"),
    (GeneratorExit(), "GeneratorExit"),
    (asyncio.CancelledError(), "CancelledError"),
    (Untold(), "Untold: its text cannot be told"),
    (KeyError("\ud800\0\n"), r"KeyError: '\ud800\x00\n'"),
    (ValueError("\ud800\0\n\tx"), "ValueError: ?? x"),
    (ValueError("long " * 1000), f"ValueError: {'long ' * 57}..."),
]


@pytest.mark.parametrize(("error", "said"), ERRORS, ids=lambda value: type(value).__name__)
def test_whatever_a_law_raises_is_one_printable_line_with_its_name(error, said):
    ask = Unruly(pulls(1.0))
    laws = runner(replace(THE_ODD, ask=ask))
    assert run(laws).force == pytest.approx(11.0)
    ask.error = error
    assert laws.step(SETTINGS, SAMPLE, 1e-3) is None
    assert laws.wrong == f"law odd: {said}" and laws.wrong.isprintable()
    ask.error = None
    assert laws.step(SETTINGS, SAMPLE, 1e-3).force == 0.0 or laws.state.weight < 0.01


@pytest.mark.parametrize("where", ["own", "memory", "rest", "foresee", "ask", "help"])
def test_a_law_that_would_end_the_process_ends_itself_wherever_it_is_asked(where):
    laws = runner(replace(THE_ODD, **{where: Unruly()}))
    getattr(laws.laws[-1], where).error = SystemExit()
    laws.choose("odd", OddSettings())
    sample = AT_REST if where == "rest" else SAMPLE
    assert laws.step(SETTINGS, sample, 1e-3) is None and laws.wrong == "law odd: SystemExit"
    laws.restart()
    assert run(laws, modes.IMPEDANCE).force == pytest.approx(SETTINGS.gravity)


def test_ctrl_c_while_a_law_works_is_still_that_of_the_person_at_the_keyboard():
    ask = Unruly(pulls(0.0))
    laws = runner(replace(THE_ODD, ask=ask))
    ask.error = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        laws.step(SETTINGS, SAMPLE, 1e-3)


def test_a_law_that_fails_while_it_leaves_is_named_and_not_the_next_one():
    ask = Unruly(pulls(0.0))
    laws = runner(replace(THE_ODD, ask=ask), THE_FLOOR)
    run(laws)
    ask.error = ValueError("no way out")
    assert laws.step(SETTINGS, SAMPLE._replace(mode=FLOOR), 1e-3) is None
    assert laws.wrong == "law odd: ValueError: no way out"


def test_a_law_that_cannot_begin_is_named_and_not_the_one_before_it():
    laws = runner(replace(THE_ODD, memory=Unruly()), THE_FLOOR)
    run(laws, FLOOR)
    laws.laws[1].memory.error = ValueError("no memory")
    for _ in range(600):
        if laws.step(SETTINGS, SAMPLE, 1e-3) is None:
            break
    assert laws.wrong == "law odd: ValueError: no memory"


class Time:
    """Processor time [ns]."""

    ns = 0

    def __call__(self):
        return self.ns


def test_a_law_that_is_slow_with_new_settings_of_the_envelope_stops_no_other_one():
    time = Time()

    def slow(settings, robot):
        time.ns += 3 * PERIOD_NS
        return settings

    laws = runner(THE_FLOOR, replace(THE_ODD, own=slow), period_ns=PERIOD_NS, work_ns=time)
    run(laws, FLOOR)
    softer = SETTINGS._replace(stiffness=100.0)
    assert run(laws, FLOOR, 10, softer) and not laws.wrong
    run(laws, ODD, 600, softer)
    assert laws.wrong == "law odd: 3.00 ms of processor time for own, more than 2 ms"
    laws.choose("odd", OddSettings())  # outside the step it may take its time
    assert run(laws, ODD, 600, softer) and not laws.wrong


def test_settings_that_are_chosen_while_a_step_takes_others_go_with_those():
    """The service thread chooses; the loop's thread may be in the middle of a step."""
    found = []

    def own(settings, robot):
        if settings.pull and not found:
            found.append(robot.gravity)
            laws.step(heavier, SAMPLE, 1e-3)  # as the loop's thread may do meanwhile
        return (settings.pull, robot.gravity)

    def ask(own, m, sample, motion):
        seen.append(own)
        return pulls(0.0)

    seen, heavier = [], SETTINGS._replace(gravity=20.0)
    made = {"foresee": Unruly(0.0), "help": Unruly(feeds(0.0, 0.0)), "rest": Unruly()}
    laws = runner(replace(THE_ODD, own=own, ask=ask, **made))
    laws.choose("odd", OddSettings(pull=3.0))
    laws.step(heavier, SAMPLE, 1e-3)
    assert found == [SETTINGS.gravity] and seen[-1] == (3.0, 20.0)


@pytest.mark.parametrize("before", [ODD, FLOOR, modes.COMBINED])
def test_a_law_never_sees_a_mode_that_is_not_its_own(before):
    """Also where it was chosen at rest, and OFF is the first mode that runs."""
    seen = set()
    ask = Unruly(lambda own, m, sample, motion: seen.add(sample.mode) or pulls(0.0))
    laws = runner(replace(THE_ODD, ask=ask), THE_FLOOR)
    run(laws, before)
    laws.step(SETTINGS, AT_REST, 1e-3)
    run(laws, modes.OFF)
    laws.restart()
    run(laws, modes.OFF)
    assert seen == {ODD} and laws.law.name == "odd"


def test_numbers_that_a_law_shows_are_numbers_whatever_its_memory_is():
    class Memory:
        whole, huge, text, truth = 3, 10**400, "three", True

        @property
        def failing(self):
            raise SystemExit

    shown = ("whole", "huge", "text", "truth", "failing", "missing")
    laws = runner(replace(THE_ODD, memory=lambda own: Memory(), rest=Unruly(), shown=shown))
    laws.step(SETTINGS, AT_REST, 1e-3)
    values = list(laws.shown.values())
    assert values[0] == 3.0 and values[3] == 1.0 and all(type(v) is float for v in values)
    assert all(map(math.isnan, (values[1], values[2], values[4], values[5])))


def test_a_law_that_fails_at_rest_ends_the_sine_of_a_trial_within_the_tick():
    rest = Unruly()
    robot = OneThreadRobot(laws=(*LAWS, replace(THE_ODD, rest=rest)))
    robot.ready()
    robot.controller.mode = ODD
    robot.ticks(2)

    def asked(request, ticks):
        for _ in range(ticks // 25):
            robot.controller.excite(request, robot.now_ns)
            robot.ticks(25)

    robot.controller.mode = modes.EXCITATION
    asked(Excitation(), 100)
    robot.world.set_fixture("locked_rotor")
    asked(Excitation(), 100)
    robot.controller.excite(Excitation(), robot.now_ns)
    assert robot.axis.ready() > 0.0 and robot.enable() == ""
    asked(Excitation(), 600)
    asked(Excitation(1, 0.4, 10.0, 2000), 325)
    assert abs(robot.rows[-1].force) > 1.0
    rest.error = ValueError("no rest")
    row = robot.ticks(1)[0]
    assert (row.force, row.reason) == (0.0, "law odd: ValueError: no rest")
    robot.close()


def test_a_law_of_the_plane_that_would_end_the_process_ends_itself():
    ask = Unruly((0.0, 0.0))
    settings = PlanarSettings()
    laws = PlaneLawRunner(settings, replace(ODD_IN_THE_PLANE, ask=ask), FIVE_BAR)
    angles = FIVE_BAR.inverse(0.0, 0.0, settings.arm)
    sample = PlanarInput(*angles, 0.0, 0.0, math.nan, math.nan, 0.0, 0.0, True)
    laws.step(settings, sample, 1e-3)
    ask.error = SystemExit("now")
    output = laws.step(settings, sample, 1e-3)
    assert (output.shoulder_torque, output.elbow_torque) == (0.0, 0.0)
    assert laws.wrong == f"law {ODD_IN_THE_PLANE.name}: SystemExit: now"


def test_an_arm_that_would_end_the_process_has_no_place():
    forward = Unruly()
    forward.error = SystemExit("no")
    arm, own = replace(FIVE_BAR, name="mine", forward=forward), PlanarSettings().arm
    assert all(map(math.isnan, answering(arm).forward(0.0, 0.0, own)))
    assert kinematics_flaw(arm, own, 0.1, 0.1) == "SystemExit: no"
