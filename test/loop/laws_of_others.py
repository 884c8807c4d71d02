# SPDX-License-Identifier: Apache-2.0
"""Laws as somebody might write them who knows neither the envelope nor this robot."""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass
from typing import Annotated, NamedTuple

from screw_module_ros.control.law import Law, Motion, Sample, Variant, feeds, pulls
from screw_module_ros.settings import Setting

ODD, FLOOR = 100, 150
"""Modes."""
_ANY = (-1e300, 1e300)


class OddSettings(NamedTuple):
    """What the odd law does in the next tick; all of it nothing at first."""

    pull: Annotated[float, Setting("asked for on the hand", "N", *_ANY, live=True)] = 0.0
    helping: Annotated[float, Setting("asked for as help", "N", *_ANY, live=True)] = 0.0
    foreseen: Annotated[float, Setting("fed forward", "N", *_ANY, live=True)] = 0.0
    gain: Annotated[float, Setting("of the handle's force", "", *_ANY, live=True)] = 0.0
    damping: Annotated[float, Setting("of its damper", "Ns/m", *_ANY, live=True)] = 5.0
    alternates: Annotated[bool, Setting("changes the sign of pull each tick", live=True)] = False
    nan: Annotated[bool, Setting("asks for no number", live=True)] = False
    raises: Annotated[bool, Setting("raises an error", live=True)] = False
    exits: Annotated[bool, Setting("would end the process at rest", live=True)] = False
    work: Annotated[float, Setting("processor time it says it took", "ms", *_ANY, live=True)] = 0.0
    busy: Annotated[float, Setting("processor time it takes", "ms", 0.0, 100.0, live=True)] = 0.0


@dataclass(slots=True)
class OddMemory:
    """sign: of the next pull; ticks: since the last rest."""

    sign: float = 1.0
    ticks: float = 0.0


def ask(own, m, sample: Sample, motion: Motion):
    """Ask for what the settings say."""
    if own.raises:
        raise KeyError("no such muscle")
    if own.nan:
        return pulls(math.nan)
    burn(own.busy)
    worked.ns += round(own.work * 1e6)
    m.sign, m.ticks = -m.sign if own.alternates else 1.0, m.ticks + 1.0
    return pulls(m.sign * own.pull - own.damping * sample.velocity)


def helps(own, m, sample: Sample, motion: Motion, pressed: float):
    """Feed the handle's force back, as the settings say."""
    return feeds(own.helping + own.gain * (pressed + sample.handle), pressed)


def foresee(own, m, sample: Sample) -> float:
    """Feed forward what the settings say."""
    return own.foreseen


def rest(own, m) -> None:
    """Forget the ticks."""
    if own.exits:
        sys.exit("no such\nmuscle \ud800")
    burn(own.busy)
    m.ticks = 0.0


def burn(milliseconds: float) -> None:
    """Use so much processor time."""
    end = time.thread_time() + 1e-3 * milliseconds
    while time.thread_time() < end:
        pass


class Worked:
    """Processor time that the laws say they have used [ns]."""

    def __init__(self):
        self.ns = 0

    def __call__(self) -> int:
        return self.ns


worked = Worked()
THE_ODD = Law(
    "odd", {ODD: Variant("ODD", ("gain",), force=True)}, OddSettings, lambda own: OddMemory(),
    foresee, ask, helps, rest, shown=("ticks",),
)  # fmt: skip


TABLE = {0: 0.5}
"""Gains, as nobody should keep them who wants his law compiled."""


def looked_up(own, m, sample: Sample, motion: Motion):
    """Ask for a force from a table: plain Python alone can."""
    return pulls(TABLE[0] * own.pull)


THE_LOOKED_UP = Law("looked_up", {160: Variant("LOOKED_UP", ("gain",))}, OddSettings, ask=looked_up)


class FloorSettings(NamedTuple):
    """A virtual floor."""

    height: Annotated[float, Setting("of the floor", "m", 0.0, 0.36, live=True)] = 0.15
    stiffness: Annotated[float, Setting("of the floor", "N/m", 0.0, 3000.0, live=True)] = 800.0
    gain: Annotated[float, Setting("force gain", "", 0.0, 10.0, live=True)] = 3.0


def floor_ask(own, m, sample: Sample, motion: Motion):
    """Ask for the floor's spring, and for the robot's damper."""
    depth = max(0.0, own.height - sample.position)
    return pulls(own.stiffness * depth - motion.damping * sample.velocity)


def floor_helps(own, m, sample: Sample, motion: Motion, pressed: float):
    """Feed the handle's force back."""
    return feeds(own.gain * (pressed + sample.handle), pressed)


THE_FLOOR = Law(
    "floor", {FLOOR: Variant("FLOOR", ("gain",), force=True)}, FloorSettings, ask=floor_ask,
    help=floor_helps,
)  # fmt: skip
