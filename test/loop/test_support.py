# SPDX-License-Identifier: Apache-2.0
"""The support in the loop: its lease, the torque, the drive's reaction, laws of others."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from screw_module_ros.control import modes
from screw_module_ros.control.laws import LAWS
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.errors import NotNow
from screw_module_ros.plant.patient import ArmSettings
from screw_module_ros.trials.one_thread import OneThreadRobot

WEIGHT = 20.0
FLOOR = 100
"""Mode of the example of a law of one's own."""


@pytest.fixture
def made():
    """Yield what makes a robot with torque, in a mode, in the hand of a still patient."""
    robots = []

    def make(mode=modes.FORCE_FEEDBACK, reaction="brake", laws=LAWS) -> OneThreadRobot:
        robot = OneThreadRobot(drive=DriveSettings(stop_reaction=reaction), laws=laws)
        robots.append(robot)
        robot.ready()
        robot.controller.settings = robot.controller.settings._replace(damping=10.0)
        robot.controller.mode = mode
        assert robot.enable() == ""
        robot.seconds(0.6)
        return robot

    yield make
    for robot in robots:
        robot.close()


def carry(robot, seconds: float, wish: float = WEIGHT, weight: float | None = None) -> list[float]:
    """Ask for a support at 20 Hz; return the one in use in each tick [N]."""
    if weight is not None:
        robot.world.set_arm(
            ArmSettings("relaxed", mass=3.0, stiffness=300.0, damping=10.0,
                        traits=("weight", "carried"), values=(weight, 0.0))
        )  # fmt: skip
    used = []
    for tick in range(round(seconds * 1e3)):
        if tick % 50 == 0 and not math.isnan(wish):
            robot.controller.support.ask(wish, robot.now_ns)
        robot.tick()
        used.append(robot.controller.support.state.force)
    return used


def without(robot, seconds: float) -> list[float]:
    """Return the support in use while nobody asks [N]."""
    return carry(robot, seconds, math.nan)


def largest_step(used: list[float]) -> float:
    return max(abs(b - a) for a, b in pairwise(used))


def test_it_comes_at_10_newtons_a_second_and_lapses_at_5(made):
    robot = made()
    used = carry(robot, 1.1, 10.0)
    assert used[499] == pytest.approx(5.0, abs=0.1) and used[-1] == 10.0
    gone = without(robot, 0.8)
    assert gone[200] == 10.0 and gone[-1] == pytest.approx(10.0 - 2.5, abs=0.3)
    assert largest_step(used + gone) <= 0.01 + 1e-9


@pytest.mark.parametrize(("reaction", "most"), [("brake", 25.0), ("coast", 8.0)])
def test_the_drive_tells_what_it_may_be(made, reaction, most):
    robot = made(reaction=reaction)
    assert robot.controller.support_limit == most
    assert carry(robot, 1.2, 30.0)[-1] == pytest.approx(min(most, 12.0), abs=0.1)


def test_without_torque_there_is_none_and_with_it_it_comes_from_nothing(made):
    robot = made()
    assert carry(robot, 0.5)[-1] > 4.0
    robot.disable()
    assert carry(robot, 0.5)[-1] == 0.0
    assert robot.enable() == ""
    used = carry(robot, 0.5)
    assert 3.0 < used[-1] < 5.1 and largest_step(used) <= 0.01 + 1e-9


@pytest.mark.parametrize("mode", [modes.OFF, modes.IMPEDANCE, modes.FRICTION_COMPENSATION])
def test_a_mode_without_feedback_takes_it_away_slowly(made, mode):
    """The module's own weight stays carried meanwhile: the command is no less than both."""
    robot = made()
    carry(robot, 0.9)
    robot.controller.mode = mode
    used = carry(robot, 1.0)
    assert robot.controller.support_limit == 0.0
    assert used[-1] == pytest.approx(9.0 - 5.0, abs=0.1)
    assert robot.controller.output.gravity == pytest.approx(10.0)


def test_a_fault_takes_it_at_once(made):
    robot = made()
    carry(robot, 0.5)
    robot.rig.inject("encoder", "cable_out", 0.0, 0.0, robot.now_ns)
    robot.seconds(0.05)
    assert robot.controller.faulted and robot.controller.support.state.force == 0.0


def rests(robot, wish: float, weight: float) -> tuple[float, float]:
    """Return the hand's way from where it was [m] and its force [N] after a while."""
    begin = robot.world.truth().handle_position
    carry(robot, 8.0, wish, weight)
    truth = robot.world.truth()
    return truth.handle_position - begin, truth.patient_force


@pytest.mark.long
def test_a_hanging_arm_sinks_without_it_and_floats_with_it(made):
    way, _ = rests(made(), 0.0, WEIGHT)
    assert way < -0.1
    way, force = rests(made(), WEIGHT, WEIGHT)
    assert abs(way) < 0.01 and force == pytest.approx(-WEIGHT, abs=0.5)


@pytest.mark.long
def test_a_drive_that_brakes_under_an_arm_is_enabled_again(made):
    """The 0.06 Nm that it gives under 20 N while it brakes were excess torque after 60 ms."""
    robot = made()
    rests(robot, WEIGHT, WEIGHT)
    robot.disable()
    robot.ticks(100)
    assert robot.world.vertical_braked and robot.drive.reading.torque > 0.04
    with pytest.raises(NotNow, match="still being disabled"):
        robot.drive.request_enable()
    robot.ticks(1500)
    assert robot.drive.fault == ""
    assert robot.enable() == ""
    robot.seconds(0.6)
    assert robot.world.vertical_powered and robot.drive.fault == ""


@pytest.mark.long
def test_a_law_of_others_that_knows_nothing_of_it_carries_too(made, importing):
    """The example of a law of one's own, from mode 3 to it and back: the arm stays where it is."""
    laws = (*LAWS, importing("own_law", "mylab").FLOOR)
    robot = made(laws=laws)
    rests(robot, WEIGHT, WEIGHT)
    for mode in (FLOOR, modes.FORCE_FEEDBACK):
        robot.controller.mode = mode
        begin = robot.world.truth().handle_position
        used = carry(robot, 3.0)
        assert set(used) == {WEIGHT}
        assert robot.world.truth().handle_position == pytest.approx(begin, abs=0.01)
        assert robot.controller.output.impedance == pytest.approx(WEIGHT, abs=2.0)


@pytest.mark.long
@pytest.mark.parametrize("mode", [modes.FORCE_FEEDBACK, modes.OBSERVER])
def test_a_hand_that_leaves_ends_it(made, mode):
    robot = made(mode)
    rests(robot, WEIGHT, WEIGHT)
    begin = robot.world.truth().handle_position
    robot.world.set_fixture("free")
    way, speed = 0.0, 0.0
    for _ in range(1000):
        carry(robot, 1e-3)
        truth = robot.world.truth()
        way, speed = max(way, truth.handle_position - begin), max(speed, truth.handle_velocity)
    assert robot.controller.support.state.hand_off
    assert 0.005 < way < 0.06 and speed < 0.45
    assert robot.rows[-1].reason == ""
