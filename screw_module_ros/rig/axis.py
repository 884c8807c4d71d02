# SPDX-License-Identifier: Apache-2.0
"""What a simulated drive is wired to: one motor and one position feedback of the world."""

from __future__ import annotations

from typing import Protocol

from screw_module_ros.rig.physics import World


class Axis(Protocol):
    """One motor of the plant."""

    def position(self) -> int:
        """Return the position feedback [counts]."""

    def torque(self) -> float:
        """Return the torque that really acts on the rotor [Nm]."""

    def drive(self, torque: float, powered: bool, braked: bool) -> None:
        """Set the motor: torque [Nm] while powered; else coasting, or braking when `braked`."""


class VerticalAxis:
    """The screw's motor behind a current amplifier.

    torque_constant: motor torque per ampere of command [Nm/A].
    """

    def __init__(self, world: World, torque_constant: float):
        self._world = world
        self._amperes = 1.0 / torque_constant

    def position(self) -> int:
        """Return the motor count."""
        return self._world.encoder_count

    def torque(self) -> float:
        """Return the torque on the rotor [Nm]."""
        return self._world.vertical_torque

    def drive(self, torque: float, powered: bool, braked: bool) -> None:
        """Command the amplifier [Nm], or let go of the motor."""
        world = self._world
        world.vertical_command = torque * self._amperes if powered else 0.0
        world.vertical_powered = powered
        world.vertical_braked = braked


class PlanarAxis:
    """One of the two direct drives of the plane; index 0 = shoulder, 1 = elbow."""

    def __init__(self, world: World, index: int):
        self._world = world
        self._index = index

    def position(self) -> int:
        """Return the joint's count."""
        return self._world.planar_counts[self._index]

    def torque(self) -> float:
        """Return the torque of the joint's motor [Nm]."""
        return self._world.planar_torque[self._index]

    def drive(self, torque: float, powered: bool, braked: bool) -> None:
        """Command the motor [Nm], or let go of it."""
        world, index = self._world, self._index
        command = torque if powered else 0.0
        world.planar_command = _with(world.planar_command, index, command)
        world.planar_powered = _with(world.planar_powered, index, powered)
        world.planar_braked = _with(world.planar_braked, index, braked)


def _with(pair: tuple, index: int, value) -> tuple:
    return (value, pair[1]) if index == 0 else (pair[0], value)
