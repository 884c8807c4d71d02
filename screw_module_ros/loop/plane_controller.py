# SPDX-License-Identifier: Apache-2.0
"""The controller of the plane: turns positions and the handle's force into two torques.

::

    both positions -> joint angles -> planar law -> both torques
                       handle force ----^

The drives' counts have no home: `home` declares that the handle stands at the reference mark.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

from ..control.arms import FIVE_BAR, Arm
from ..control.laws.plane_impedance import PLANE_IMPEDANCE
from ..control.planar import PlanarInput, PlanarOutput
from ..control.planar_settings import PlanarSettings
from ..control.plane_law import PlaneLaw
from ..control.slot import Reach, SlotLimits
from ..devices.doubt import HOMING, Doubt
from ..devices.motion import Motion
from ..safety.checks import FreezeSettings, Frozen, Stream, force_flaw
from ..safety.latch import Age, Latch
from ..samples import ForceReading
from ..settings import Setting
from .inputs import NO_GUIDANCE, Guidance, Guide, SetpointInput
from .plane_law_runner import PlaneLawRunner

_FRESH_NS = 100_000_000
_FORCE_PERIODS = 5.0  # age of the newest force sample that latches a fault
_UNKNOWN = (math.nan, math.nan)
NO_TORQUES = (0.0, 0.0)


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
        float, Setting("largest change of an angle within one period; after a gap, within as many "
                       "as `silence`", "rad", 1e-4, 1.0)
    ] = 0.02
    silence: Annotated[
        float, Setting("ticks without both positions that latch a fault", "periods", 2.0, 100.0)
    ] = 5.0
    time_constant: Annotated[
        float, Setting("time constant of the motors' heating (I2t): the mean square of a torque "
                       "over it stays within that of `rated_torque`", "s", 0.5, 1000.0)
    ] = 10.0


class PlaneLimits(NamedTuple):
    """Limits that stop the plane, besides those of drives and law."""

    force_required: Annotated[
        bool, Setting("without a force sample the plane cannot be enabled")
    ] = True
    handle_force_limit: Annotated[
        float, Setting("planar handle force that stops the plane", "N", 1.0, 1000.0)
    ] = 150.0
    missed_limit: Annotated[
        int, Setting("deadlines missed in a row that stop the torque", "", 1, 1000)
    ] = 20


class Joint:
    """One joint: its motion, absolute once homed [rad] and [rad/s], and what is plausible of it.

    label: of its drive, as faults name it.
    """

    def __init__(
        self, settings: JointSettings, freeze: FreezeSettings, period_ns: int, label: str = "joint"
    ):
        self.label = label
        self.frozen = Frozen(freeze)
        self.motion = Motion(settings.velocity_cutoff, period_ns)
        self._settings = settings
        self._period_ns = period_ns

    def take(self, position: float, periods: int) -> str:
        """Process the drive's position [rad], `periods` after the last; return its fault or "".

        After a jump the joint may be turns away, so the home position is lost.
        """
        motion, settings = self.motion, self._settings
        before, seen = motion.position, motion.seen
        motion.take(position, periods * self._period_ns)
        step = motion.position - before
        if seen and abs(step) > settings.jump * min(periods, settings.silence):
            motion.homed = False
            return f"jumped by {step:.3f} rad"
        if abs(motion.velocity) > settings.speed:
            return f"turns at {motion.velocity:.1f} rad/s"
        return ""

    def check_frozen(self, torque: float) -> str:
        """Return the fault of a frozen position, or ""; call once a period.

        torque: net torque on the joint [Nm], NaN = not known. The error of a frozen position is
        unknown, so the home position is lost.
        """
        frozen = self.frozen.check(self.motion.position, torque, self._period_ns * 1e-9)
        self.motion.homed = self.motion.homed and not frozen
        return frozen


class PlaneController:
    """Checks, home and law of the plane; all times are passed in [ns].

    settings: of the law, may be replaced at any time. fault: what is latched, the gate's own latch.
    joints: both, motions: theirs. guide: the slot, if there is one. wanted: the set point, x and y.
    laws: the law on its arm; output: of the law in the last tick, None without positions.
    measured: when both drives told their positions last. force_seen: a force sample has come.
    """

    def __init__(
        self,
        settings: PlanarSettings,
        joints: JointSettings,
        period_ns: int,
        fault: Latch,
        labels: tuple[str, str],
        freeze: FreezeSettings,
        slot_limits: SlotLimits,
        handle_force_limit: float,
        law: PlaneLaw = PLANE_IMPEDANCE,
        arm: Arm = FIVE_BAR,
        own: Any = None,
        work_ns: Callable[[], int] | None = None,
    ):
        """labels: of both drives; handle_force_limit: of the force on the handle [N]; own: settings
        of a law of others, work_ns: processor time of the loop's thread [ns], for `PlaneLawRunner`.
        """
        self.settings = settings
        self.laws = PlaneLawRunner(settings, law, arm, own, period_ns, work_ns)
        self.fault = fault
        shoulder, elbow = (Joint(joints, freeze, period_ns, label) for label in labels)
        self.joints = shoulder, elbow
        self.motions = shoulder.motion, elbow.motion
        wide, deep = settings.half_width, settings.half_depth
        self.guide = Guide(slot_limits, Reach(-wide, wide, -deep, deep))
        self._joint_settings, self._handle_force_limit = joints, handle_force_limit
        self._period_ns = period_ns
        self._doubt = Doubt(joints.home_shift, HOMING, 1e3)
        self.restart()

    def restart(self) -> None:
        """Forget what was asked for, forces and positions, the home too."""
        self.guide = Guide(self.guide.limits, self.guide.reach)
        self.wanted = SetpointInput(axes=2)
        self.output: PlanarOutput | None = None
        self.laws.restart(self.settings)
        self.measured = Age(_FRESH_NS)
        self._forces = Stream("force sensor", self._period_ns, self.fault, numbered=False)
        self._force_age = Age(_FORCE_PERIODS * self._period_ns, self._period_ns)
        self._hand = _UNKNOWN
        self.lose_homes()

    @property
    def share(self) -> float:
        """Share of the force gain left by the guard, 0 to 1."""
        return self.output.share if self.output else 1.0

    @property
    def homed(self) -> bool:
        """Whether both angles are absolute."""
        shoulder, elbow = self.motions
        return shoulder.homed and elbow.homed

    @property
    def force_seen(self) -> bool:
        """Whether a force sample has come since the start."""
        return self._forces.seen

    # The handle's force ------------------------------------------------------------------------

    def on_force(self, sample: ForceReading, now_ns: int) -> None:
        """Check the force of the patient on the robot, and take it as the hand's."""
        if not self._forces.accept(sample.sequence, sample.monotonic_ns, now_ns):
            return
        size = math.hypot(sample.fx, sample.fy)
        problem = force_flaw(sample, size, self._handle_force_limit)
        self.fault.set(problem)
        self._force_age.note(sample.monotonic_ns)
        self._hand = _UNKNOWN if problem else (sample.fx, sample.fy)

    def check_force(self, enabled: bool, now_ns: int) -> None:
        """Stop on a force sensor that has gone silent while the torque is enabled."""
        if self._forces.seen and not self._force_age.fresh(now_ns):
            self._hand = _UNKNOWN
            if enabled:
                self._forces.check_age(now_ns, self._force_age.limit_ns)

    # Positions ---------------------------------------------------------------------------------

    def on_positions(
        self, positions: tuple[float, float], acted: tuple[float, float], enabled: bool, now_ns: int
    ) -> tuple[float, float]:
        """Return both torques [Nm] for the positions of this tick [rad], as the drives count.

        acted: torques until now [Nm]; enabled: torque passes.
        """
        last_ns = self.measured.stamp_ns
        elapsed_ns = now_ns - last_ns if last_ns else self._period_ns
        self.measured.note(now_ns)
        periods = max(1, round(elapsed_ns / self._period_ns))
        for joint, position in zip(self.joints, positions, strict=True):
            if wrong := joint.take(position, periods):
                self.fault.set(f"{joint.label} {wrong}")
        self.check_frozen(acted, enabled)
        shoulder, elbow = self.motions
        acts = shoulder.homed and elbow.homed and enabled
        x, y, vx, vy = self.wanted.at(now_ns, acts)
        inp = PlanarInput(
            shoulder.position,
            elbow.position,
            shoulder.velocity,
            elbow.velocity,
            x,
            y,
            vx,
            vy,
            acts,
            *(NO_GUIDANCE if self.guide.free else self._guidance(now_ns, elapsed_ns * 1e-9)),
            *self._hand,
        )
        self.output = self.laws.step(self.settings, inp, elapsed_ns * 1e-9)
        if self.laws.wrong and shoulder.homed and elbow.homed:  # before, an arm may know no place
            self.fault.set(self.laws.wrong)
        return self.output.shoulder_torque, self.output.elbow_torque

    def stop_when_silent(self, enabled: bool, now_ns: int) -> None:
        """Begin anew in a tick without both answers; latch a fault after too many such ticks."""
        silent_ns = now_ns - self.measured.stamp_ns
        if enabled and silent_ns > self._joint_settings.silence * self._period_ns:
            self.fault.set(f"no position for {silent_ns * 1e-6:.0f} ms")
        self.output = None
        self.laws.restart(self.settings)

    def _guidance(self, now_ns: int, dt: float) -> Guidance:
        shoulder, elbow = self.motions
        angles, arm, own = (shoulder.position, elbow.position), self.laws.arm, self.settings.arm
        x, y = arm.forward(*angles, own)
        x_s, x_e, y_s, y_e = arm.jacobian(*angles, own)
        vx = x_s * shoulder.velocity + x_e * elbow.velocity
        vy = y_s * shoulder.velocity + y_e * elbow.velocity
        return self.guide.guidance(x, y, vx, vy, now_ns, dt)

    def check_frozen(self, acted: tuple[float, float], enabled: bool) -> None:
        """Look for a frozen position while torque passes; acted: torques until now [Nm]."""
        if not enabled:
            for joint in self.joints:
                joint.frozen.restart()
            return
        angles = self.motions[0].position, self.motions[1].position
        arm = self.laws.arm
        judged = clear_of_stops(arm, self.settings, *angles)
        pushed = hand_torques(arm, *angles, *self._hand, self.settings.arm) if judged else _UNKNOWN
        for joint, torque, push in zip(self.joints, acted, pushed, strict=True):
            if wrong := joint.check_frozen(torque + push):
                self.fault.set(f"{joint.label}: {wrong}")

    # Home --------------------------------------------------------------------------------------

    def home(self, now_ns: int) -> str:
        """Declare that the handle stands at the reference mark; return why not, empty if done.

        Refused in motion or without answers. Needs a second call when it contradicts the last
        homing (`Doubt`).
        """
        settings, arm = self._joint_settings, self.laws.arm
        if not self.measured.fresh(now_ns):
            return "the drives do not answer"
        for joint in self.joints:
            if abs(speed := joint.motion.velocity) > settings.home_speed_limit:
                return (
                    f"{joint.label} turns at {speed:.3f} rad/s; let the handle rest at the "
                    "reference mark"
                )
        mark = settings.home_x, settings.home_y
        if self.homed or self._doubt.contradicted:
            shoulder, elbow = self.motions
            place = arm.forward(shoulder.position, elbow.position, self.settings.arm)
            if refused := self._doubt.refusal(mark, place, now_ns):
                for joint in self.joints:
                    joint.motion.homed = False
                return refused
        angles = arm.inverse(*mark, self.settings.arm)
        if not all(map(math.isfinite, angles)):
            return f"arm {arm.name}: its inverse knows no angles of the reference mark"
        for joint, angle in zip(self.joints, angles, strict=True):
            joint.motion.home(angle)
        return ""

    def lose_homes(self) -> None:
        """Forget positions and homes: a drive may count from elsewhere."""
        self._doubt.forget()
        for joint in self.joints:
            joint.motion.restart()


def hand_torques(
    arm: Arm, shoulder: float, elbow: float, fx: float, fy: float, own: Any
) -> tuple[float, float]:
    """Return the torques of a handle force [N] at both joints [Nm]: J^T F, angles in rad.

    own: settings of the arm.
    """
    x_s, x_e, y_s, y_e = arm.jacobian(shoulder, elbow, own)
    return x_s * fx + y_s * fy, x_e * fx + y_e * fy


def clear_of_stops(arm: Arm, settings: PlanarSettings, shoulder: float, elbow: float) -> bool:
    """Return whether both joints [rad] are within their range, where no stop touches them."""
    return (
        settings.shoulder_low < shoulder < settings.shoulder_high
        and settings.elbow_low < elbow < settings.elbow_high
        and settings.between_low < arm.between(shoulder, elbow, settings.arm)[0]
        < settings.between_high
    )
