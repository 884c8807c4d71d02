# SPDX-License-Identifier: Apache-2.0
"""The connection of a simulated drive to the world: one motor and one position feedback."""

from __future__ import annotations

from typing import Protocol

from screw_module_ros.rig.physics import Physics


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

    def __init__(self, physics: Physics, torque_constant: float):
        self._physics = physics
        self._world = physics.world
        self._amperes = 1.0 / torque_constant
        self._driven = (0.0, False, False)

    def position(self) -> int:
        """Return the motor count."""
        return self._world.encoder_count

    def torque(self) -> float:
        """Return the torque on the rotor [Nm]."""
        return self._world.vertical_torque

    def drive(self, torque: float, powered: bool, braked: bool) -> None:
        """Command the amplifier [Nm], or release the motor."""
        driven = (torque * self._amperes if powered else 0.0, powered, braked)
        if driven != self._driven:
            self._driven = driven
            self._physics.act(lambda: self._set(*driven))

    def _set(self, amperes: float, powered: bool, braked: bool) -> None:
        world = self._world
        world.vertical_command = amperes
        world.vertical_powered = powered
        world.vertical_braked = braked


class PlanarAxis:
    """One of the two direct drives of the plane; index 0 = shoulder, 1 = elbow."""

    def __init__(self, physics: Physics, index: int):
        self._physics = physics
        self._world = physics.world
        self._index = index
        self._driven = (0.0, False, False)

    def position(self) -> int:
        """Return the joint's count."""
        return self._world.planar_counts[self._index]

    def torque(self) -> float:
        """Return the torque of the joint's motor [Nm]."""
        return self._world.planar_torque[self._index]

    def drive(self, torque: float, powered: bool, braked: bool) -> None:
        """Command the motor [Nm], or release it."""
        driven = (torque if powered else 0.0, powered, braked)
        if driven != self._driven:
            self._driven = driven
            self._physics.act(lambda: self._set(*driven))

    def _set(self, torque: float, powered: bool, braked: bool) -> None:
        world, index = self._world, self._index
        world.planar_command = _with(world.planar_command, index, torque)
        world.planar_powered = _with(world.planar_powered, index, powered)
        world.planar_braked = _with(world.planar_braked, index, braked)


def _with(pair: tuple, index: int, value) -> tuple:
    return (value, pair[1]) if index == 0 else (pair[0], value)
