# SPDX-License-Identifier: Apache-2.0
"""Numbers of the planar law (`planar`), each declared once with unit and bounds."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..geometry import MANUS, PlanarArm
from ..settings import Setting, validated

STUDIED_GAIN = 9.0
"""Force gain of the study (docs/studies.md). The default is none: a plane has no known limits."""
DELAY = 0.008
"""From a position to its torque, with the velocity filter of 30 Hz and 1.5 periods [s]."""
MOST_DAMPING = 200.0
"""Largest damper, of the impedance and one that a law of others may need [Ns/m]."""
DAMPING_RATIO = 0.25
"""Least damping ratio of a released handle under force feedback."""


class PlanarSettings(NamedTuple):
    """Numbers of the planar law.

    The joints' ranges cover the workspace of 0.381 x 0.457 m and a little more, with the elbow on
    its side. The largest torques are those of the force limit of 45 N at each link (D; 44.5 N in
    2.1.1). arm: settings of the arm, MIT-MANUS's or another one's (`arms.Arm`).
    """

    stiffness: Annotated[
        float,
        Setting("spring of the impedance, the same in x and y", "N/m", 0.0, 2000.0, live=True),
    ] = 100.0  # thesis: usual_spring
    damping: Annotated[
        float, Setting("damper of the impedance", "Ns/m", 0.0, MOST_DAMPING, live=True)
    ] = 10.0  # ours
    force_limit: Annotated[
        float, Setting("largest force at the handle", "N", 0.0, 150.0)
    ] = 45.0  # thesis: d_static_force
    shoulder_torque: Annotated[
        float, Setting("largest torque of the shoulder", "Nm", 0.0, 100.0)
    ] = 20.0  # ours
    elbow_torque: Annotated[
        float, Setting("largest torque of the elbow", "Nm", 0.0, 100.0)
    ] = 25.0  # ours
    torque_rate: Annotated[
        float, Setting("fastest change of a torque", "Nm/s", 1.0, 1e5)
    ] = 500.0  # ours
    fade_time: Annotated[
        float, Setting("time in which the force fades in after enabling", "s", 0.05, 10.0)
    ] = 0.5  # ours
    stiffness_rate: Annotated[
        float, Setting("rate at which the stiffness follows its setting", "N/m/s", 1.0, 1e4)
    ] = 500.0  # ours
    damping_rate: Annotated[
        float, Setting("rate at which the damping follows its setting", "N/m", 1.0, 1e3)
    ] = 50.0  # ours
    force_gain: Annotated[
        float,
        Setting("gain k of the force feedback; it leaves a mass / (1 + k)", "", 0.0, 30.0,
                live=True),
    ] = 0.0  # ours
    force_cutoff: Annotated[
        float, Setting("cut-off of the force that this gain acts on", "Hz", 1.0, 100.0)
    ] = 7.0  # ours
    feedback_limit: Annotated[
        float, Setting("largest force feedback", "N", 0.0, 150.0)
    ] = 45.0  # ours: as force_limit
    gain_rate: Annotated[
        float, Setting("rate at which the force gain follows its setting", "1/s", 0.1, 100.0)
    ] = 20.0  # ours
    chatter_limit: Annotated[
        float,
        Setting("rms of rapid handle force beyond which the force gain goes down", "N", 0.2, 50.0),
    ] = 0.8  # ours
    chatter_damping: Annotated[
        float, Setting("largest damper of the guard of the force gain", "Ns/m", 0.0, 200.0)
    ] = 120.0  # ours
    mass: Annotated[
        float, Setting("moved with the handle, of module and arm", "kg", 0.5, 30.0)
    ] = 6.5  # ours
    half_width: Annotated[
        float, Setting("half of the workspace in x", "m", 0.02, 0.5)
    ] = 0.1905  # thesis: workspace_width / 2
    half_depth: Annotated[
        float, Setting("half of the workspace in y", "m", 0.02, 0.5)
    ] = 0.2286  # thesis: workspace_depth / 2
    box_zone: Annotated[
        float, Setting("length of the soft stop inside each edge", "m", 0.001, 0.1)
    ] = 0.015  # ours
    box_stiffness: Annotated[
        float, Setting("spring of the soft stops at the edges", "N/m", 0.0, 1e4)
    ] = 1000.0  # ours
    # 0.15 to 0.2 rad outside the workspace. The angles are continuous over it and may pass pi: with
    # the elbow to the left the shoulder turns to -3.39 rad.
    shoulder_low: Annotated[
        float, Setting("smallest shoulder angle", "rad", -6.4, 6.4)
    ] = -1.55  # ours
    shoulder_high: Annotated[
        float, Setting("largest shoulder angle", "rad", -6.4, 6.4)
    ] = 0.45  # ours
    elbow_low: Annotated[
        float, Setting("smallest elbow angle", "rad", -6.4, 6.4)
    ] = -3.1  # ours
    elbow_high: Annotated[
        float, Setting("largest elbow angle", "rad", -6.4, 6.4)
    ] = -1.5  # ours
    between_low: Annotated[
        float, Setting("smallest elbow minus shoulder angle", "rad", -3.2, 3.2)
    ] = -2.5  # ours
    between_high: Annotated[
        float, Setting("largest elbow minus shoulder angle", "rad", -3.2, 3.2)
    ] = -0.6  # ours
    joint_zone: Annotated[
        float, Setting("length of the soft stop inside each joint limit", "rad", 0.01, 0.5)
    ] = 0.1  # ours
    joint_stiffness: Annotated[
        float, Setting("spring of the joints' soft stops", "Nm/rad", 0.0, 1e4)
    ] = 100.0  # ours
    speed_limit: Annotated[
        float, Setting("speed above which the force no longer drives", "m/s", 0.05, 3.0)
    ] = 1.0  # ours
    speed_band: Annotated[
        float, Setting("range over which the driving force fades", "m/s", 0.01, 1.0)
    ] = 0.3  # ours
    speed_damping: Annotated[
        float, Setting("damper on the speed above the limit", "Ns/m", 0.0, 200.0)
    ] = 100.0  # ours
    edge_braking: Annotated[
        float,
        Setting("deceleration with which a hand must still come to rest at an edge: the speed "
                "limit falls with the way left", "m/s^2", 0.5, 1000.0),
    ] = 3.0  # ours
    setpoint_speed: Annotated[
        float, Setting("fastest motion of the set point along an axis", "m/s", 0.01, 3.0)
    ] = 0.6  # ours
    setpoint_acceleration: Annotated[
        float, Setting("fastest change of the set point's velocity", "m/s^2", 0.1, 100.0)
    ] = 10.0  # ours
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
        if self.between_low < 0.0 < self.between_high:
            raise ValueError(
                f"PlanarSettings: between_low = {self.between_low!r}, between_high = "
                f"{self.between_high!r} rad: between them the arm stretches and its elbow changes "
                "sides; both must have one sign"
            )
        for half in ("half_width", "half_depth"):
            if getattr(self, half) <= self.box_zone:
                raise ValueError(
                    f"PlanarSettings: {half} = {getattr(self, half)!r} m: must be more than "
                    f"box_zone = {self.box_zone:g} m"
                )
        return self


def least_damping(p: PlanarSettings, stiffness: float, gain: float) -> float:
    """Return the damper with which a released handle comes to rest [Ns/m]; 0 without force gain.

    As `vertical_settings.least_damping`: a gain k leaves M / (1 + k) and little of the friction.
    Its lag and the delay of spring and force act as a negative damper; `DAMPING_RATIO` remains.

    stiffness: the one in use [N/m]; gain: k in use.
    """
    left = 1.0 / (1.0 + gain)
    lag = 1.0 / (2.0 * math.pi * p.force_cutoff) + DELAY
    swings = 2.0 * DAMPING_RATIO * math.sqrt(stiffness * p.mass * left)
    return (1.0 - left) * (stiffness * lag + swings)
