# SPDX-License-Identifier: Apache-2.0
"""Numbers of the vertical law (`vertical`), each declared once with unit and bounds."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..settings import Setting, validated
from .limits import CommandLimits

KNOWN_SHARE = 0.7
"""Of the mass that OBSERVER's force gain leaves, to carry where a calibration measured it: a mass
40 % too large leaves none."""
CARRIED_HZ = 6.0
"""Corner of the filter of the acceleration with which mass is carried [Hz]: above it the hand feels
M / (1 + k) again."""
ESTIMATING = ("force_cutoff", "observer_cutoff", "observer_bandwidth", "observer_delay", "mass")
"""Settings with which the envelope filters and estimates what every law is told."""
_COMMAND = CommandLimits()


class VerticalSettings(NamedTuple):
    """Numbers of the vertical law, each declared with unit and bounds."""

    stiffness: Annotated[
        float, Setting("spring of the impedance", "N/m", 0.0, 5000.0, live=True)
    ] = 100.0  # thesis: usual_spring
    damping: Annotated[
        float, Setting("damper of the impedance, negative assists", "Ns/m", -50.0, 500.0, live=True)
    ] = 0.0  # ours
    force_gain: Annotated[
        float, Setting("gain Kf of the force feedback", "", 0.0, 50.0, live=True)
    ] = 5.0  # thesis: force_gain
    friction_fraction: Annotated[
        float, Setting("share of the modelled friction that is fed forward", "", 0.0, 1.0)
    ] = 0.9  # thesis: feedforward_share
    gravity: Annotated[
        float, Setting("force that carries the moving parts' weight", "N", -50.0, 50.0, live=True)
    ] = 10.0  # thesis: gravity_compensation
    force_cutoff: Annotated[
        float, Setting("cut-off of the handle force's filter", "Hz", 1.0, 400.0)
    ] = 30.0  # thesis: force_cutoff
    friction_stiffness: Annotated[
        float,
        Setting("spring of the modelled friction at a reversal, softer than the module's", "N/m",
                1e3, 1e6),
    ] = 1e5  # ours
    friction_limit: Annotated[float, Setting("largest friction feed-forward", "N", 0.0, 60.0)] = (
        25.0  # ours
    )
    feedback_limit: Annotated[
        float, Setting("largest force feedback", "N", 0.0, 150.0)
    ] = 60.0  # ours
    mass: Annotated[
        float, Setting("moving mass, without a hand", "kg", 0.5, 50.0, live=True)
    ] = 5.5  # thesis: simulated_mass
    observer_gain: Annotated[
        float, Setting("force gain k of OBSERVER; it leaves mass / (1 + k)", "", 0.0, 30.0)
    ] = 9.0  # ours
    observer_cutoff: Annotated[
        float, Setting("cut-off of the force that this gain acts on", "Hz", 1.0, 100.0)
    ] = 9.0  # ours
    observer_bandwidth: Annotated[
        float, Setting("triple pole of the disturbance observer", "rad/s", 20.0, 1000.0)
    ] = 300.0  # ours
    observer_delay: Annotated[
        float,
        Setting("delay from a sample to its force at the nut, amplifier included", "s", 0.0, 5e-3),
    ] = 1.4e-3  # ours
    observer_limit: Annotated[float, Setting("largest disturbance estimated", "N", 0.0, 60.0)] = (
        35.0  # ours
    )
    observer_rest: Annotated[
        float,
        Setting("force error tolerated at rest, so that the handle does not hunt", "N",
                0.0, 5.0),
    ] = 0.5  # ours
    observer_friction: Annotated[
        float,
        Setting("share of modelled friction fed forward in OBSERVER", "",
                0.0, 1.0, live=True),
    ] = 0.0  # ours
    observer_inertia: Annotated[
        float,
        Setting("share of the mass left in OBSERVER that is carried too, for a mass that is known",
                "", 0.0, 0.7, live=True),
    ] = 0.0  # ours
    observer_damping_ratio: Annotated[
        float,
        Setting("least damping ratio of a released handle in OBSERVER, 0 = none", "", 0.0, 1.0),
    ] = 0.25  # ours
    chatter_limit: Annotated[
        float,
        Setting("rms of rapid handle force beyond which force gains go down", "N", 0.2, 50.0),
    ] = 1.2  # ours
    chatter_damping: Annotated[
        float, Setting("largest damper of the guard of the force gains", "Ns/m", 0.0, 200.0)
    ] = 120.0  # ours
    standing_force: Annotated[
        float,
        Setting("force on a nut that stands, the hand's included, beyond which nothing helps it",
                "N", 0.0, 150.0),
    ] = 22.0  # ours
    fade_time: Annotated[
        float, Setting("time in which a part of the force fades in or out", "s", 0.05, 10.0)
    ] = 0.5  # ours
    stiffness_rate: Annotated[
        float, Setting("rate at which the stiffness follows its setting", "N/m/s", 1.0, 1e4)
    ] = 500.0  # ours
    damping_rate: Annotated[
        float, Setting("rate at which the damping follows its setting", "N/m", 1.0, 1e3)
    ] = 50.0  # ours
    gain_rate: Annotated[
        float, Setting("rate at which the force gain follows its setting", "1/s", 0.1, 100.0)
    ] = 2.5  # ours
    gravity_rate: Annotated[
        float, Setting("rate at which the carried weight follows its setting", "N/s", 1.0, 1e3)
    ] = 20.0  # ours
    force_up: Annotated[
        float, Setting("largest force of spring and damper on the hand, upward", "N", 0.0, 150.0)
    ] = 65.0  # thesis: force_up
    force_down: Annotated[
        float, Setting("largest force of spring and damper on the hand, downward", "N", 0.0, 150.0)
    ] = 45.0  # thesis: force_down
    command_up: Annotated[
        float, Setting("largest command upward, weight and friction included", "N", 0.0, 150.0)
    ] = _COMMAND.command_up
    command_down: Annotated[
        float, Setting("largest command downward, friction included", "N", 0.0, 150.0)
    ] = _COMMAND.command_down
    force_rate: Annotated[float, Setting("fastest change of the command", "N/s", 10.0, 1e5)] = (
        2000.0  # ours
    )
    travel_low: Annotated[
        float, Setting("bottom of travel", "m", -1.0, 1.0)
    ] = 0.0  # ours: the origin of z
    travel_high: Annotated[float, Setting("top of travel", "m", -1.0, 1.0)] = 0.36  # thesis: travel
    soft_stop_zone: Annotated[
        float, Setting("length of the soft stop at each end", "m", 0.001, 0.1)
    ] = 0.01  # ours
    soft_stop_stiffness: Annotated[float, Setting("spring of the soft stops", "N/m", 0.0, 1e4)] = (
        2000.0  # ours
    )
    speed_limit: Annotated[
        float, Setting("speed above which the force no longer drives", "m/s", 0.05, 2.0)
    ] = 0.8  # ours
    speed_band: Annotated[
        float, Setting("range over which the driving force fades", "m/s", 0.01, 1.0)
    ] = 0.2  # ours
    speed_damping: Annotated[
        float, Setting("damper on the speed above the limit", "Ns/m", 0.0, 200.0)
    ] = 50.0  # ours
    edge_braking: Annotated[
        float,
        Setting("deceleration with which a hand must still come to rest before a soft stop: the "
                "speed limit falls with the way left", "m/s^2", 0.5, 1000.0),
    ] = 3.0  # ours
    edge_damping: Annotated[
        float, Setting("damper on the speed above this limit", "Ns/m", 0.0, 500.0)
    ] = 200.0  # ours
    setpoint_speed: Annotated[
        float, Setting("fastest motion of the set point", "m/s", 0.01, 2.0)
    ] = 0.4  # ours
    setpoint_acceleration: Annotated[
        float, Setting("fastest change of the set point's velocity", "m/s^2", 0.1, 100.0)
    ] = 5.0  # ours

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

    def calibrated(self, gravity: float, mass: float, delay: float = 0.0) -> VerticalSettings:
        """Return the settings for a module whose weight [N] and mass [kg] were measured.

        delay: of its loop, from a sample to its force [s]; 0 = not measured.
        """
        return self._replace(
            gravity=gravity, mass=mass, observer_inertia=KNOWN_SHARE,
            observer_delay=delay or self.observer_delay,
        )  # fmt: skip

    def carrying_at_most(self, measured: float) -> VerticalSettings:
        """Return the settings for a module whose mass was measured [kg].

        A mass set by hand may be larger, for a heavier handle; then OBSERVER still carries only
        what it may of the mass that was measured. More could leave the hand less than no mass.
        """
        most = KNOWN_SHARE * measured / self.mass
        return self._replace(observer_inertia=min(self.observer_inertia, most))

    @property
    def least_damping(self) -> float:
        """Smallest damping with which OBSERVER brings a released handle to rest [Ns/m]."""
        return least_damping(self, self.stiffness)


def least_damping(p: VerticalSettings, stiffness: float) -> float:
    """Return the damping with which OBSERVER brings a released handle to rest [Ns/m].

    Without friction and hand, spring and damper move the apparent mass M / (1 + k). The filter of
    the force gain k (cutoff fc) and the delay tau shift the phase of the spring's force; that acts
    as the negative damping K (k / ((1 + k) 2 pi fc) + tau). The damping ratio zeta adds
    2 zeta sqrt(K M / (1 + k)); a ratio of 0 asks for no damping at all.

    stiffness: K, the one in use [N/m].
    """
    gain, ratio = p.observer_gain, p.observer_damping_ratio
    if ratio <= 0.0:
        return 0.0
    lag = gain / ((1.0 + gain) * 2.0 * math.pi * p.observer_cutoff) + p.observer_delay
    return stiffness * lag + 2.0 * ratio * math.sqrt(stiffness * p.mass / (1.0 + gain))
