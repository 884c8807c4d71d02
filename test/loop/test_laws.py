# SPDX-License-Identifier: Apache-2.0
"""Laws of others on the whole robot in one thread: what they ask for stays within the envelope."""

from __future__ import annotations

import math
import re
import statistics
from dataclasses import replace

import pytest
from laws_of_others import FLOOR, ODD, THE_FLOOR, THE_ODD, OddSettings, worked

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import modes
from screw_module_ros.control.gain_guard import PASSIVE
from screw_module_ros.control.law import pulls
from screw_module_ros.control.laws import LAWS
from screw_module_ros.control.vertical import VerticalInput
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.loop.law_runner import MOST, MOST_ONCE, RUNNING, LawRunner
from screw_module_ros.plant.patient import ArmSettings
from screw_module_ros.trials.one_thread import PERIOD_NS, OneThreadRobot

STEP = 2.0 + 1e-9  # largest step of the commanded force [N]
PERIOD_MS = PERIOD_NS * 1e-6


@pytest.fixture
def robot():
    """A robot with laws of others, enabled in IMPEDANCE, the handle held by a quiet arm."""
    made = OneThreadRobot(laws=(*LAWS, THE_ODD, THE_FLOOR), work_ns=worked)
    hold(made)
    made.ready()
    made.controller.mode = modes.IMPEDANCE
    assert made.enable() == ""
    made.seconds(0.6)
    yield made
    made.close()


def hold(robot, **arm):
    """Let an arm hold the handle where it is."""
    still = {"amplitude": (0, 0, 0), "omega": (0, 0, 0), "duration": 0.5, **arm}
    robot.world.set_arm(ArmSettings("active", target=(0.0, 0.0, robot.home), **still))


def odd(robot, seconds=0.0, **asked):
    """Let the odd law ask for something; return the rows of the time after."""
    robot.controller.laws.choose("odd", OddSettings(**asked))
    return robot.seconds(seconds)


@pytest.fixture
def running(robot):
    """The same with the odd law, which has all of its weight and asks for nothing."""
    robot.controller.mode = ODD
    robot.seconds(1.2)
    assert robot.controller.laws.law is THE_ODD and robot.axis.permit.enabled
    return robot


def largest_step(rows):
    forces = [row.force for row in rows]
    return max(abs(b - a) for a, b in zip(forces, forces[1:], strict=False))


def ends_in_zero_force(robot, said):
    """The force is zero from one tick on, latched, and the robot goes on after a reset."""
    rows = robot.rows[-20:]
    assert [row for row in rows if said in row.reason], rows[-1].reason
    assert all(row.force == 0.0 for row in rows if row.reason)
    robot.controller.laws.choose("odd", OddSettings())
    robot.seconds(0.3)
    assert robot.controller.faulted and robot.rows[-1].force == 0.0, "it came back by itself"
    robot.controller.mode = modes.IMPEDANCE
    robot.controller.reset(robot.now_ns)
    assert robot.clear_fault() == "" and robot.enable() == ""
    assert robot.seconds(0.8)[-1].force == pytest.approx(10.0, abs=1.0)


@pytest.mark.parametrize(
    ("where", "number"),
    [("pull", math.nan), ("helping", math.nan), ("foreseen", math.nan), ("foreseen", math.inf),
     ("pull", -math.inf),
     ("helping", 1e12)],
)  # fmt: skip
def test_an_answer_that_is_no_number_ends_in_zero_force(running, where, number):
    before = running.rows[-1].force
    rows = odd(running, 0.002, **{where: number})
    assert before != 0.0 and rows[0].force == 0.0
    ends_in_zero_force(running, "law odd: its answer is no number")


def test_an_error_of_a_law_ends_in_zero_force(running):
    odd(running, 0.002, raises=True)
    ends_in_zero_force(running, "law odd: KeyError: 'no such muscle'")


def fails(own, *more):
    """Raise, wherever a law is asked."""
    raise ArithmeticError("no such number")


@pytest.mark.parametrize("where", ["own", "memory", "rest", "foresee", "ask", "help"])
def test_whatever_of_a_law_raises_the_robot_stops_and_goes_on_with_another(where):
    made = OneThreadRobot(laws=(*LAWS, replace(THE_ODD, **{where: fails})))
    hold(made)
    made.ready()
    made.controller.mode = modes.IMPEDANCE
    assert made.enable() == ""
    made.seconds(0.6)
    made.controller.mode = ODD
    rows = made.seconds(1.2)
    if where == "rest":  # which is called while no force acts
        assert made.disable() == ""
        rows = made.seconds(0.1)
    else:
        said = [row.reason for row in rows if row.reason]
        assert said and said[0] == "law odd: ArithmeticError: no such number"
    assert rows[-1].force == 0.0
    made.controller.mode = modes.IMPEDANCE
    made.seconds(0.1)
    made.controller.reset(made.now_ns)
    assert made.clear_fault() == "" and made.enable() == ""
    assert made.seconds(0.8)[-1].force == pytest.approx(10.0, abs=1.0)
    made.close()


@pytest.mark.parametrize("answer", [None, 3, (1.0, 2.0), "65", pulls("65 N"), pulls(None)])
def test_an_answer_of_another_kind_ends_in_zero_force(answer):
    settings = VerticalSettings()
    odd = replace(THE_ODD, ask=lambda own, m, sample, motion: answer)
    runner = LawRunner(settings, thesis_friction(), (*LAWS, odd))
    inp = VerticalInput(ODD, 0.2, 0.0, 0.0, math.nan, 0.0, True)
    assert runner.step(settings, inp, 1e-3) is None
    assert re.match("law odd: (Attribute|Value|Type)Error", runner.wrong)


def test_a_law_that_takes_long_once_ends_in_zero_force(running):
    odd(running, 0.001, work=1.01 * MOST_ONCE * PERIOD_MS)
    ends_in_zero_force(running, "2.02 ms of processor time for a step, more than 2 ms")


def test_a_law_that_always_takes_half_a_period_ends_in_zero_force(running):
    rows = odd(running, RUNNING * 0.001, work=1.01 * MOST * PERIOD_MS)
    assert [bool(row.reason) for row in rows] == [False, False, True]
    ends_in_zero_force(running, "0.51 ms of processor time for a step, more than 0.5 ms")


def test_a_law_may_take_long_now_and_then(running):
    for _ in range(5):
        odd(running, (RUNNING - 1) * 0.001, work=0.9 * MOST_ONCE * PERIOD_MS)
        odd(running, 0.001)
    assert not running.controller.reason


@pytest.mark.parametrize(
    "asked", [{"pull": 500.0}, {"pull": -500.0}, {"helping": 500.0}, {"foreseen": -500.0}], ids=str
)
def test_500_newtons_asked_stay_within_the_endpoint_s_force(running, asked):
    """65 N up and 45 N down on the hand, 95 N and 75 N in all; help moves the nut, not the hand."""
    rows = odd(running, 0.3, **asked)
    forces = [row.force for row in rows]
    settings, output = running.controller.settings, running.controller.output
    assert largest_step(rows) <= STEP
    assert -settings.command_down <= min(forces) and max(forces) <= settings.command_up
    assert -settings.force_down <= output.impedance <= settings.force_up
    assert bool(asked.get("foreseen")) == (output.friction != 0.0)
    assert not running.controller.reason
    speeds = [abs(row.velocity) for row in rows]
    assert max(speeds) < settings.speed_limit + settings.speed_band


def test_forces_that_alternate_each_tick_are_slewed(running):
    rows = odd(running, 0.5, pull=500.0, alternates=True)
    assert largest_step(rows) <= STEP
    assert max(abs(row.force) for row in rows) < 15.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_hand_that_is_held_feels_what_the_page_says_at_most(running, sign):
    hold(running, mass=30.0, stiffness=3000.0, damping=200.0)
    rows = odd(running, 3.0, pull=sign * 500.0, helping=sign * 500.0, foreseen=sign * 500.0)
    felt = [-row.patient for row in rows]
    assert -67.0 <= min(felt[-500:]) and max(felt[-500:]) <= 89.0
    assert 60.0 < max(map(abs, felt)) < 100.0 and not running.controller.reason


def test_while_a_law_leaves_it_sees_the_last_mode_that_was_its_own(running):
    seen = set()
    law = replace(THE_ODD, ask=lambda own, m, sample, motion: seen.add(sample.mode) or pulls(0.0))
    settings = running.controller.settings
    runner = LawRunner(settings, thesis_friction(), (*LAWS, law))
    inp = VerticalInput(ODD, 0.2, 0.0, 0.0, math.nan, 0.0, True)
    for mode in (ODD,) * 900 + (modes.OFF,) * 300 + (modes.IMPEDANCE,) * 900:
        assert runner.step(settings, inp._replace(mode=mode), 1e-3)
    assert seen == {ODD} and runner.law is LAWS[0]


def rms_of_handle(robot, gain):
    """Return the force's rms on a heavy arm with a force gain, and the guard's share [N]."""
    hold(robot, mass=30.0, stiffness=300.0, damping=5.0)
    odd(robot, 1.2, gain=gain)
    shown = [row.patient for row in robot.seconds(1.5)]
    return statistics.pstdev(shown), robot.controller.output.share


def test_too_large_a_force_gain_is_taken_back_by_the_guard(running):
    """No law need know of the guard: it acts from outside."""
    calm, whole = rms_of_handle(running, 1.0)
    shaken, share = rms_of_handle(running, 40.0)
    assert (whole, calm < 0.5) == (1.0, True)
    assert share < 0.5 and shaken < 4.0
    assert not running.controller.reason


@pytest.mark.parametrize(("damping", "gain"), [(-60.0, 0.0), (-100.0, 3.0)])
def test_an_unstable_law_is_bounded_in_force_and_ends_by_the_guard_of_speed(running, damping, gain):
    """A negative damper drives the hand. The guard puts its own in; if that is not enough, the
    torque ends at 1 m/s, and the ends of travel are met no harder than the hand can bear."""
    hold(running, amplitude=(0, 0, 0.05), omega=(0, 0, 3.0))
    rows, needs = odd(running, damping=damping, gain=gain), []
    for _ in range(40):
        rows = [*rows, *running.seconds(0.05)]
        needs.append(running.controller.laws.state.guard.passivity.need)
    settings = running.controller.settings
    stopped = "faster than 1 m/s" in rows[-1].reason
    assert stopped or max(needs) > PASSIVE, "no damper came in"
    assert max(abs(row.velocity) for row in rows) < settings.speed_limit + 2.0 * settings.speed_band
    assert max(abs(row.patient) for row in rows) < settings.command_up
    assert not stopped or rows[-1].force == 0.0


def test_laws_take_over_from_each_other_in_motion_without_a_jump(robot):
    hold(robot, amplitude=(0, 0, 0.06), omega=(0, 0, 3.0))
    begin, laws = len(robot.rows), set()
    for mode in (ODD, modes.FORCE_FEEDBACK, FLOOR, ODD, modes.OFF, FLOOR, modes.COMBINED, ODD):
        robot.controller.mode = mode
        robot.seconds(1.2 if len(laws) < 3 else 0.3)
        laws.add(robot.controller.laws.law.name)
    assert laws == {"odd", "thesis", "floor"}
    assert largest_step(robot.rows[begin:]) <= STEP
    assert not robot.controller.reason and robot.axis.permit.enabled


def test_the_weight_stays_carried_while_laws_change(robot):
    """Spring and law fade, the handle does not fall."""
    robot.controller.mode = FLOOR
    outputs = []
    for _ in range(1200):
        robot.seconds(0.001)
        outputs.append(robot.controller.output)
    assert min(output.gravity for output in outputs) == pytest.approx(10.0)
    assert robot.controller.laws.law is THE_FLOOR


def test_a_law_shows_numbers_of_its_own(running):
    assert running.controller.laws.shown["ticks"] > 500.0
    assert running.disable() == ""
    running.seconds(0.01)
    assert running.controller.laws.shown == {"ticks": 0.0}, "at rest it forgets the motion"
