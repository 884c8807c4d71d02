# SPDX-License-Identifier: Apache-2.0
"""The planar axes: two drives that are position sensors too, the planar law between them.

::

    SYNC -> both drives' positions -> joint angles -> planar law -> gate -> torques -> both drives

The drives' counts have no home: `home` says that the handle stands at the reference mark.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..clock import Clock
from ..control.gate import GateSettings
from ..control.planar import (
    PlanarInput,
    PlanarOutput,
    initial_state,
    planar_step,
)
from ..control.planar_settings import PlanarSettings
from ..devices import drive_exit
from ..devices.drive import Drive
from ..devices.errors import BusError
from ..devices.port import Port
from ..filters import (
    back_difference,
    lowpass_coefficients,
    lowpass_settled,
    lowpass_step,
)
from ..geometry import MANUS, inverse
from ..settings import Setting
from .gated_drives import GatedDrives

_FRESH_NS = 100_000_000
_HALF_RANGE = 1 << 31
_RANGE_MASK = (1 << 32) - 1


class JointSettings(NamedTuple):
    """The joints' position sensors and what can be believed of them."""

    resolution: Annotated[
        float, Setting("joint angle per count of object 6064", "rad", 1e-9, 0.1)
    ] = 2.0 * math.pi / 65536
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
    speed: Annotated[float, Setting("fastest joint that is believed", "rad/s", 0.1, 50.0)] = 6.0
    jump: Annotated[
        float, Setting("largest change of an angle within one period", "rad", 1e-4, 1.0)
    ] = 0.02
    silence: Annotated[
        float, Setting("ticks without both positions that latch a fault", "periods", 2.0, 100.0)
    ] = 5.0


class Joint:
    """One joint: counts in, angle and velocity out."""

    def __init__(self, settings: JointSettings, period_ns: int):
        self._settings = settings
        self._period = period_ns * 1e-9
        self._coefficients = lowpass_coefficients(settings.velocity_cutoff, self._period)
        self.restart()

    def restart(self) -> None:
        """Forget the last position; the home position goes with it."""
        self._raw: int | None = None
        self._filter = lowpass_settled(0.0)
        self._count = 0
        self._offset = 0.0
        self.velocity = 0.0
        self.jumped = False

    @property
    def angle(self) -> float:
        """Absolute angle [rad], once homed."""
        return self._offset + self._count * self._settings.resolution

    def home(self, angle: float) -> None:
        """Say that the joint stands at `angle` [rad]."""
        self._offset = angle - self._count * self._settings.resolution

    def take(self, raw: int, direction: int, periods: int) -> str:
        """Take a position [counts], `periods` after the last; return what is wrong, else empty."""
        if self._raw is None:
            self._raw, self._count = raw, direction * raw
            return ""
        # Object 6064 is 32 bits wide and wraps.
        step = ((raw - self._raw + _HALF_RANGE) & _RANGE_MASK) - _HALF_RANGE
        self._raw = raw
        before, self._count = self._count, self._count + direction * step
        resolution, elapsed = self._settings.resolution, periods * self._period
        raw_velocity = back_difference(before, self._count, elapsed) * resolution
        for _ in range(min(periods, 10)):
            self.velocity, self._filter = lowpass_step(
                self._coefficients, self._filter, raw_velocity
            )
        self.jumped = abs(step) * resolution > self._settings.jump * periods
        if self.jumped:
            return f"jumped by {step * resolution:.3f} rad"
        if abs(self.velocity) > self._settings.speed:
            return f"turns at {self.velocity:.1f} rad/s"
        return ""


class PlanarAxes:
    """Both joints, their drives and the law; the loop's thread unless said otherwise.

    settings, joints, gate: see there; `settings` may be replaced at any time.
    """

    def __init__(
        self,
        drives: tuple[Drive, Drive],
        period_ns: int,
        settings: PlanarSettings,
        joints: JointSettings,
        gate: GateSettings,
    ):
        self.settings = settings
        self.drives = GatedDrives(drives, gate, period_ns)
        self.joints = (Joint(joints, period_ns), Joint(joints, period_ns))
        self.homed = False
        self.output: PlanarOutput | None = None
        self.written = (0.0, 0.0)
        self._joint_settings = joints
        self._period_ns = period_ns
        self._law = initial_state(settings)
        self._acted_ns = 0

    def request(self, now_ns: int) -> None:
        """Send SYNC and heartbeat, the latter in any case. Raises BusError."""
        shoulder, elbow = self.drives.drives
        try:
            shoulder.sync(now_ns)
        finally:
            shoulder.heartbeat(now_ns)
            elbow.heartbeat(now_ns)  # the same heartbeat: sent once

    def answered(self, since_ns: int) -> bool:
        """Return whether both drives have answered since `since_ns` [ns]."""
        for drive in self.drives.drives:
            reading = drive.reading
            if reading is None or reading.monotonic_ns < since_ns:
                return False
        return True

    def act(self, setpoint: tuple[float, float, float, float], now_ns: int) -> None:
        """Take both positions and write both torques, the second also when the first fails.

        setpoint: x, y [m], vx, vy [m/s], NaN = leave that axis alone. Raises BusError.
        """
        elapsed_ns = now_ns - self._acted_ns if self._acted_ns else self._period_ns
        periods = max(1, round(elapsed_ns / self._period_ns))
        self._acted_ns = now_ns
        self._measure(periods)
        shoulder, elbow = self.joints
        inp = PlanarInput(
            shoulder.angle,
            elbow.angle,
            shoulder.velocity,
            elbow.velocity,
            *setpoint,
            self.homed and self.drives.enabled,
        )
        self.output, self._law = planar_step(self.settings, self._law, inp, elapsed_ns * 1e-9)
        self._write(now_ns)

    def idle(self, now_ns: int) -> None:
        """Write zero in a tick without both answers; latch when there were too many.

        Raises BusError, after both writes.
        """
        silent_ns = now_ns - self._acted_ns
        if self.drives.enabled and silent_ns > self._joint_settings.silence * self._period_ns:
            self._fault(f"no position for {silent_ns * 1e-6:.0f} ms")
        self.output = None
        self._law = initial_state(self.settings)
        self._write(now_ns)

    def _measure(self, periods: int) -> None:
        for drive, joint in zip(self.drives.drives, self.joints, strict=True):
            wrong = joint.take(drive.reading.position, drive.settings.direction, periods)
            if wrong:
                self._fault(f"{drive.label} {wrong}")
                # Where it is now nobody knows: after a jump and back it may be turns away.
                self.homed = self.homed and not joint.jumped

    def _fault(self, reason: str) -> None:
        self.drives.fault = self.drives.fault or reason

    def _write(self, now_ns: int) -> None:
        # The law acts on the very positions that came with this tick: they are the command's age.
        scale = self.drives.step(self._acted_ns, now_ns)
        output = self.output
        wanted = (output.shoulder_torque, output.elbow_torque) if output else (0.0, 0.0)
        written, failed = [], None
        for drive, torque in zip(self.drives.drives, wanted, strict=True):
            try:
                written.append(drive.write(scale * torque, now_ns))
            except BusError as error:  # no reason to leave the other drive without a command
                written.append(0.0)
                failed = failed or error
        self.written = tuple(written)
        if failed is not None:
            raise failed

    # -- any thread ------------------------------------------------------------------------------

    def home(self, now_ns: int) -> str:
        """Declare that the handle stands at the reference mark; return why not, else empty."""
        settings = self._joint_settings
        if self.drives.enabled:
            return "disable the plane first"
        if not self._acted_ns or now_ns - self._acted_ns > _FRESH_NS:
            return "the drives do not answer"
        for drive, joint in zip(self.drives.drives, self.joints, strict=True):
            if abs(joint.velocity) > settings.home_speed_limit:
                return (
                    f"{drive.label} turns at {joint.velocity:.3f} rad/s; let the handle rest at "
                    "the reference mark"
                )
        angles = inverse(settings.home_x, settings.home_y, MANUS)
        for joint, angle in zip(self.joints, angles, strict=True):
            joint.home(angle)
        self.homed = True
        return ""

    def enable(self, clock: Clock) -> str:
        """Enable both drives; return why not, else empty. clock: as in `GatedDrives.enable`."""
        if not self.homed:
            return "not homed: call ~/home first"
        return self.drives.enable(clock)

    def clear_fault(self, clock: Clock) -> str:
        """Recover both drives; a drive that restarted must be homed again. See `GatedDrives`."""
        restarted = any(not drive.running for drive in self.drives.drives)
        problem = self.drives.clear_fault(clock)
        if restarted:
            self.homed = False
            for joint in self.joints:
                joint.restart()
        return problem

    def shutdown(self, port: Port) -> str:
        """Leave both drives cleanly after the loop has ended; return what did not work."""
        self.drives.close(port.clock.now_ns())  # an open gate would find its command old at the next start
        return drive_exit.leave(self.drives.drives, port)
