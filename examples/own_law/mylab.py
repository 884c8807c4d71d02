# SPDX-License-Identifier: Apache-2.0
"""A law of a laboratory: a floor that the hand feels, and its force fed back."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

from screw_module_ros.control.law import Law, Variant, feeds, pulls
from screw_module_ros.settings import Setting


class FloorSettings(NamedTuple):
    """Parameters floor.height, floor.stiffness, floor.gain."""

    height: Annotated[float, Setting("height of the floor", "m", 0.0, 0.36, live=True)] = 0.15
    stiffness: Annotated[float, Setting("spring of the floor", "N/m", 0.0, 3e3, live=True)] = 800.0
    gain: Annotated[float, Setting("gain of the hand's force", "", 0.0, 10.0, live=True)] = 1.5


@dataclass(slots=True)
class Memory:
    """seen: the hand's force, filtered [N]; depth: below the floor [m]."""

    seen: float = 0.0
    depth: float = 0.0


def ask(own, m, sample, motion):
    """What shall press on the hand."""
    m.depth = max(0.0, own.height - sample.position)
    return pulls(own.stiffness * m.depth - motion.damping * sample.velocity)


def help_hand(own, m, sample, motion, pressed):
    """What helps the hand against friction and inertia of the module."""
    m.seen += 0.2 * (sample.force - m.seen)
    return feeds(own.gain * (pressed + m.seen), pressed)


def rest(own, m):
    """Forget the motion, while no torque acts."""
    m.seen = m.depth = 0.0


FLOOR = Law("floor", {100: Variant("FLOOR", gains=("gain",), force=True)}, FloorSettings,
            lambda own: Memory(), ask=ask, help=help_hand, rest=rest, shown=("depth",))  # fmt: skip
