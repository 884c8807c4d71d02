# SPDX-License-Identifier: Apache-2.0
"""Rigs drawn by seed: robots of one make and another, and the patients who hold them.

A rig is one of `load_world(seed)`, whose axial support of the screw and whose planar structure are
drawn there. Here encoder, delay, transducer and the patient are drawn as well, wider than between
two modules of one make: a hand of 1 to 5 kg, the weight that hangs on the handle, a tone. Family A
has a rigid hand, family B a hand with a soft grip (`plant.patient`).

What was drawn first is drawn first still, and each addition has a stream of its own: a seed keeps
the values that it had before.
"""

from __future__ import annotations

import functools
import math
import random
from typing import Any, NamedTuple

from ..control.planar_settings import STUDIED_GAIN, PlanarSettings
from ..control.vertical_settings import VerticalSettings
from ..graph import SEPARATE_LATENCY
from ..plant import planar
from ..plant.patient import RIGID, ArmForce, soft_grip
from ..plant.settings import WorldSettings, load_world
from .force_error import with_damping
from .planar_sampled_loop import Plane, largest_gain
from .stability import ENVIRONMENTS
from .stand import LoopSettings
from .trials import Arm, PlaneLoop

FAMILIES = {"A": "rigid hand", "B": "soft grip"}
THESIS_MODULE = {"T": "the thesis's module"}
_COUNTS = (2000, 4000, 8192, 20000)
_LONGEST = 0.9  # longest delay of the plane, as a share of its period: `plane_loop` runs no longer


DELAY, MODULE = "delay", "module"
"""What a law may know of its rig: the delay of the loop; all that a calibration measures."""


class Kind(NamedTuple):
    """What is studied on every rig: a column of the table.

    name: its head; mode: of the vertical axis, in the plane 0 without force feedback; knows: empty,
    `DELAY` or `MODULE`, in the plane what its gain limits say.
    """

    name: str
    mode: int
    knows: str = ""


class Rig(NamedTuple):
    """One robot and its patient; in the plane also where and in which direction he moves it
    [m], [rad].

    hand: the arm that holds the handle, of mass, spring and damper; weight: that hangs on it [N];
    tone: of the flexors, stretched away from the body [Ns/m].
    """

    world: WorldSettings
    loop: Any
    grip: ArmForce
    hand: Arm = Arm()
    weight: float = 10.0
    tone: float = 60.0
    centre: tuple[float, float] = (0.0, 0.0)
    direction: float = 0.0

    @property
    def delay(self) -> float:
        """From a sample to its force at the nut, the amplifier's pole included [s]."""
        amplifier = self.world.amplifier
        lag = 0.5 / (math.pi * amplifier.bandwidth)
        return self.loop.command_delay + amplifier.delay + lag

    def law(self, kind: Kind, asked: VerticalSettings) -> VerticalSettings:
        """Return the settings of the vertical axis with an impedance, as a kind knows the rig."""
        module = self.world.vertical
        if kind.knows:
            asked = asked._replace(observer_delay=self.delay)
        if kind.knows == MODULE:
            mass = module.turning_mass + module.moving_mass
            asked = asked.calibrated(module.moving_mass * module.gravity, mass, self.delay)
        return with_damping(asked, kind.mode)

    def plane_law(self, kind: Kind, asked: PlanarSettings) -> PlanarSettings:
        """Return the settings of the plane with an impedance, as a kind knows the rig.

        One that knows it has the largest gain that is stable with an arm of 30 kg, 9 at most.
        """
        gain = STUDIED_GAIN if kind.mode else 0.0
        if kind.knows:
            gain = min(gain, _borne(self.world.planar, self.loop, asked.damping))
        return asked._replace(force_gain=gain)


@functools.lru_cache(maxsize=256)
def _borne(robot: planar.Planar, loop: PlaneLoop, damping: float) -> float:
    heavy = Plane(robot, ENVIRONMENTS["heavy_arm"][1])
    return largest_gain(heavy, loop, PlanarSettings(damping=damping))


def drawn(family: str, seed: int) -> Rig:
    """Return the rig of a family, of `FAMILIES`, and seed; the same for the same seed."""
    if family in THESIS_MODULE:
        return Rig(load_world(), LoopSettings(rate=1000.0, command_delay=SEPARATE_LATENCY), RIGID)
    draw = random.Random(f"study {family} {seed}")
    world = load_world(perturb_seed=seed)
    if draw.random() < 0.5:  # what earlier versions drew, so that seeds still draw the rest
        draw.random()
    world = world._replace(
        sensor=world.sensor._replace(hysteresis=draw.uniform(0.0, 0.1)),
        start=world.start._replace(counts_per_turn=draw.choice(_COUNTS)),
    )
    loop = LoopSettings(rate=1000.0, command_delay=_between(draw, 0.4e-3, 3e-3))
    return Rig(world, loop, _grip(draw, family), *_patient(family, seed))


def drawn_plane(family: str, seed: int) -> Rig:
    """Return the rig of a family and seed for the plane."""
    draw = random.Random(f"planar study {family} {seed}")
    world = load_world(perturb_seed=seed)
    robot = world.planar._replace(
        friction=world.planar.friction * _between(draw, 0.7, 1.4),
        module_mass=world.planar.module_mass * _between(draw, 0.85, 1.2),
        viscous=world.planar.viscous * _between(draw, 0.5, 2.0),
        bristle_stiffness=world.planar.bristle_stiffness * _between(draw, 0.5, 2.0),
        bandwidth=_between(draw, 300.0, 1000.0),
        inertia=random.Random(f"planar study, inertia {family} {seed}").choice(planar.INERTIAS),
    )
    radian = 2.0 * math.pi / draw.choice((16384, 32768, 65536))
    world = world._replace(planar=robot, start=world.start._replace(joint_resolution=radian))
    rate = draw.choice((250.0, 500.0, 500.0))
    _between(draw, 0.4e-3, 1.8e-3)  # the delay that earlier versions drew
    slow = random.Random(f"planar study, delay {family} {seed}")
    delay = _between(slow, 0.4e-3, min(3e-3, _LONGEST / rate))
    loop = PlaneLoop(rate, delay, _between(draw, 1e-3, 3e-3))
    grip = _grip(draw, family)
    centre = draw.uniform(-0.08, 0.08), draw.uniform(-0.1, 0.1)
    turned = draw.uniform(0.0, math.pi)
    return Rig(world, loop, grip, *_patient(family, seed), centre, turned)


def _patient(family: str, seed: int) -> tuple[Arm, float, float]:
    """Return hand, weight [N] and tone [Ns/m]; the hand's damping ratio is thesis 6.4.3's."""
    draw = random.Random(f"study, patient {family} {seed}")
    mass, stiffness = _between(draw, 1.0, 5.0), _between(draw, 200.0, 500.0)
    usual = Arm()
    damping = usual.damping * math.sqrt(mass * stiffness / (usual.mass * usual.stiffness))
    return Arm(mass, stiffness, damping), draw.uniform(5.0, 20.0), _between(draw, 20.0, 100.0)


def _grip(draw: random.Random, family: str) -> ArmForce:
    grip = soft_grip(_between(draw, 2e3, 2e4), _between(draw, 10.0, 60.0), draw.uniform(0.3, 0.6))
    return grip if family == "B" else RIGID


def _between(draw: random.Random, low: float, high: float) -> float:
    return math.exp(draw.uniform(math.log(low), math.log(high)))
