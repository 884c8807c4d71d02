# SPDX-License-Identifier: Apache-2.0
"""A law of the plane as somebody might write it who knows neither the envelope nor this robot."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from laws_of_others import OddMemory, burn, worked

from screw_module_ros.control.plane_law import Needs, PlaneLaw
from screw_module_ros.settings import Setting

_ANY = (-1e300, 1e300)


class AskedSettings(NamedTuple):
    """What the law does in the next tick; all of it nothing at first."""

    pull_x: Annotated[float, Setting("asked for on the hand", "N", *_ANY, live=True)] = 0.0
    pull_y: Annotated[float, Setting("asked for on the hand", "N", *_ANY, live=True)] = 0.0
    help_x: Annotated[float, Setting("asked for as help", "N", *_ANY, live=True)] = 0.0
    gain: Annotated[float, Setting("of the handle's force", "", *_ANY, live=True)] = 0.0
    damping: Annotated[float, Setting("of its damper", "Ns/m", *_ANY, live=True)] = 10.0
    needed: Annotated[float, Setting("damper it needs", "Ns/m", *_ANY, live=True)] = 0.0
    alternates: Annotated[bool, Setting("changes the sign of pull each tick", live=True)] = False
    raises: Annotated[bool, Setting("raises an error", live=True)] = False
    work: Annotated[float, Setting("processor time it says it took", "ms", *_ANY, live=True)] = 0.0
    busy: Annotated[float, Setting("processor time it takes", "ms", 0.0, 100.0, live=True)] = 0.0


def needs(own, m, sample, stiffness):
    """Need what the settings say."""
    return Needs(own.needed, own.needed, 1.0)


def ask(own, m, sample, motion):
    """Ask for what the settings say."""
    if own.raises:
        raise KeyError("no such muscle")
    burn(own.busy)
    worked.ns += round(own.work * 1e6)
    m.sign, m.ticks = -m.sign if own.alternates else 1.0, m.ticks + 1.0
    return (
        m.sign * own.pull_x - own.damping * sample.vx,
        m.sign * own.pull_y - own.damping * sample.vy,
    )


def helps(own, m, sample, motion, pressed, share):
    """Feed the handle's force back, as the settings say."""
    fed_x, fed_y = pressed[0] + sample.force_x, pressed[1] + sample.force_y
    return own.help_x + own.gain * fed_x, own.gain * fed_y


def rest(own, m):
    """Forget the ticks."""
    m.ticks = 0.0


THE_ASKED = PlaneLaw(
    "asked", AskedSettings, lambda own: OddMemory(), needs, ask, helps, rest, shown=("ticks",)
)
