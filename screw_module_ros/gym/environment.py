# SPDX-License-Identifier: Apache-2.0
"""`TherapyEnv`: a block of a therapy protocol as an environment of gymnasium.

A step is one movement. The action is what a therapist chooses for it, the observation what a
session measures of the one before. What acts on the hand passes the same slots, support, laws and
envelopes as on the robot, with their limits and rates: a policy has no way to a torque.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np

from ..control.law import Law
from ..control.laws.thesis import THESIS
from ..control.modes import FORCE_FEEDBACK
from ..plant.patient import HumanArm, with_traits
from ..plant.settings import arm_of, load_world, perturbed
from ..settings import Setting, fields, shown
from ..therapy.adaptation import AdaptationBounds
from ..therapy.protocol import ways
from ..therapy.protocol_file import load_protocol
from ..therapy.support import BEYOND_WEIGHT, SUPPORT_RANGE
from .course import Carried, Course

TASKS = {
    "height": ("elevator", 2),
    "reach": ("clock_adaptive", 2),
    "circle": ("evaluation", 2),
    "lift": ("lift", 1),
    "lift_circle": ("lift", 2),
    "space": ("reach_3d", 2),
}
"""A protocol and the number of its block, by the name of the task."""
PRICE = 0.02
"""[1/N] ours: what a newton of assistance costs of a reached target."""
_BOUNDS, _OF_ARM = AdaptationBounds(), fields(HumanArm)

ACTIONS = {
    "support": Setting("of the arm's weight, up positive", "N", *SUPPORT_RANGE),
    "side_stiffness": Setting("of the side walls", "N/m", _BOUNDS.softest, _BOUNDS.stiffest),
    "duration": Setting("of the back wall's way", "s", _BOUNDS.shortest, _BOUNDS.longest),
}
"""An action's numbers, in order: those of a therapist, within the bounds of the adaptation."""
OBSERVATIONS = {
    "reached": Setting("the last target was reached", "", 0.0, 1.0),
    "time": Setting("from its display to its end", "s", 0.0, 200.0),
    "assistance": Setting("mean force of slots and support meanwhile", "N", 0.0, 100.0),
    "pm2a": Setting("power while behind the wall", "W", -50.0, 50.0),
    "pm2b": Setting("lead over the wall", "m", -1.0, 1.0),
    "pm3": Setting("mean square off the line", "m²", 0.0, 1.0),
    "pm4": Setting("way along the line", "m", 0.0, 1.0),
    "effort": Setting("of the patient, over what the way needs", "", -20.0, 20.0),
    "covered": Setting("of a circle, the share of its area", "", 0.0, 4.0),
    **ACTIONS,
    "weight": Setting("of the arm, as weighed", "N", 0.0, 60.0),
    "to_x": Setting("to the next target", "m", -1.0, 1.0),
    "to_y": Setting("to the next target", "m", -1.0, 1.0),
    "to_z": Setting("to the next target", "m", -1.0, 1.0),
    "left": Setting("share of the episode that is left", "", 0.0, 1.0),
}
"""An observation's numbers, in order; zero where the task has no such measure, and at first."""


def _box(of: Mapping[str, Setting]) -> gymnasium.spaces.Box:
    low, high = ([getattr(one, end) for one in of.values()] for end in ("low", "high"))
    return gymnasium.spaces.Box(np.array(low), np.array(high), dtype=np.float64)


class TherapyEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A block of a protocol with a simulated patient; a step is one movement.

    action_space: `ACTIONS`; observation_space: `OBSERVATIONS`. An action beyond its range counts as
    its end, and support as `BEYOND_WEIGHT` more than the arm weighs at most. The reward of a reach
    is 1 where the target was reached, of a circle `covered`, at most 1, less `price` for each
    newton of assistance. An episode is terminated after the block's last movement, and truncated
    where the hand came to no start, with which a session pauses. `info` has the measures, the
    circuit, the patient and his arm. course: of this episode, with the samples of the last
    movement.
    """

    action_space: gymnasium.spaces.Box
    observation_space: gymnasium.spaces.Box
    metadata = {"render_modes": []}

    def __init__(
        self,
        task: str = "reach",
        patients: Sequence[str] = ("weak",),
        traits: Mapping[str, float] | None = None,
        spread: float = 0.0,
        rigs: bool = False,
        circuits: int = 0,
        price: float = PRICE,
        law: Law = THESIS,
        mode: int = FORCE_FEEDBACK,
        render_mode: None = None,
    ):
        """patients: one is drawn for an episode; traits: other values of `TRAITS`; spread: each of
        his strength, stiffness, reach_time and weight is drawn within a factor of e^spread. rigs:
        another rig is drawn for each episode (`plant.settings.perturbed`). circuits: of an episode,
        0 = as the block. law, mode: of the vertical axis.

        Raises ValueError for an unknown task, patient or trait.
        """
        if task not in TASKS:
            raise ValueError(f"task = {shown(task)}: one of {', '.join(TASKS)} is wanted")
        protocol, block = TASKS[task]
        self.protocol = load_protocol(protocol)
        self.block = self.protocol.blocks[block - 1]
        self.ways = ways(self.protocol, self.block)
        self.movements = len(self.ways) * (circuits or self.block.circuits)
        self._patients, self._traits = tuple(patients), dict(traits or {})
        for name in patients:
            self._arm_of(name)
        self._spread, self._rigs, self._price = spread, rigs, price
        self._world, self._law, self._mode = load_world(), law, mode
        self.action_space, self.observation_space = _box(ACTIONS), _box(OBSERVATIONS)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode: seed draws patient, rig and noise; options: `patient`, by name."""
        super().reset(seed=seed)
        draw = self.np_random
        drawn = self._patients[int(draw.integers(len(self._patients)))]
        self.patient = str((options or {}).get("patient", drawn))
        self.arm = self._drawn(self._arm_of(self.patient), draw)
        world, number = self._world, int(draw.integers(2**31))
        if self._rigs:
            world = perturbed(world, number)
        self.course = Course(
            self.protocol, self.block, self.arm, world, number, self._law, self._mode
        )
        self._done = 0
        return self._observed({}), self._told({})

    def step(
        self, action: np.ndarray
    ) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Let the patient do one movement with this assistance."""
        low, high = self.action_space.low, self.action_space.high
        support, side, duration = np.clip(action, low, high).tolist()
        support = min(support, self.arm.weight + BEYOND_WEIGHT)
        by = Carried(duration, side, support)
        found = self.course.move(*self._way(), by)
        if found is None:
            return self._observed({}), 0.0, False, True, self._told({})
        reward = min(found.get("covered", found["reached"]), 1.0)
        reward -= self._price * found["assistance"]
        told = self._told({**found, **by._asdict()})
        self._done += 1
        return self._observed(told), reward, self._done == self.movements, False, told

    def _arm_of(self, patient: str) -> HumanArm:
        return with_traits(arm_of(patient), [*self._traits], [*self._traits.values()])

    def _drawn(self, arm: HumanArm, draw: np.random.Generator) -> HumanArm:
        """Return the arm with other traits, within their ranges."""
        for name in ("strength", "reach_time", "weight", "stiffness"):
            value = getattr(arm, name) * math.exp(draw.uniform(-self._spread, self._spread))
            setting = _OF_ARM[name].setting
            arm = arm._replace(**{name: min(max(value, setting.low), setting.high)})
        return arm

    def _way(self) -> tuple[Any, Any]:
        return self.ways[self._done % len(self.ways)]

    def _told(self, found: dict[str, float]) -> dict[str, Any]:
        circuit = self._done // len(self.ways) + 1
        return {**found, "circuit": circuit, "patient": self.patient, "arm": self.arm}

    def _observed(self, found: Mapping[str, Any]) -> np.ndarray:
        """Return the observation after a movement with these measures."""
        start, target = self._way()
        to = dict(zip(("to_x", "to_y", "to_z"), np.subtract(target, start), strict=True))
        left = 1.0 - self._done / self.movements
        known = {**found, **to, "weight": self.arm.weight, "left": left}
        space = self.observation_space
        values = [known.get(name, 0.0) for name in OBSERVATIONS]
        return np.clip(np.array(values), space.low, space.high)
