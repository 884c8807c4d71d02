# SPDX-License-Identifier: Apache-2.0
"""The planar axes: two drives, which also measure the positions, and the planar law.

::

    SYNC -> both drives' positions -> joint angles -> planar law -> gate -> torques -> both drives

The drives' counts have no home: `home` declares that the handle stands at the reference mark.
"""

from __future__ import annotations

import math

from ..can_io.port import Port
from ..clock import Clock
from ..control.freeze import FreezeSettings, clear_of_stops, hand_torques
from ..control.gate import GateSettings
from ..control.planar import (
    PlanarInput,
    PlanarOutput,
    initial_state,
    planar_step,
)
from ..control.planar_settings import PlanarSettings
from ..control.slot import SlotLimits
from ..devices import drive_exit
from ..devices.drive import Drive
from ..devices.errors import BusError
from ..devices.homing import Rehoming
from ..geometry import MANUS, forward, inverse, jacobian
from .gated_drives import GatedDrives
from .guide import Guidance, Guide
from .joint import Joint, JointSettings

_FRESH_NS = 100_000_000
_HAND_UNKNOWN = (math.nan, math.nan)
_FREEZE = FreezeSettings()
_SLOT_LIMITS = SlotLimits()


class PlanarAxes:
    """Both joints, their drives and the law; for the loop's thread unless noted otherwise.

    settings, joints, gate, freeze: see their classes; `settings` may be replaced at any time.
    guide: the slot, if there is one.
    """

    def __init__(
        self,
        drives: tuple[Drive, Drive],
        period_ns: int,
        settings: PlanarSettings,
        joints: JointSettings,
        gate: GateSettings,
        freeze: FreezeSettings = _FREEZE,
        slot_limits: SlotLimits = _SLOT_LIMITS,
    ):
        self.settings = settings
        self.drives = GatedDrives(drives, gate, period_ns)
        self.joints = tuple(Joint(joints, freeze, period_ns) for _ in drives)
        self.guide = Guide(slot_limits)
        self.output: PlanarOutput | None = None
        self.written = (0.0, 0.0)
        self._joint_settings = joints
        self._rehoming = Rehoming(joints.home_shift)
        self._period_ns = period_ns
        self._law = initial_state(settings)
        self._acted_ns = 0

    @property
    def homed(self) -> bool:
        """Whether both angles are absolute."""
        return all(joint.homed for joint in self.joints)

    def measures(self, now_ns: int) -> bool:
        """Return whether both drives have told their positions lately, at now_ns [ns]."""
        return bool(self._acted_ns) and now_ns - self._acted_ns <= _FRESH_NS

    def restart(self) -> None:
        """Forget the positions, the home too: for a start, since nobody listened before it."""
        self._acted_ns = 0
        self.output = None
        self.guide = Guide(self.guide.limits)
        self._law = initial_state(self.settings)
        self._lose_homes()

    def request(self, now_ns: int) -> None:
        """Send SYNC and heartbeat; the heartbeat also when SYNC fails. Raises BusError."""
        shoulder, elbow = self.drives.drives
        try:
            shoulder.sync(now_ns)
        finally:
            shoulder.heartbeat(now_ns)
            elbow.heartbeat(now_ns)  # the drives share one heartbeat

    def answered(self, since_ns: int) -> bool:
        """Return whether both drives have answered since `since_ns` [ns]."""
        for drive in self.drives.drives:
            reading = drive.reading
            if reading is None or reading.monotonic_ns < since_ns:
                return False
        return True

    def act(
        self,
        setpoint: tuple[float, float, float, float],
        now_ns: int,
        hand: tuple[float, float] = _HAND_UNKNOWN,
    ) -> None:
        """Read both positions and write both torques, the second also when the first fails.

        setpoint: x, y [m], vx, vy [m/s], NaN = leave that axis alone. hand: force of the patient on
        the robot along x and y [N], NaN = not known. Raises BusError.
        """
        elapsed_ns = now_ns - self._acted_ns if self._acted_ns else self._period_ns
        periods = max(1, round(elapsed_ns / self._period_ns))
        self._acted_ns = now_ns
        self._measure(periods)
        self._doubt(hand)
        shoulder, elbow = self.joints
        inp = PlanarInput(
            shoulder.angle,
            elbow.angle,
            shoulder.velocity,
            elbow.velocity,
            *setpoint,
            self.homed and self.drives.enabled,
            *self._guidance(now_ns, elapsed_ns * 1e-9),
        )
        self.output = planar_step(self.settings, self._law, inp, elapsed_ns * 1e-9)
        self._write(now_ns)

    def _guidance(self, now_ns: int, dt: float) -> Guidance:
        shoulder, elbow = self.joints
        x, y = forward(shoulder.angle, elbow.angle, MANUS)
        x_s, x_e, y_s, y_e = jacobian(shoulder.angle, elbow.angle, MANUS)
        vx = x_s * shoulder.velocity + x_e * elbow.velocity
        vy = y_s * shoulder.velocity + y_e * elbow.velocity
        return self.guide.guidance(x, y, vx, vy, now_ns, dt)

    def idle(self, now_ns: int) -> None:
        """Write zero in a tick without both answers; latch a fault after too many such ticks.

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
            wrong = joint.take(drive.reading.position, periods)
            if wrong:
                self._fault(f"{drive.label} {wrong}")

    def _doubt(self, hand: tuple[float, float]) -> None:
        """Check for a frozen position while torque passes; `written` acted until now."""
        if not self.drives.enabled:
            for joint in self.joints:
                joint.trust()
            return
        angles = [joint.angle for joint in self.joints]
        judged = clear_of_stops(self.settings, *angles)
        pushed = hand_torques(*angles, *hand) if judged else _HAND_UNKNOWN
        for drive, joint, torque, push in zip(
            self.drives.drives, self.joints, self.written, pushed, strict=True
        ):
            wrong = joint.doubt(torque + push)
            if wrong:
                self._fault(f"{drive.label}: {wrong}")

    def _fault(self, reason: str) -> None:
        self.drives.fault = self.drives.fault or reason

    def _write(self, now_ns: int) -> None:
        # The law used the positions of this tick: their age is the command's age.
        scale = self.drives.step(self._acted_ns, now_ns)
        output = self.output
        wanted = (output.shoulder_torque, output.elbow_torque) if output else (0.0, 0.0)
        written, failed = [], None
        for drive, torque in zip(self.drives.drives, wanted, strict=True):
            try:
                written.append(drive.write(scale * torque, now_ns))
            except BusError as error:  # the other drive still needs its command
                written.append(0.0)
                failed = failed or error
        self.written = tuple(written)
        if failed is not None:
            raise failed

    # -- any thread ------------------------------------------------------------------------------

    def home(self, now_ns: int) -> str:
        """Declare that the handle stands at the reference mark; return why not, empty if done.

        Refused while enabled, moving or without answers. Needs a second call when it contradicts
        the last homing (`Rehoming`).
        """
        settings = self._joint_settings
        if not self.drives.at_rest(now_ns):
            return "the plane is enabled: disable it first"
        if not self.measures(now_ns):
            return "the drives do not answer"
        for drive, joint in zip(self.drives.drives, self.joints, strict=True):
            if abs(joint.velocity) > settings.home_speed_limit:
                return (
                    f"{drive.label} turns at {joint.velocity:.3f} rad/s; let the handle rest at "
                    "the reference mark"
                )
        mark = settings.home_x, settings.home_y
        if self.homed or self._rehoming.contradicted:
            place = forward(*(joint.angle for joint in self.joints), MANUS)
            if doubt := self._rehoming.doubt(mark, place, now_ns):
                for joint in self.joints:
                    joint.lose_home()
                return doubt
        angles = inverse(*mark, MANUS)
        for joint, angle in zip(self.joints, angles, strict=True):
            joint.home(angle)
        return ""

    def enable(self, clock: Clock) -> str:
        """Enable both drives; return why not, empty if done. clock: see `GatedDrives.enable`."""
        if not self.homed:
            return "not homed: call ~/home first"
        return self.drives.enable(clock)

    def clear_fault(self, clock: Clock) -> str:
        """Recover both drives; home again if one counts from elsewhere now. See `GatedDrives`."""
        elsewhere = any(not drive.running or drive.altered for drive in self.drives.drives)
        problem = self.drives.clear_fault(clock)
        if elsewhere:
            self._lose_homes()
        return problem

    def _lose_homes(self) -> None:
        self._rehoming.forget()
        for joint in self.joints:
            joint.restart()

    def shutdown(self, port: Port) -> str:
        """Shut both drives down cleanly after the loop has ended; return the errors."""
        # With an open gate the next start would report a stale command.
        self.drives.close(port.clock.now_ns())
        return drive_exit.leave(self.drives.drives, port)
