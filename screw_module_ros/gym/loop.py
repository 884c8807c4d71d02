# SPDX-License-Identifier: Apache-2.0
"""The three axes of the robot as one sampled loop in one function, which numba compiles.

A tick is a sample of 1 ms: encoders and transducer, slots and support, both laws within their
envelopes, then the simulated rig, in which the commands of the tick before act until the delay is
over. Laws, slots, support and rig (`plant.simulation`) are those that the nodes run. Buses,
drivers, gates and the guards around the loop are left out, and a plane's torque is not rounded.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..control.envelope import enveloped
from ..control.law import Law
from ..control.laws.plane_impedance import PLANE_IMPEDANCE
from ..control.planar import PlanarInput
from ..control.planar_settings import PlanarSettings
from ..control.plane_envelope import enveloped as enveloped_plane
from ..control.slot import OPEN, Slot, SlotInput, SlotLimits, SlotState, slot_step
from ..control.support import SupportInput, SupportSettings, support_step
from ..control.torque_chain import TorqueChain, commanded, on_the_wire
from ..control.vertical import VerticalInput
from ..control.vertical_settings import VerticalSettings
from ..filters import LowpassCoefficients, VelocityState, velocity_step
from ..geometry import counts_to_height, forward, jacobian
from ..plant.amplifier import Amplifier, bridge_current
from ..plant.module import HUMAN_ARM, ModuleInput, ModuleState
from ..plant.planar import ManusInput, ManusState
from ..plant.sensor import SensorParams, counted_force, measured_wrench, true_wrench
from ..plant.simulation import PLANAR, VERTICAL, advancing

PERIOD = 0.001  # [s] of the vertical axis and the force sensor
PLANE_TICKS = 2  # the plane runs at 500 Hz
ROW_TICKS = 5  # `endpoint_state` tells of the hand at 200 Hz
TORQUE_CONSTANT = 0.16  # [Nm/A] of the motor, from its data sheet (thesis 3.1.6)
COLUMNS = 14
"""Of a row: time [s], place x, y, z [m], velocity [m/s] and force of the patient on the robot [N]
as measured, force of the slots [N], support of the arm [N]."""
_NUT = VERTICAL + ModuleState._fields.index("nut")
_FELT = VERTICAL + ModuleState._fields.index("shown_force")
_SHOULDER, _ELBOW, _FORCE_X, _FORCE_Y = (
    PLANAR + ManusState._fields.index(name)
    for name in ("shoulder", "elbow", "force_x", "force_y")
)
_NOTHING = math.nan  # no set point


class Robot(NamedTuple):
    """What stays the same: settings of laws, slots, support and drives, `own` of the vertical law
    and its mode; the transducer, tared; lead of the screw [m] and counts of its turn; joint_count:
    of a joint's encoder [rad]; amperes: to the amplifier per newton metre [A/Nm]; steps: substeps
    of the rig in a period, late: those before a command acts; planar: the plane moves."""

    vertical: VerticalSettings
    own: Any
    mode: int
    plane: PlanarSettings
    slots: SlotLimits
    support: SupportSettings
    chain: TorqueChain
    amplifier: Amplifier
    sensor: SensorParams
    smooth: LowpassCoefficients
    smooth_plane: LowpassCoefficients
    grip_height: float
    lead: float
    counts: int
    joint_count: float
    amperes: float
    steps: int
    late: int
    planar: bool


class Goal(NamedTuple):
    """When a phase ends: within `radius` of `point` for `rest` ticks; faster along `way` from
    `start` than `speed`, or farther than `gone` [m]; while not within the radius, after `limit`
    ticks. axes: 1.0 for those that count; way: unit vector, zero where any direction counts."""

    point: tuple[float, float, float]
    start: tuple[float, float, float]
    way: tuple[float, float, float]
    axes: tuple[float, float, float]
    radius: float
    rest: int
    speed: float
    gone: float
    limit: int


class Order(NamedTuple):
    """What a session asks for: whether there are slots, those of the plane and the vertical with
    the ticks at which they began, -1 while they are open; support [N]; when that ends, and since
    which tick."""

    guided: bool
    plane: Slot
    vertical: Slot
    plane_begun: int
    vertical_begun: int
    support: float
    goal: Goal
    since: int


class State(NamedTuple):
    """ticks: since the start; filters of the velocities; heat of the vertical motor [Nm^2]; slots;
    current [A] and torques [Nm] that act; state of the noise."""

    ticks: int
    motion: VelocityState
    shoulder: VelocityState
    elbow: VelocityState
    heat: float
    on_plane: SlotState
    on_vertical: SlotState
    current: float
    shoulder_torque: float
    elbow_torque: float
    first: int
    second: int


class Memory(NamedTuple):
    """What a tick changes in place, from `compiled.packed`: of both envelopes and the support; the
    rig's numbers (`plant.simulation.numbers_of`); the newest row."""

    vertical: np.ndarray
    plane: np.ndarray
    support: np.ndarray
    rig: np.ndarray
    shown: np.ndarray


@functools.cache
def running(law: Law, planar_step: Callable) -> Callable[..., tuple[State, int]]:
    """Return what runs an order and fills rows, until its goal is met or they are full.

    The arguments of what it returns: Robot and the rig's `SimulationParams`, both from
    `compiled.packed`, Memory, Order, State, rows of shape (n, COLUMNS). It returns the new state
    and how many rows it has filled. planar_step: of the rig's plane.
    """
    vertical_step, advance = enveloped(law), advancing(planar_step)
    plane_step = enveloped_plane(PLANE_IMPEDANCE)

    def tick(p: Robot, rig: Any, m: Memory, o: Order, s: State) -> State:
        n, shown = m.rig, m.shown
        true = true_wrench(n[_FORCE_X], n[_FORCE_Y], n[_FELT], p.grip_height, 0.0)
        wrench, first, second = measured_wrench(
            p.sensor, true, s.ticks * PERIOD, s.first, s.second
        )
        fx, fy, fz = counted_force(wrench[0]), counted_force(wrench[1]), counted_force(wrench[2])
        z = counts_to_height(math.floor(n[_NUT] / p.lead * p.counts), p.chain.screw, p.counts)
        vz, motion = velocity_step(p.smooth, s.motion, z, PERIOD)
        since = _since_start(s.ticks, o.vertical_begun)
        at = SlotInput(z, 0.0, vz, 0.0, o.guided, o.vertical, since)
        lifts, on_vertical = slot_step(p.slots, s.on_vertical, at, PERIOD)
        hand = SupportInput(o.support, p.support.up, True, vz, fz, max(abs(fx), abs(fy)))
        carried = support_step(p.support, m.support[0], hand, PERIOD)
        inp = VerticalInput(
            p.mode, z, vz, fz, _NOTHING, 0.0, True, lifts.force_x, lifts.weight, carried
        )
        asked = vertical_step(p.vertical, p.own, m.vertical[0], inp, PERIOD)
        made, heat = commanded(p.chain, s.heat, asked.force, 1.0, PERIOD)
        current = bridge_current(p.amplifier, on_the_wire(p.chain, made.command) * p.amperes)

        shoulder, elbow, on_plane = s.shoulder, s.elbow, s.on_plane
        torque_1, torque_2 = s.shoulder_torque, s.elbow_torque
        if p.planar and s.ticks % PLANE_TICKS == 0:
            dt = PLANE_TICKS * PERIOD
            angle_1 = math.floor(n[_SHOULDER] / p.joint_count) * p.joint_count
            angle_2 = math.floor(n[_ELBOW] / p.joint_count) * p.joint_count
            speed_1, shoulder = velocity_step(p.smooth_plane, s.shoulder, angle_1, dt)
            speed_2, elbow = velocity_step(p.smooth_plane, s.elbow, angle_2, dt)
            x, y = forward(angle_1, angle_2, p.plane.arm)
            x_s, x_e, y_s, y_e = jacobian(angle_1, angle_2, p.plane.arm)
            vx, vy = x_s * speed_1 + x_e * speed_2, y_s * speed_1 + y_e * speed_2
            since = _since_start(s.ticks, o.plane_begun)
            over = SlotInput(x, y, vx, vy, o.guided, o.plane, since)
            guides, on_plane = slot_step(p.slots, s.on_plane, over, dt)
            turned = PlanarInput(
                angle_1, angle_2, speed_1, speed_2, _NOTHING, _NOTHING, 0.0, 0.0, True,
                guides.force_x, guides.force_y, guides.weight, shown[7], shown[8],
            )  # fmt: skip
            turns = plane_step(p.plane, p.plane, m.plane[0], turned, dt)
            torque_1, torque_2 = turns.shoulder_torque, turns.elbow_torque
            shown[1], shown[2], shown[4], shown[5] = x, y, vx, vy
            shown[10], shown[11] = guides.force_x, guides.force_y
        shown[0], shown[3], shown[6] = s.ticks * PERIOD, z, vz
        shown[7], shown[8], shown[9] = fx, fy, fz
        shown[12], shown[13] = lifts.force_x, m.support[0].force

        advance(rig, n, on_module(s.current), on_joints(s.shoulder_torque, s.elbow_torque), p.late)
        advance(rig, n, on_module(current), on_joints(torque_1, torque_2), p.steps - p.late)
        return State(
            s.ticks + 1, motion, shoulder, elbow, heat, on_plane, on_vertical, current, torque_1,
            torque_2, first, second,
        )  # fmt: skip

    def run(
        robot: Any, rig: Any, m: Memory, o: Order, s: State, rows: np.ndarray
    ) -> tuple[State, int]:
        rested = -1  # first tick within the goal's radius
        for row in range(rows.shape[0]):
            for _ in range(ROW_TICKS):
                s = tick(robot[0], rig, m, o, s)
            rows[row], now = m.shown, s.ticks - 1
            away, gone, along = _on_way(o.goal, m.shown)
            if away > o.goal.radius:
                rested = -1
                ended = now - o.since >= o.goal.limit
            else:
                rested = now if rested < 0 else rested
                ended = now - rested >= o.goal.rest
            if ended or along >= o.goal.speed or gone >= o.goal.gone:
                return s, row + 1
        return s, rows.shape[0]

    return run


def on_module(current: float) -> ModuleInput:
    """Return the powered module in the patient's hand; current: of the bridge [A]."""
    return ModuleInput(
        current, True, False, HUMAN_ARM, False, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
    )


def on_joints(shoulder: float, elbow: float) -> ManusInput:
    """Return the powered plane in the patient's hand; torques of its motors [Nm]."""
    return ManusInput(
        shoulder, elbow, True, True, False, False, True, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
    )


def still(_params: Any, state: ManusState, _input: ManusInput) -> ManusState:
    """Return the plane as it is: it stands in tasks of the vertical axis alone."""
    return state


def _since_start(ticks: int, begun: int) -> float:
    return (ticks - begun) * PERIOD if begun >= 0 else OPEN


def _on_way(g: Goal, row: np.ndarray) -> tuple[float, float, float]:
    """Return the distance from the goal's point [m], the way gone [m] and the speed along it
    [m/s], or any speed where it has no direction."""
    away = gone = along = size = way = 0.0
    for axis in range(3):
        place, speed = row[1 + axis], row[4 + axis]
        away += (g.axes[axis] * (place - g.point[axis])) ** 2
        gone += g.way[axis] * (place - g.start[axis])
        along += g.way[axis] * speed
        size += (g.axes[axis] * speed) ** 2
        way += g.way[axis] ** 2
    return math.sqrt(away), gone, along if way > 0.0 else math.sqrt(size)
