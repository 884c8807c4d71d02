# SPDX-License-Identifier: Apache-2.0
"""Simulated patients at the slot law: the plant's arm, a mass at the handle, a session in the loop.

A `Person` has reaches that vary; `person` makes one of a patient of `params/patients.yaml`.

The patient sees the target when it is shown, reacts, and moves the virtual hand of `plant.patient`
there on a bowed minimum-jerk way of his own duration. Nothing here is tuned to the metrics.
"""

from __future__ import annotations

import math
import random
from pathlib import Path
from typing import NamedTuple

from screw_module_ros.control.slot import (
    OPEN,
    Slot,
    SlotInput,
    SlotLimits,
    initial_state,
    slot_step,
)
from screw_module_ros.plant.muscles import RESTED, muscles_step, pull
from screw_module_ros.plant.patient import (
    KINDS,
    ArmSettings,
    HumanArm,
    Patient,
    arm_force,
    changed_patient,
    hand_point,
    on_circle,
    resting_patient,
    spring_terms,
)
from screw_module_ros.plant.settings import patients
from screw_module_ros.therapy.hand import PLANE, HandSample
from screw_module_ros.therapy.protocol import CIRCLE, Protocol
from screw_module_ros.therapy.recorded import Act, Recorded
from screw_module_ros.therapy.session import Session, State
from screw_module_ros.therapy.support import Carried
from screw_module_ros.therapy.trial import Phase

STEP_NS = 2_500_000
STEP = STEP_NS * 1e-9
EVERY = 2  # steps a sample: 200 Hz
ROBOT_MASS = 1.5  # [kg] the bare plane at the handle (appendix D specifies at most 4/3 kg), grip
FRICTION_SPEED = 0.005  # [m/s] where the robot's friction is full
LIMITS = SlotLimits()
NO_SLOT = Slot()


class Person(NamedTuple):
    """arm: its traits; duration: of a reach [s]; spread: of durations, 1 sigma as a share.

    bow: 1 sigma of the way's bow [m]; reaction [s]; reach: share of the way the person comes.
    """

    arm: HumanArm
    duration: float
    spread: float = 0.1
    bow: float = 0.004
    reaction: float = 0.25
    reach: float = 1.0


# Mass and stiffness are the thesis's (6.4.3); its 5 Ns/m would swing twice on each reach.
ARM = HumanArm(3.0, 300.0, 30.0, weight=20.0, carried=1.0, follows=0.0, reach_time=1.0)
HEALTHY = Person(ARM, 0.8)
SHAKING = Person(ARM._replace(**KINDS["tremor"]), 0.8)
FEEBLE = Person(ARM._replace(**KINDS["weak"]), 2.6, spread=0.2, bow=0.015, reaction=0.4, reach=0.8)


def person(name: str) -> Person:
    """Return the patient of `params/patients.yaml`; his own reaction is a trait of his arm."""
    arm = patients()[name]
    return Person(arm, arm.reach_time, bow=0.004, reaction=0.0, reach=arm.follows)


class Robot(NamedTuple):
    """mass at the handle [kg]; friction [N]; hold: of an axis that the protocol does not use [N/m];
    support: upward on the hand [N], in a block that asks for none."""

    mass: float = ROBOT_MASS
    friction: float = 0.0
    hold: float = 0.0
    support: float = 0.0


BARE = Robot()
MANUS = Robot(mass=6.5, friction=0.8, hold=800.0)
"""About what the rig's plane is to a hand: module and arm, joint friction (params/plant.yaml)."""


class Simulation:
    """A person at the robot; `step` moves both by 2.5 ms, `sample` is what endpoint_state tells.

    pull: of the person's muscles on the hand, whatever he wants [N].
    """

    pull = (0.0, 0.0, 0.0)

    def __init__(self, session: Session, person: Person, seed: int, robot: Robot = BARE):
        self.session = session
        self.person = person
        self.chance = random.Random(f"patient {seed}")
        self.robot = robot
        if session.protocol.blocks[0].support is None:  # it leaves the support as it is
            session.carried = Carried(None, session.carried.weight, robot.support)
        x, y, z = session.protocol.centre
        self.muscles, self.height = RESTED, z
        self._have(resting_patient(person.arm, x, y, z))
        self.position, self.velocity = [x, y, z], [0.0, 0.0, 0.0]
        self.handle = [0.0, 0.0, 0.0]
        self.now_ns, self.count = 0, 0
        self.clock_set_ns = 0  # by how much the system clock was set, whose stamps samples have
        self.slots = (initial_state(), initial_state())
        self.shown = self.begin = self.bow = None
        self.turned, self.onwards = 0, math.inf  # on a circle: points so far, time of the next [s]

    def _have(self, patient: Patient) -> None:
        self.patient = patient
        self.arm = arm_force(patient.arm, patient.effort)

    @property
    def now(self) -> float:
        return self.now_ns * 1e-9

    def sample(self) -> HandSample:
        return HandSample(
            1000 + self.count // EVERY, self.now_ns, *self.position, *self.velocity, *self.handle,
            stamp_ns=self.now_ns + self.clock_set_ns,
        )  # fmt: skip

    def look(self) -> None:
        """See what the screen shows, and plan the way there."""
        trial = self.session.trial
        if trial is None:
            return
        seen = (trial.plan.number, trial.phase == Phase.PREPARE)
        if seen == self.shown and not self.now >= self.onwards:
            return
        if seen != self.shown:
            self.turned, self.onwards = 0, math.inf
        self.shown = seen
        if trial.phase == Phase.PREPARE:
            self.go(trial.origin, 1.5, 0.0, 1.0)
        elif trial.kind == CIRCLE:
            self.turned += 1
            self.onwards = self.now + 0.5 * self.person.duration
            point = on_circle(trial.plan.start, trial.plan.target, self.turned)
            self.go(point, self.person.duration, 0.0, 1.0)
        else:
            duration = self.person.duration * math.exp(
                self.person.spread * self.chance.gauss(0.0, 1.0)
            )
            bow = self.person.bow * self.chance.gauss(0.0, 1.0)
            self.go(trial.plan.target, duration, bow, self.person.reach)

    def go(self, target, duration, bow, reach) -> None:
        """Send the virtual hand on its way."""
        if self.person.reach == 0.0:
            return
        way = [t - p for t, p in zip(target, self.position, strict=True)]
        end = tuple(p + reach * w for p, w in zip(self.position, way, strict=True))
        begin = self.now + (self.person.reaction if bow else 0.0)
        asked = ArmSettings(target=end, duration=duration)
        self._have(changed_patient(self.patient, asked, begin, self.position))
        begin = self.patient.paths[0].begin
        length = math.hypot(way[0], way[1]) or 1.0
        self.bow = (begin, duration, -bow * way[1] / length, bow * way[0] / length)

    def _virtual_hand(self) -> list[tuple[float, float]]:
        hand = [hand_point(path, self.now) for path in self.patient.paths]
        if self.bow is not None:
            begin, duration, aside_x, aside_y = self.bow
            share = (self.now - begin) / duration
            if 0.0 < share < 1.0:
                size = math.sin(math.pi * share)
                hand[0] = (hand[0][0] + aside_x * size, hand[0][1])
                hand[1] = (hand[1][0] + aside_y * size, hand[1][1])
        return hand

    def step(self) -> None:
        robot = self._robot()
        virtual = self._virtual_hand()
        traits, effort = self.patient.arm, self.patient.effort
        away, load, vigour = pull(traits, effort, self.muscles, virtual[1][0])
        beside = 0.0, away, -(self.arm.weight + load)
        mass = self.robot.mass + self.arm.mass
        drag = self.robot.friction / max(math.hypot(*self.velocity), FRICTION_SPEED)
        for axis, (hand, hand_velocity) in enumerate(virtual):
            stiffness, damping, steady = spring_terms(
                self.arm, hand, hand_velocity, self.position[axis], self.velocity[axis],
                vigour, self.arm.extension if axis else 1.0,
            )  # fmt: skip
            steady += beside[axis]
            # Implicit in the arm's own spring and damper, as the plant is.
            own = (
                steady
                + self.pull[axis]
                + stiffness * (hand - self.position[axis])
                + damping * hand_velocity
            )
            before = self.velocity[axis]
            after = (before + STEP / mass * (own + robot[axis])) / (
                1.0 + STEP / mass * (damping + drag + STEP * stiffness)
            )
            self.velocity[axis] = after
            self.position[axis] += STEP * after
            self.handle[axis] = (
                self.robot.mass * (after - before) / STEP + drag * after - robot[axis]
            )
        self.muscles = muscles_step(
            traits, effort, self.muscles, *self.handle, self.velocity[1], STEP
        )
        self.count += 1
        self.now_ns += STEP_NS

    def _passed(self, since_ns: int) -> float:
        return (self.now_ns - since_ns) * 1e-9

    def _robot(self) -> tuple[float, float, float]:
        """Return the slots' forces on the hand [N]."""
        wish, (x, y, z), (vx, vy, vz) = self.session.wish, self.position, self.velocity
        since = OPEN if wish.start_ns is None else self._passed(wish.start_ns)
        plane, vertical = wish.plane, wish.vertical
        plane_out, plane_state = slot_step(
            LIMITS,
            self.slots[0],
            SlotInput(x, y, vx, vy, plane is not None, plane or NO_SLOT, since),
            STEP,
        )
        rise, machine = z - self.height, self.robot
        height = self.session.carried.force
        if machine.hold and self.session.protocol.space == PLANE:
            height -= machine.hold * rise + 2.0 * math.sqrt(machine.hold * machine.mass) * vz
        height_state = self.slots[1]
        if vertical is not None or height_state.weight > 0.0:
            out, height_state = slot_step(
                LIMITS,
                height_state,
                SlotInput(z, 0.0, vz, 0.0, vertical is not None, vertical or NO_SLOT, since),
                STEP,
            )
            height += out.force_x
        self.slots = plane_state, height_state
        return plane_out.force_x, plane_out.force_y, height

    def run(self, longest: float = 1e9) -> list[HandSample]:
        """Go on until the session stops, `longest` [s] at most; return the samples it was given."""
        samples, until = [], self.now + longest
        while self.session.state == State.RUNNING and self.now < until:
            if self.count % EVERY == 0:
                sample = self.sample()
                samples.append(sample)
                self.session.take(sample)
                self.look()
            self.step()
        return samples



def recorded(person: Person, protocol: Protocol, seed: int, day: int = 0) -> Recorded:
    """Return a session of a simulated patient as a bag would tell it. day: after 2026-01-05."""
    session = Session(protocol)
    simulation = Simulation(session, person, seed)
    simulation.now_ns = (1_767_600_000 + 86_400 * day) * 1_000_000_000
    samples = simulation.run()
    changes = [change.row(2) for change in session.changes]
    acts = [Act(0, State.RUNNING, ""), Act(samples[-1].sequence, session.state, session.reason)]
    return Recorded(Path("bag"), "P-7K3QX", protocol, acts, session.results, changes, samples)


def short(protocol: Protocol, count: int = 2, **changes) -> Protocol:
    """Return the first two blocks of a protocol, one round of `count` targets each."""
    blocks = tuple(
        block._replace(circuits=1, targets=block.targets._replace(count=count, rounds=1))
        for block in protocol.blocks[:2]
    )
    return protocol._replace(blocks=blocks, **changes)


def brief(protocol: Protocol, duration: float, count: int) -> Protocol:
    """Return all blocks of a protocol, of one circuit; duration [s], count of targets: the most."""
    blocks = tuple(
        block._replace(
            circuits=1,
            duration=min(block.duration, duration),
            targets=block.targets._replace(count=min(block.targets.count, count)),
        )
        for block in protocol.blocks
    )
    return protocol._replace(blocks=blocks)
