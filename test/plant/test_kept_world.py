# SPDX-License-Identifier: Apache-2.0
"""The rig's physics over a script of fixtures, arms, power and commands: nothing may change.

The plain functions run, not their compiled twins. Nine digits of every true value and of the
measured wrench are kept. A change on purpose is renewed with
`make test ARGS="test/plant/test_kept_world.py --write"`; the commit says what changed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import pytest

from screw_module_ros.plant.world import ArmSettings, World

STROKE = ArmSettings(
    kind="active", target=(0.05, -0.04, 0.2), duration=0.05, amplitude=(0.05, 0.04, 0.08),
    omega=(9.0, 7.0, 11.0),
)  # fmt: skip


def digits(value: object) -> str:
    if isinstance(value, tuple):
        return " ".join(map(digits, value))
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def digest(world: World, parts: int = 12, dt: float = 0.005) -> str:
    """Advance in parts, and return the digest of all that can be seen after each."""
    lines = []
    for _ in range(parts):
        world.advance(dt)
        seen = *world.truth(), world.wrench(), world.encoder_count, world.planar_counts
        lines.append(digits(seen))
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def command(world: World, current: float, shoulder: float, elbow: float) -> None:
    world.vertical_command, world.planar_command = current, (shoulder, elbow)


def script(world: World) -> Iterator[str]:
    yield "at rest"
    world.vertical_powered, world.planar_powered = True, (True, True)
    command(world, 2.0, 1.5, -1.0)
    yield "pushed up"
    command(world, -3.0, -2.0, 2.0)
    yield "pushed down"
    world.set_arm(STROKE)
    yield "in a moving hand"
    yield "and on"
    world.set_arm(STROKE._replace(kind="relaxed"))
    command(world, 0.05, 0.0, 0.0)
    yield "in a relaxed hand, within the dead zone"
    world.vertical_powered, world.planar_powered = False, (False, True)
    world.vertical_braked, world.planar_braked = True, (True, False)
    yield "braked"
    world.set_fixture("stage", speed=0.05)
    yield "driven by the stage"
    world.set_fixture("stage", speed=-0.15, position=world.truth().handle_position + 0.001)
    yield "placed, then driven down"
    world.vertical_braked, world.vertical_powered = False, True
    command(world, 4.0, 3.0, 3.0)
    world.set_fixture("free")
    yield "free"
    world.set_fixture("free", upside_down=True)
    yield "upside down"
    world.set_fixture("free", locked=True)
    yield "with the pin in"
    world.set_fixture("locked_rotor")
    yield "with a locked rotor"
    world.set_fixture("human_arm", position=0.2)
    yield "in the hand again"
    world.place(0.002)
    command(world, -6.0, 5.0, 5.0)
    yield "at the lower stop"
    world.place(world.settings.vertical.travel - 0.002)
    command(world, 6.0, -5.0, -5.0)
    yield "at the upper stop"


@pytest.mark.parametrize("seed", [0, 1])
def test_the_world_moves_as_it_did(settings, seed, kept):
    world = World(settings, seed, compile=False)
    kept({name: digest(world) for name in script(world)})
