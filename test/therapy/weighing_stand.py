# SPDX-License-Identifier: Apache-2.0
"""An arm on the module, weighed: law, slot and plant in one compiled loop, 5 ms at a time.

The plane goes where its slot leads; what it feels of the arm is given.
"""

from __future__ import annotations

import math
import random
from typing import NamedTuple

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.compiled import compiled, packed
from screw_module_ros.control.envelope import enveloped, initial_state
from screw_module_ros.control.laws.thesis import THESIS, Own
from screw_module_ros.control.limits import slew
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.minimum_jerk import way
from screw_module_ros.control.modes import FORCE_FEEDBACK, OBSERVER
from screw_module_ros.control.slot import OPEN, Slot, SlotInput, SlotLimits, slot_step
from screw_module_ros.control.slot import initial_state as no_slot
from screw_module_ros.control.torque_chain import COLD, TorqueChain, commanded, on_the_wire
from screw_module_ros.control.vertical import VerticalInput
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.filters import VelocityState, lowpass_coefficients, velocity_step
from screw_module_ros.geometry import SCREW, counts_to_height
from screw_module_ros.plant.amplifier import bridge_current
from screw_module_ros.plant.module import HUMAN_ARM, ModuleInput, resting_state, vertical_params
from screw_module_ros.plant.patient import (
    ArmForce,
    HumanArm,
    arm_force,
    hand_point,
    resting_patient,
)
from screw_module_ros.plant.settings import WorldSettings
from screw_module_ros.plant.vertical import vertical_step as module_step
from screw_module_ros.therapy.hand import HandSample
from screw_module_ros.therapy.weighing import Weighing, places
from screw_module_ros.therapy.wishes import WishLimits

SUBSTEP, PERIOD, TICKS = 50e-6, 1e-3, 5
LATE = 12  # substeps until a command acts
LYING = 0.05  # [m] where the arm is strapped in
MIDDLE = 0.18  # [m]
NO_SLOT = Slot()
NOBODY = ArmForce(0.0, 0.0, 0.0, math.inf, 0.0)
vertical_step = enveloped(THESIS)


class State(NamedTuple):
    """Module, slot, filter of the velocity, heat of the motor [Nm^2], current of the bridge [A]."""

    module: object
    slotted: object
    motion: VelocityState
    heat: float
    current: float


def ticks(law, own, memory, limits, plant, amplifier, chain, smooth, state, mode, slot, present,
          since, rest, support, path, now):  # fmt: skip
    """Run 5 ms and return the state; since: the slot's time [s], now: the arm's time [s]."""
    module, slotted, motion, heat, current = state
    for tick in range(TICKS):
        position = counts_to_height(math.floor(module.nut / SCREW.lead * 20000.0))
        velocity, motion = velocity_step(smooth, motion, position, PERIOD)
        passed = since + tick * PERIOD
        wanted = SlotInput(position, 0.0, velocity, 0.0, present, slot, passed)
        guided, slotted = slot_step(limits[0], slotted, wanted, PERIOD)
        inp = VerticalInput(
            mode, position, velocity, module.shown_force, rest, 0.0, True,
            guided.force_x, guided.weight, support,
        )  # fmt: skip
        output = vertical_step(law[0], own[0], memory[0], inp, PERIOD)
        made, heat = commanded(chain[0], heat, output.force, 1.0, PERIOD)
        torque = on_the_wire(chain[0], made.command)
        hand, hand_velocity = hand_point(path, now + tick * PERIOD)
        for step in range(20):
            if step == LATE:
                current = bridge_current(amplifier[0], torque / plant[0].torque_constant)
            u = ModuleInput(
                current, True, False, HUMAN_ARM, False, 1.0, hand, hand_velocity, 0.0, 0.0, 0.0,
                0.0, 1.0,
            )  # fmt: skip
            module = module_step(plant[0], module, u)
    return State(module, slotted, motion, heat, current)


class Stand:
    """One robot and the arm that is weighed on it.

    hung: what hung on the handle at the places [N], as the plant knows it; told: all sentences.
    """

    def __init__(self, world: WorldSettings, arm: HumanArm, mode: int, seed: int = 0, aside=0.0,
                 most=25.0):  # fmt: skip
        """aside: force of the arm to the left [N]; most: support that the robot gives [N].

        The arm's virtual hand rests in the middle.
        """
        damping = 20.0 if mode == OBSERVER else 5.0
        law = VerticalSettings(stiffness=100.0, damping=damping, force_gain=5.0).validated()
        own = Own(law, thesis_friction())
        self.world, self.mode, self.aside, self.most = world, mode, aside, most
        self.draw = random.Random(seed)
        self.zero = self.draw.uniform(-0.5, 0.5)  # [N] drifted since the tare
        self.drift = self.draw.uniform(-0.3, 0.3)  # [N] in 15 min
        self.arm = arm_force(arm)
        self.path = resting_patient(arm, 0.0, 0.0, MIDDLE).paths[2]
        self.given = (
            packed(law), packed(own), packed(initial_state(law, THESIS, own)), packed(SlotLimits())
        )
        self.rest = (
            packed(world.amplifier), packed(TorqueChain(linearization=default_linearization())),
            lowpass_coefficients(30.0, PERIOD),
        )
        position = counts_to_height(math.floor(LYING / SCREW.lead * 20000.0))
        self.state = State(resting_state(world.vertical, LYING, 1.0), no_slot(),
                           VelocityState(position, 0.0, 0.0), COLD, 0.0)  # fmt: skip
        self.weighing = Weighing(places(WishLimits().ranges()))
        self.count, self.held, self.y, self.support = 0, NOBODY, -0.1, 0.0
        self.rest_at = LYING
        self.hung: list[float] = []
        self.told: list[str] = []

    @property
    def now(self) -> float:
        return self.count * TICKS * PERIOD

    def run(self, until=lambda weighing: False, longest=90.0) -> Weighing:
        """Weigh until it is over, until a condition, or for a time [s]."""
        end = self.now + longest
        while self.weighing.is_on and not until(self.weighing) and self.now < end:
            self.step()
        return self.weighing

    def strap_in(self) -> None:
        """Strap the arm in, which rests on the handle from now on, and press the button."""
        self.held = self.arm
        self.weighing.press()

    def step(self) -> None:
        """Advance by 5 ms."""
        plant = vertical_params(
            self.world.vertical, self.world.friction, self.world.amplifier, self.world.transducer,
            self.held, SUBSTEP, self.world.sensor.bandwidth, self.world.sensor.hysteresis,
        )  # fmt: skip
        asked = min(self.weighing.support, self.most)
        self.support = slew(self.support, asked, 10.0 * TICKS * PERIOD)
        wish = self.weighing.wish
        slot = wish.vertical or NO_SLOT
        since = OPEN if wish.start_ns is None else self.now - wish.start_ns * 1e-9
        self.state = compiled(ticks)(
            *self.given, packed(plant), *self.rest, self.state, self.mode, slot,
            wish.vertical is not None, since, self.rest_at, self.support, self.path, self.now,
        )  # fmt: skip
        if wish.plane is not None:
            share = way(since / wish.plane.duration)
            self.y = wish.plane.start_y + share * (wish.plane.target_y - wish.plane.start_y)
        self.count += 1
        places_done = len(self.told)
        self.weighing.take(self.sample())
        if self.weighing.wish != wish:
            self.rest_at = self.state.module.handle  # the node moves the set point to the hand
        if self.weighing.told not in self.told:
            self.told.append(self.weighing.told)
        if "let it hang: " in self.weighing.told and len(self.told) == places_done:
            self.hung.append(-self.state.module.patient_force)

    def sample(self) -> HandSample:
        module = self.state.module
        noise = [self.draw.gauss(0.0, self.world.sensor.force_noise) for _ in range(3)]
        zero = self.zero + self.drift * self.now / 900.0
        aside = self.aside if self.held is not NOBODY else 0.0
        force = module.shown_force + zero + noise[2]
        return HandSample(
            self.count, round(self.now * 1e9), 0.0, self.y, module.handle, 0.0, 0.0,
            module.handle_velocity, noise[0] - aside, noise[1], force,
        )  # fmt: skip


def weighed(world: WorldSettings, arm: HumanArm, mode: int = FORCE_FEEDBACK, **more) -> Stand:
    """Return the stand after the whole dialogue."""
    stand = Stand(world, arm, mode, **more)
    stand.run(lambda weighing: weighing.told.startswith("strap"))
    stand.strap_in()
    stand.run()
    return stand


def loose(weight: float, spring: float = 0.0) -> HumanArm:
    """Return an arm that hangs; spring: its own towards the middle [N/m]."""
    return HumanArm(0.1 * weight, spring, 10.0, weight, 0.0, 0.0, 1.1)
