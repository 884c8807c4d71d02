# SPDX-License-Identifier: Apache-2.0
"""Numbers of the vertical law (`vertical`), each declared once with unit and bounds."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..settings import Setting, validated
from .limits import CommandLimits

_COMMAND = CommandLimits()


class VerticalSettings(NamedTuple):
    """Numbers of the vertical law, each declared with unit and bounds."""

    stiffness: Annotated[
        float, Setting("spring of the impedance", "N/m", 0.0, 5000.0, live=True)
    ] = 100.0
    damping: Annotated[
        float, Setting("damper of the impedance, negative assists", "Ns/m", -50.0, 500.0, live=True)
    ] = 0.0
    force_gain: Annotated[
        float, Setting("gain Kf of the force feedback", "", 0.0, 50.0, live=True)
    ] = 5.0
    friction_fraction: Annotated[
        float, Setting("share of the modelled friction that is fed forward", "", 0.0, 1.0)
    ] = 0.9
    gravity: Annotated[
        float, Setting("force that carries the moving parts' weight", "N", -50.0, 50.0, live=True)
    ] = 10.0
    force_cutoff: Annotated[
        float, Setting("cutoff of the handle force's filter", "Hz", 1.0, 400.0)
    ] = 30.0
    friction_limit: Annotated[float, Setting("largest friction feed-forward", "N", 0.0, 60.0)] = (
        25.0
    )
    feedback_limit: Annotated[float, Setting("largest force feedback", "N", 0.0, 150.0)] = 60.0
    fade_time: Annotated[
        float, Setting("time in which a part of the force comes or goes", "s", 0.05, 10.0)
    ] = 0.5
    stiffness_rate: Annotated[
        float, Setting("rate at which the stiffness follows its setting", "N/m/s", 1.0, 1e4)
    ] = 500.0
    damping_rate: Annotated[
        float, Setting("rate at which the damping follows its setting", "N/m", 1.0, 1e3)
    ] = 50.0
    gain_rate: Annotated[
        float, Setting("rate at which the force gain follows its setting", "1/s", 0.1, 100.0)
    ] = 2.5
    gravity_rate: Annotated[
        float, Setting("rate at which the carried weight follows its setting", "N/s", 1.0, 1e3)
    ] = 20.0
    force_up: Annotated[
        float, Setting("largest force of spring and damper on the hand, upward", "N", 0.0, 150.0)
    ] = 65.0
    force_down: Annotated[
        float, Setting("largest force of spring and damper on the hand, downward", "N", 0.0, 150.0)
    ] = 45.0
    command_up: Annotated[
        float, Setting("largest command upward, weight and friction included", "N", 0.0, 150.0)
    ] = _COMMAND.command_up
    command_down: Annotated[
        float, Setting("largest command downward, friction included", "N", 0.0, 150.0)
    ] = _COMMAND.command_down
    force_rate: Annotated[float, Setting("fastest change of the command", "N/s", 10.0, 1e5)] = (
        2000.0
    )
    travel_low: Annotated[float, Setting("bottom of travel", "m", -1.0, 1.0)] = 0.0
    travel_high: Annotated[float, Setting("top of travel", "m", -1.0, 1.0)] = 0.36
    soft_stop_zone: Annotated[
        float, Setting("length of the soft stop at each end", "m", 0.001, 0.1)
    ] = 0.01
    soft_stop_stiffness: Annotated[float, Setting("spring of the soft stops", "N/m", 0.0, 1e4)] = (
        2000.0
    )
    speed_limit: Annotated[
        float, Setting("speed above which the force no longer drives", "m/s", 0.05, 2.0)
    ] = 0.6
    speed_band: Annotated[
        float, Setting("range over which the driving force fades", "m/s", 0.01, 1.0)
    ] = 0.2
    speed_damping: Annotated[
        float, Setting("damper on the speed above the limit", "Ns/m", 0.0, 200.0)
    ] = 50.0
    setpoint_speed: Annotated[
        float, Setting("fastest motion of the set point", "m/s", 0.01, 2.0)
    ] = 0.4
    setpoint_acceleration: Annotated[
        float, Setting("fastest change of the set point's velocity", "m/s^2", 0.1, 100.0)
    ] = 5.0

    def validated(self) -> VerticalSettings:
        """Return self when every field is in its range.

        Raises ValueError naming the field, its value and the range.
        """
        validated(self)
        if self.travel_high - self.travel_low <= 2.0 * self.soft_stop_zone:
            raise ValueError(
                f"VerticalSettings: travel_high = {self.travel_high!r} m: must lie above "
                f"travel_low = {self.travel_low:g} m by more than two soft stops of "
                f"{self.soft_stop_zone:g} m"
            )
        return self
