# SPDX-License-Identifier: Apache-2.0
"""A simulated patient's session, movement by movement, in the compiled loop.

A movement is that of `therapy.trial`: the hand is brought to the start, the target is shown, the
wall sets out with the hand, and after the end the hand holds still. The patient does what
`nodes/simulated_patient.py` has him do. A test gives the samples of a movement to a session's own
course: it ends in the same samples, with the same measures.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..calibration.module import thesis_friction
from ..compiled import compiled, compiling, packed
from ..control import envelope, plane_envelope, slot
from ..control.law import Law
from ..control.laws import own_of
from ..control.laws.plane_impedance import PLANE_IMPEDANCE
from ..control.linearization import default_linearization
from ..control.minimum_jerk import PEAK_SPEED, way
from ..control.modes import FORCE_FEEDBACK
from ..control.planar_settings import STUDIED_GAIN, PlanarSettings
from ..control.slot import Slot, SlotLimits
from ..control.support import SupportSettings, SupportState
from ..control.torque_chain import TorqueChain
from ..control.vertical_settings import VerticalSettings
from ..filters import lowpass_coefficients, velocity_settled
from ..graph import SEPARATE_LATENCY
from ..plant.module import resting_state, vertical_params
from ..plant.muscles import RESTED
from ..plant.patient import (
    CIRCLE_STEP_SHARE,
    ArmSettings,
    HumanArm,
    arm_force,
    changed_patient,
    on_circle,
    resting_patient,
)
from ..plant.planar import planar_params, planar_step, resting_plane
from ..plant.sensor import seeded, sensor_params
from ..plant.settings import WorldSettings
from ..plant.simulation import SimulationParams, SimulationState, numbers_of
from ..therapy.adaptation import Assistance
from ..therapy.hand import AXES, VERTICAL, Point, distance
from ..therapy.kinematics import hull_area
from ..therapy.line import Line, slots
from ..therapy.measures import EFFORT_FRICTION, EFFORT_MASS, EFFORT_TIME, RESTING
from ..therapy.protocol import CIRCLE, Block, Protocol
from ..therapy.trial import guide_of, pull_of, slot_of
from .loop import (
    COLUMNS,
    PERIOD,
    PLANE_TICKS,
    ROW_TICKS,
    TORQUE_CONSTANT,
    Goal,
    Memory,
    Order,
    Robot,
    State,
    running,
    still,
)

_LONGEST = 200.0  # [s] more than a movement may take: 20 to its start, 120 of waiting and moving
_ANY_WAY, _NEVER = (0.0, 0.0, 0.0), math.inf


class Carried(NamedTuple):
    """What a movement is done with: duration of the back wall's way [s], stiffness of the side
    walls [N/m], support of the arm, up positive [N]."""

    duration: float
    side_stiffness: float
    support: float


class Course:
    """A patient at the robot, from movement to movement. `rows`: samples of the last one, as
    `loop.COLUMNS`, from the display of its target; state: of the loop.

    protocol, block: what he does; arm: the patient's; world: the rig; seed: of its noise; law and
    mode: of the vertical axis. At first the robot stands at the protocol's centre, in his hand.
    """

    def __init__(
        self, protocol: Protocol, block: Block, arm: HumanArm, world: WorldSettings, seed: int,
        law: Law, mode: int = FORCE_FEEDBACK,
    ):  # fmt: skip
        self.protocol, self.block, self.world, self.law = protocol, block, world, law
        x, y, z = protocol.centre
        self._patient = resting_patient(arm, x, y, z)
        self.planar = protocol.space != VERTICAL
        self._run = compiled(running(law, planar_step if self.planar else still))
        vertical, plane = VerticalSettings(), PlanarSettings(force_gain=STUDIED_GAIN)
        own, sensor = own_of(law, vertical, thesis_friction()), sensor_params(world.sensor, seed)
        robot = Robot(
            vertical, own, mode, plane, SlotLimits(), SupportSettings(),
            TorqueChain(linearization=default_linearization()), world.amplifier,
            sensor._replace(bias=(0.0,) * 6),
            lowpass_coefficients(30.0, PERIOD), lowpass_coefficients(30.0, PERIOD * PLANE_TICKS),
            world.vertical.grip_height, world.vertical.lead, world.start.counts_per_turn,
            world.start.joint_resolution, 1.0 / TORQUE_CONSTANT,
            round(PERIOD / world.substep), round(SEPARATE_LATENCY / world.substep), self.planar,
        )  # fmt: skip
        self._packed_robot = packed(robot)
        module, planar = resting_state(world.vertical, z, 1.0), resting_plane(world.planar, x, y)
        rest = SimulationState(0, module, planar, x, y, z, 0.0, 0.0, 0.0, RESTED)
        self._memory = Memory(
            packed(envelope.initial_state(vertical, law, own)),
            packed(plane_envelope.initial_state(plane, PLANE_IMPEDANCE, plane)),
            packed(SupportState()), np.array(numbers_of(rest)),
            np.array([0.0, x, y, z, *(0.0,) * 10]),
        )  # fmt: skip
        free = slot.initial_state()
        self.state = State(
            0, velocity_settled(z), velocity_settled(planar.shoulder),
            velocity_settled(planar.elbow), 0.0, free, free, 0.0, 0.0, 0.0,
            *seeded(seed),
        )  # fmt: skip
        self._buffer = np.empty((round(_LONGEST / PERIOD / ROW_TICKS), COLUMNS))
        self.send(ArmSettings())
        self.rows = self._buffer[:0]

    @property
    def now(self) -> int:
        """Tick of the newest sample."""
        return self.state.ticks - 1

    @property
    def hand(self) -> Point:
        """Where the robot shows the hand [m]."""
        x, y, z = self._memory.shown[1:4].tolist()
        return x, y, z

    def move(self, start: Point, target: Point, by: Carried) -> dict[str, float] | None:
        """Let him do one movement; return its measures, None where the hand came to no start.

        For a circle, `start` is its centre and `target` where it begins.
        """
        circle, rules = self.block.kind == CIRCLE, self.protocol.rules
        line = Line(start, target, self.protocol.space)
        origin = target if circle else start
        self._send(origin)
        if not self._brought(origin, by.support):
            return None
        first = self.rows[-1:]
        like = slot_of(self.protocol, self.block, Assistance(by.duration, by.side_stiffness))
        self._send(self._goal(line, 1))
        least = rules.start_share * PEAK_SPEED * line.length / like.duration
        towards = _ANY_WAY if circle else _unit(line)
        goal = self._until(rules.wait)._replace(
            start=start, way=towards, speed=least, gone=_NEVER if circle else rules.start_way
        )
        shown, waited = self.now, self._go(line, like, -1, by.support, goal)
        begun = self.now
        if circle:
            moved = self._round(line, like, begun, by.support)
        else:
            goal = self._until(rules.give_up)._replace(point=target, radius=rules.hit_radius)
            moved = self._go(line, like, begun, by.support, goal)
        ended = self.now
        reached = self._away(target) <= rules.hit_radius
        after = moved[:0]
        if reached and not circle and rules.hold > 0.0:
            after = self._go(line, like, begun, by.support, self._until(rules.hold))
        self.rows = np.concatenate((first, waited, moved, after))
        found = measured(self.block.kind, line, self.rows, begun, ended, like.duration)
        return {"reached": float(reached), "time": (ended - shown) * PERIOD, **found}

    def send(self, change: ArmSettings) -> None:
        """Change the patient, as SetArm does. Raises ValueError as `changed_patient`."""
        now = self.state.ticks * PERIOD
        self._patient = changed_patient(self._patient, change, now, self.hand)
        w, arm = self.world, arm_force(self._patient.arm, self._patient.effort)
        self._rig = packed(
            SimulationParams(
                vertical_params(w.vertical, w.friction, w.amplifier, w.transducer, arm, w.substep,
                                w.sensor.bandwidth, w.sensor.hysteresis),
                planar_params(w.planar, arm, w.substep),
                *self._patient.paths, self._patient.arm, self._patient.effort,
            )  # fmt: skip
        )

    def run(self, order: Order, longest: float = _LONGEST) -> np.ndarray:
        """Run an order until its goal is met, or for so many seconds; return the rows.

        Raises NotCompiled for a law that cannot be.
        """
        rows = self._buffer[: round(longest / PERIOD / ROW_TICKS)]
        with compiling(f"law {self.law.name}", *self.law.functions):
            self.state, count = self._run(
                self._packed_robot, self._rig, self._memory, order, self.state, rows
            )
        return rows[:count].copy()

    def _brought(self, origin: Point, support: float) -> bool:
        """Bring the hand to the start, as a session does; return whether it is there."""
        rules, space = self.protocol.rules, self.protocol.space
        rest = round(rules.settle_time / PERIOD)
        for line, like, limit in (
            (Line(self.hand, origin, space), guide_of(self.protocol), rules.prepare_duration),
            (Line(origin, origin, space), pull_of(self.protocol),
             rules.prepare_limit - rules.prepare_duration),
        ):  # fmt: skip
            goal = self._until(limit)._replace(point=origin, radius=rules.hit_radius, rest=rest)
            self.rows = self._go(line, like, self.now, support, goal)
            if self._away(origin) <= rules.hit_radius:
                return True
        return False

    def _round(self, line: Line, like: Slot, begun: int, support: float) -> np.ndarray:
        """Let him go round the circle until he is round, or its time is over; return the rows."""
        (cx, cy, _), step_s = line.start, CIRCLE_STEP_SHARE * self._patient.arm.reach_time
        parts, turned = [], 0.0
        for step in range(1, math.ceil(self.block.duration / step_s) + 1):
            self._send(self._goal(line, step))
            left = self.block.duration - (self.now - begun) * PERIOD
            rows = self._go(line, like, begun, support, self._until(min(step_s, left)))
            angle = np.unwrap(np.arctan2(rows[:, 2] - cy, rows[:, 1] - cx))
            turned += float(angle[-1] - angle[0])
            parts.append(rows)
            if abs(turned) >= 2.0 * math.pi:
                break
        return np.concatenate(parts)

    def _go(
        self, line: Line, like: Slot, begun: int, support: float, goal: Goal
    ) -> np.ndarray:
        """Run until the goal is met; return the rows. begun: of the slots, -1 while open."""
        wish, at = slots(line, like, None), self.protocol.centre[2]
        held = like._replace(
            start_x=at, start_y=0.0, target_x=at, target_y=0.0, half_width=0.0, end_half_width=0.0,
            side_stiffness=self.protocol.rules.hold_stiffness, growth=0.0,
        )  # fmt: skip
        order = Order(
            True, wish.plane or like, wish.vertical or held, begun, begun if wish.vertical else -1,
            float(support), goal, self.now,
        )  # fmt: skip
        return self.run(order)

    def _until(self, seconds: float) -> Goal:
        """Return a goal that time alone meets."""
        x, y, z = (float(axis in AXES[self.protocol.space]) for axis in range(3))
        nowhere = (0.0, 0.0, 0.0)
        limit = round(seconds / PERIOD)
        return Goal(nowhere, nowhere, nowhere, (x, y, z), -1.0, 0, _NEVER, _NEVER, limit)

    def _away(self, point: Point) -> float:
        return distance(self.protocol.space, self.hand, point)

    def _send(self, point: Point) -> None:
        """Send the virtual hand to a point [m], if he follows what he sees."""
        if self._patient.arm.follows > 0.0:
            self.send(ArmSettings(target=point, duration=self._patient.arm.reach_time))

    def _goal(self, line: Line, step: int) -> Point:
        """Return where he goes: to his share of the way, or to a step of the circle, clockwise."""
        if self.block.kind == CIRCLE:
            return on_circle(line.start, line.target, step)
        (a, b, c), (x, y, z), share = line.start, line.target, self._patient.arm.follows
        return a + share * (x - a), b + share * (y - b), c + share * (z - c)


def _unit(line: Line) -> Point:
    """Return the direction of a line on the axes of its space."""
    x, y, z = ((line.target[a] - line.start[a]) / line.length if a in AXES[line.space] else 0.0
               for a in range(3))  # fmt: skip
    return x, y, z


def measured(
    kind: str, line: Line, rows: np.ndarray, begun: int, ended: int, wall_time: float
) -> dict[str, float]:
    """Return the measures of a movement, by the names of `therapy.measures` where it has them.

    rows: from the display of the target; begun, ended: ticks; wall_time: of the back wall [s].
    `assistance`: mean force of slots and support during the movement [N]; `covered`: of a circle,
    the area within the hand's path over its own.
    """
    ticks = np.rint(rows[:, 0] / PERIOD)
    during = rows[(ticks >= begun) & (ticks <= ended)]
    help_ = float(np.mean(np.linalg.norm(during[:, 10:13], axis=1) + np.abs(during[:, 13])))
    if kind == CIRCLE:
        area = hull_area(during[:, 1:3])
        return {"assistance": help_, "covered": area / (math.pi * line.length**2)}
    of: Any = line  # whose functions take three arrays as well as three numbers
    gone = of.gone(during[:, 1:4].T)
    wall = [way((time - begun * PERIOD) / wall_time) for time in during[:, 0]]
    leads = gone - line.length * np.array(wall)
    power = of.along(during[:, 7:10].T) * of.along(during[:, 4:7].T)
    behind = leads < 0.0
    touched = during[behind, 0][0] if behind.any() else during[-1, 0]
    force = of.along(rows[:, 7:10].T)
    resting = force[rows[:, 0] - rows[0, 0] <= RESTING].mean()
    needed = 2.0 * PEAK_SPEED * line.length / EFFORT_TIME**2 * EFFORT_MASS + EFFORT_FRICTION
    return {
        "assistance": help_,
        "pm2a": float(power[behind].mean()) if behind.any() else 0.0,
        "pm2b": float(leads.mean()),
        "pm3": float(of.off(during[:, 1:4].T).mean()),
        "pm4": max(0.0, float(gone.max())),
        "effort": float(force[rows[:, 0] <= touched].mean() - resting) / needed,
    }
