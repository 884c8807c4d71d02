# SPDX-License-Identifier: Apache-2.0
"""One planar joint: position and velocity from its drive, with plausibility checks."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..control.freeze import FreezeSettings, FreezeState, freeze_step
from ..devices.motion import Motion
from ..settings import Setting


class JointSettings(NamedTuple):
    """The joints' position sensors and the limits of plausible motion."""

    velocity_cutoff: Annotated[
        float, Setting("cutoff of the velocity filter", "Hz", 1.0, 240.0)
    ] = 30.0
    home_x: Annotated[float, Setting("reference mark, x from the workspace centre", "m", -1, 1)] = (
        0.0
    )
    home_y: Annotated[float, Setting("reference mark, y from the workspace centre", "m", -1, 1)] = (
        0.0
    )
    home_speed_limit: Annotated[
        float, Setting("homing is refused while a joint moves faster", "rad/s", 0.0, 1.0)
    ] = 0.02
    home_shift: Annotated[
        float, Setting("homing needs a second call when it moves the handle further", "m",
                       0.0, 1.0)
    ] = 0.005
    speed: Annotated[float, Setting("fastest plausible joint velocity", "rad/s", 0.1, 50.0)] = 6.0
    jump: Annotated[
        float, Setting("largest change of an angle within one period", "rad", 1e-4, 1.0)
    ] = 0.02
    silence: Annotated[
        float, Setting("ticks without both positions that latch a fault", "periods", 2.0, 100.0)
    ] = 5.0


class Joint:
    """Angle and velocity of one joint.

    angle: absolute once homed [rad]; velocity [rad/s].
    """

    def __init__(self, settings: JointSettings, freeze: FreezeSettings, period_ns: int):
        self._settings = settings
        self._period_ns = period_ns
        self._freeze = freeze
        self._freeze_state = FreezeState(0.0, 0.0)
        self._motion = Motion(settings.velocity_cutoff, period_ns)

    @property
    def angle(self) -> float:
        """Absolute angle [rad], once homed."""
        return self._motion.position

    @property
    def velocity(self) -> float:
        """Filtered velocity [rad/s]."""
        return self._motion.velocity

    @property
    def homed(self) -> bool:
        """Whether the angle is absolute."""
        return self._motion.homed

    def restart(self) -> None:
        """Drop the last position and the home position."""
        self._motion.restart()

    def home(self, angle: float) -> None:
        """Declare that the joint stands at `angle` [rad]."""
        self._motion.home(angle)

    def lose_home(self) -> None:
        """Declare the position of the joint unknown."""
        self._motion.homed = False

    def take(self, position: float, periods: int) -> str:
        """Process the drive's position [rad], `periods` after the last; return its fault or "".

        After a jump the joint may be turns away, so the home position is lost.
        """
        motion, settings = self._motion, self._settings
        before, seen = motion.position, motion.seen
        motion.take(position, periods * self._period_ns)
        step = motion.position - before
        if seen and abs(step) > settings.jump * periods:
            motion.homed = False
            return f"jumped by {step:.3f} rad"
        if abs(motion.velocity) > settings.speed:
            return f"turns at {motion.velocity:.1f} rad/s"
        return ""

    def trust(self) -> None:
        """Reset the frozen-position check: no torque passes that would move the joint."""
        self._freeze_state = self._freeze_state._replace(doubt=0.0)

    def doubt(self, torque: float) -> str:
        """Return the fault of a frozen position, or ""; call once a period.

        torque: net torque on the joint [Nm], NaN = not known. The error of a frozen position is
        unknown, so the home position is lost.
        """
        dt = self._period_ns * 1e-9
        frozen, self._freeze_state = freeze_step(
            self._freeze, self._freeze_state, self._motion.position, torque, dt
        )
        if not frozen:
            return ""
        self._motion.homed = False
        self.trust()
        return (
            f"position (6064) has not changed by a count in {self._freeze.time:g} s of more than "
            f"{self._freeze.torque:g} Nm on the joint: it is frozen, or something blocks the arm; "
            "home the plane again"
        )
