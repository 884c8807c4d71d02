# SPDX-License-Identifier: Apache-2.0
"""Numbers of the planar law (`planar`), each declared once with unit and bounds."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..geometry import MANUS, PlanarArm
from ..settings import Setting, validated

CARRIED_HZ = 6.0
"""Corner of the filter of the acceleration with which mass is carried [Hz]: above it the hand feels
the whole mass again."""
DELAY = 0.008
"""From a position to its torque, with the velocity filter of 30 Hz and 1.5 periods [s]."""

class PlanarSettings(NamedTuple):
    """Numbers of the planar law.

    The joints' ranges cover the workspace of 0.381 x 0.457 m and a little more. The largest torques
    are those of the force limit of 45 N (10 lbf, thesis 2.1.1) at each link. arm: its links.
    """

    stiffness: Annotated[
        float,
        Setting("spring of the impedance, the same in x and y", "N/m", 0.0, 2000.0, live=True),
    ] = 100.0
    damping: Annotated[float, Setting("damper of the impedance", "Ns/m", 0.0, 200.0, live=True)] = (
        10.0
    )
    force_limit: Annotated[float, Setting("largest force at the handle", "N", 0.0, 150.0)] = 45.0
    shoulder_torque: Annotated[
        float, Setting("largest torque of the shoulder", "Nm", 0.0, 100.0)
    ] = 20.0
    elbow_torque: Annotated[float, Setting("largest torque of the elbow", "Nm", 0.0, 100.0)] = 25.0
    torque_rate: Annotated[float, Setting("fastest change of a torque", "Nm/s", 1.0, 1e5)] = 300.0
    fade_time: Annotated[
        float, Setting("time in which the force fades in after enabling", "s", 0.05, 10.0)
    ] = 0.5
    stiffness_rate: Annotated[
        float, Setting("rate at which the stiffness follows its setting", "N/m/s", 1.0, 1e4)
    ] = 500.0
    damping_rate: Annotated[
        float, Setting("rate at which the damping follows its setting", "N/m", 1.0, 1e3)
    ] = 50.0
    joint_friction: Annotated[
        float,
        Setting("friction of each joint that is fed forward, 0 = none; less than the joint's own",
                "Nm", 0.0, 1.0, live=True),
    ] = 0.0
    joint_friction_stiffness: Annotated[
        float,
        Setting("spring of that friction at a reversal, softer than the joint's", "Nm/rad",
                1.0, 1000.0),
    ] = 100.0
    carried_mass: Annotated[
        float,
        Setting("part of the module's mass that is carried for the hand, 0 = none", "kg",
                0.0, 3.0, live=True),
    ] = 0.0
    module_mass: Annotated[
        float, Setting("vertical module at the handle", "kg", 3.5, 20.0)
    ] = 5.5
    carried_limit: Annotated[
        float,
        Setting("rms of rapid force beyond which the carried mass is taken away", "N", 0.2, 50.0),
    ] = 0.5
    half_width: Annotated[float, Setting("half of the workspace in x", "m", 0.02, 0.5)] = 0.1905
    half_depth: Annotated[float, Setting("half of the workspace in y", "m", 0.02, 0.5)] = 0.2286
    box_zone: Annotated[
        float, Setting("length of the soft stop inside each edge", "m", 0.001, 0.1)
    ] = 0.015
    box_stiffness: Annotated[
        float, Setting("spring of the soft stops at the edges", "N/m", 0.0, 1e4)
    ] = 1000.0
    shoulder_low: Annotated[float, Setting("smallest shoulder angle", "rad", -3.2, 3.2)] = -0.3
    shoulder_high: Annotated[float, Setting("largest shoulder angle", "rad", -3.2, 3.2)] = 1.75
    elbow_low: Annotated[float, Setting("smallest elbow angle", "rad", -3.2, 6.4)] = 1.35
    elbow_high: Annotated[float, Setting("largest elbow angle", "rad", -3.2, 6.4)] = 3.05
    between_low: Annotated[
        float, Setting("smallest elbow minus shoulder angle", "rad", 0.0, 3.2)
    ] = 0.3
    between_high: Annotated[
        float, Setting("largest elbow minus shoulder angle", "rad", 0.0, 3.2)
    ] = 2.4
    joint_zone: Annotated[
        float, Setting("length of the soft stop inside each joint limit", "rad", 0.01, 0.5)
    ] = 0.1
    joint_stiffness: Annotated[
        float, Setting("spring of the joints' soft stops", "Nm/rad", 0.0, 1e4)
    ] = 100.0
    speed_limit: Annotated[
        float, Setting("speed above which the force no longer drives", "m/s", 0.05, 3.0)
    ] = 1.0
    speed_band: Annotated[
        float, Setting("range over which the driving force fades", "m/s", 0.01, 1.0)
    ] = 0.3
    speed_damping: Annotated[
        float, Setting("damper on the speed above the limit", "Ns/m", 0.0, 200.0)
    ] = 20.0
    setpoint_speed: Annotated[
        float, Setting("fastest motion of the set point along an axis", "m/s", 0.01, 3.0)
    ] = 0.6
    setpoint_acceleration: Annotated[
        float, Setting("fastest change of the set point's velocity", "m/s^2", 0.1, 100.0)
    ] = 10.0
    arm: PlanarArm = MANUS


    def validated(self) -> PlanarSettings:
        """Return self when every field is in its range.

        Raises ValueError naming the field, its value and the range.
        """
        validated(self)
        for low, high, zone in (
            ("shoulder_low", "shoulder_high", "joint_zone"),
            ("elbow_low", "elbow_high", "joint_zone"),
            ("between_low", "between_high", "joint_zone"),
        ):
            room = getattr(self, high) - getattr(self, low)
            if room <= 2.0 * getattr(self, zone):
                raise ValueError(
                    f"PlanarSettings: {high} = {getattr(self, high)!r} rad: must lie above {low} = "
                    f"{getattr(self, low):g} rad by more than two soft stops of "
                    f"{getattr(self, zone):g} rad"
                )
        for half in ("half_width", "half_depth"):
            if getattr(self, half) <= self.box_zone:
                raise ValueError(
                    f"PlanarSettings: {half} = {getattr(self, half)!r} m: must be more than "
                    f"box_zone = {self.box_zone:g} m"
                )
        return self


def least_damping(p: PlanarSettings, stiffness: float) -> float:
    """Return the damper with which a released handle comes to rest [Ns/m], 0 without carried mass.

    The lag of the acceleration's filter is a negative damper, m w^2 / wc for an oscillation w. A
    handle on its spring alone oscillates at w^2 = K / (M - m), M the mass of module and arm, m < M
    the carried one. So the lag takes m K / ((M - m) wc); the delay of spring and force takes
    K M / (M - m) times the delay. stiffness: K, the one in use [N/m].
    """
    carried = p.carried_mass
    if carried <= 0.0:
        return 0.0
    left = p.module_mass - carried
    lag = carried / (left * 2.0 * math.pi * CARRIED_HZ)
    return stiffness * (lag + p.module_mass / left * DELAY)
