# SPDX-License-Identifier: Apache-2.0
"""The environments' loop against the other ways to run the same law on the same plant."""

from __future__ import annotations

import math

import numpy as np
import pytest

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.compiled import compiled, packed
from screw_module_ros.control.envelope import initial_state
from screw_module_ros.control.laws import own_of
from screw_module_ros.control.laws.thesis import THESIS
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.modes import FORCE_FEEDBACK
from screw_module_ros.control.slot import Slot
from screw_module_ros.control.support import SupportState
from screw_module_ros.control.torque_chain import TorqueChain
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.filters import lowpass_coefficients, velocity_settled
from screw_module_ros.graph import SEPARATE_LATENCY
from screw_module_ros.gym.course import Course
from screw_module_ros.gym.loop import PERIOD, ROW_TICKS, Goal, Order
from screw_module_ros.identification.vertical_loop import (
    COLUMNS,
    LAW,
    LoopParams,
    LoopState,
    Transducer,
    ticks_of,
)
from screw_module_ros.plant.instruments import CurrentSensorState, current_sensor_params
from screw_module_ros.plant.module import HUMAN_ARM, resting_state, vertical_params
from screw_module_ros.plant.patient import ArmSettings, arm_force, changed_patient, resting_patient
from screw_module_ros.plant.settings import arm_of, load_world
from screw_module_ros.therapy.protocol_file import load_protocol
from screw_module_ros.trials.one_thread import OneThreadRobot

pytestmark = pytest.mark.long
ARM = arm_of("healthy")
CENTRE, TARGET, SECONDS = 0.18, 0.30, 3.0
REACH = ArmSettings(target=(0.0, 0.0, TARGET), duration=1.1)


def quiet_world():
    """Return the rig without what two sources of noise would draw differently."""
    world = load_world()
    silent = world.sensor._replace(force_noise=0.0, force_drift=0.0, force_bias=0.0)
    start = world.start._replace(position=CENTRE, x=0.0, y=0.0)
    return world._replace(sensor=silent, start=start, arm=ARM)


def order(guided=False, slot=None, begun=-1):
    """Return an order that nothing but its time ends."""
    nowhere = (0.0, 0.0, 0.0)
    goal = Goal(nowhere, nowhere, nowhere, nowhere, -1.0, 0, math.inf, math.inf, 10**9)
    held = Slot(side_stiffness=0.0, back_stiffness=0.0, damping=0.0)
    return Order(guided, held, slot or held, -1, begun, 0.0, goal, 0)


def in_vertical_loop(world):
    """Return heights and forces of a reach by `identification.vertical_loop`."""
    settings, dt = VerticalSettings(), world.substep
    own = own_of(THESIS, settings, thesis_friction())
    (_, _, path) = changed_patient(resting_patient(ARM, 0.0, 0.0, CENTRE), REACH, 0.0).paths
    params = LoopParams(
        plant=vertical_params(
            world.vertical, world.friction, world.amplifier, world.transducer, arm_force(ARM), dt,
            world.sensor.bandwidth, world.sensor.hysteresis,
        ),
        lead=world.vertical.lead, amplifier=world.amplifier, sensor=current_sensor_params(dt),
        transducer=Transducer(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 144.0, 5665.0),
        chain=TorqueChain(linearization=default_linearization()), amperes=1.0 / 0.16,
        smooth=lowpass_coefficients(30.0, PERIOD), law=settings, own=own, path=path,
        period=PERIOD, steps=round(PERIOD / dt), late=round(SEPARATE_LATENCY / dt), kind=LAW,
        mode=FORCE_FEEDBACK, amplitude=0.0, omega=0.0, centre=math.nan, fixture=HUMAN_ARM,
        upright=1.0, stage_speed=0.0, stage_target=0.0,
    )  # fmt: skip
    state = LoopState(
        0, 0.0, resting_state(world.vertical, CENTRE, 1.0),
        packed(initial_state(settings, THESIS, own)), packed(SupportState()),
        velocity_settled(CENTRE), 0.0, np.zeros(1), CurrentSensorState(), 0.0, 1, 1,
    )  # fmt: skip
    rows = np.empty((round(SECONDS / PERIOD), COLUMNS))
    compiled(ticks_of(THESIS))(packed(params), state, rows)
    return rows[ROW_TICKS - 1 :: ROW_TICKS, [0, 2]]


def test_a_vertical_episode_is_the_vertical_loops_run():
    """The same law, delay and rig, without slots: each sample, bit for bit."""
    world = quiet_world()
    course = Course(load_protocol("elevator"), None, ARM, world, 1, THESIS)
    course.send(REACH)
    rows = course.run(order(), SECONDS)
    expected = in_vertical_loop(world)
    assert np.ptp(rows[:, 3]) > 0.1, "the hand did not reach"
    assert np.array_equal(rows[:, [3, 9]], expected)


def in_one_thread(world, slot):
    """Return the heights of the same reach by all loops, drivers and guards, each millisecond."""
    robot = OneThreadRobot(seed=1, world=world)
    robot.ready()
    robot.controller.mode = FORCE_FEEDBACK
    assert robot.enable() == ""
    robot.seconds(1.0)
    robot.world.set_arm(REACH)
    begun = robot.now_ns
    robot.controller.guide.ask(slot, begun, begun)
    heights = []
    for tick in range(round(SECONDS / PERIOD)):
        if tick % 100 == 0:
            robot.controller.guide.ask(slot, begun, robot.now_ns)
        robot.tick()
        heights.append(robot.rows[-1].position)
    robot.close()
    return np.array(heights)


def test_an_episode_in_a_slot_is_that_of_the_whole_robot():
    """With drivers, buses, gate and guards, whose delay is 0.35 ms shorter: within 0.1 mm."""
    world = quiet_world()
    slot = Slot(start_x=CENTRE, target_x=TARGET, duration=0.7, back_stiffness=200.0)
    course = Course(load_protocol("elevator"), None, ARM, world, 1, THESIS)
    course.run(order(), 1.0)
    course.send(REACH)
    begun = course.state.ticks
    rows = course.run(order(True, slot, begun), SECONDS)
    heights = in_one_thread(world, slot)[ROW_TICKS - 1 :: ROW_TICKS]
    assert np.ptp(heights) > 0.1, "the hand did not reach"
    assert np.abs(rows[:, 3] - heights).max() < 1e-4
