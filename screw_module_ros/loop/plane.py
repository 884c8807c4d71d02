# SPDX-License-Identifier: Apache-2.0
"""The plane, MIT-MANUS: two drives, which also measure the positions, and the law between them.

::

    tick -> SYNC -> both positions -> joint angles -> planar law -> permit -> both torques
                                     handle force ----^

The drives' counts have no home: `home` declares that the handle stands at the reference mark.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Annotated, NamedTuple

from ..can_io.port import Port
from ..clock import Clock
from ..control.limits import COLD, TorqueLimits, largest_torque
from ..control.planar import PlanarInput, PlanarOutput, initial_state, planar_step
from ..control.planar_settings import PlanarSettings
from ..control.slot import Reach, SlotLimits
from ..devices import drive_group
from ..devices.doubt import HOMING, Doubt
from ..devices.drive import Drive
from ..devices.drive_settings import DriveSettings
from ..devices.errors import BusError, DeviceError
from ..devices.motion import Motion
from ..geometry import MANUS, PlanarArm, forward, inverse, jacobian
from ..safety.checks import FreezeSettings, Frozen, Stream, force_problem
from ..safety.latch import Age
from ..safety.permit import Permit, PermitSettings
from ..safety.timing import DeadlineMeter
from ..samples import ForceReading
from ..settings import Setting
from .inputs import NO_GUIDANCE, Guidance, Guide, SetpointInput
from .requests import Requests
from .ticker import Tick, Ticker

_FRESH_NS = 100_000_000
_FORCE_PERIODS = 5.0  # age of the newest force sample that latches a fault
_UNKNOWN = (math.nan, math.nan)
_FREEZE = FreezeSettings()
_SLOT_LIMITS = SlotLimits()


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


class PlaneWires(NamedTuple):
    """The connections to other processes.

    read_inputs: reads set point, handle force and permission at a time [ns], while the drives
    answer. publish_state: called with each tick; it publishes when due.
    """

    read_inputs: Callable[[int], None] = lambda now_ns: None
    publish_state: Callable[[Tick], None] = lambda tick: None


class Joint:
    """One joint, by its drive.

    motion: angle, absolute once homed [rad], and velocity [rad/s]. limits: of the motor's torque;
    heat: of the motor [Nm^2], see `control.limits`.
    """

    def __init__(
        self, settings: JointSettings, drive: DriveSettings, freeze: FreezeSettings,
        period_ns: int,
    ):  # fmt: skip
        self.limits = TorqueLimits(drive.rated_torque, drive.max_torque, settings.time_constant)
        self.heat = COLD
        self.frozen = Frozen(freeze)
        self.motion = Motion(settings.velocity_cutoff, period_ns)
        self._settings = settings
        self._period_ns = period_ns

    @property
    def warmth(self) -> float:
        """Share of the heat that the motor bears for long, 0 to 1."""
        return self.heat / self.limits.continuous**2

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


class Plane:
    """Both joints, their drives and the law; `step` is one tick.

    settings: of the law, may be replaced at any time. joints: both, motions: theirs. permit: the
    gate with both drives. guide: the slot, if there is one. wanted: the set point, x and y. state:
    memory of the law, output: of the law in the last tick, None without positions. written: torques
    of the last tick [Nm]; hot: whether the motors' heat bounded them. meter: latency from the tick
    to the torques. skipped: ticks that an overrun skipped.
    """

    def __init__(
        self,
        drives: tuple[Drive, Drive],
        port: Port,
        period_ns: int,
        settings: PlanarSettings,
        joints: JointSettings,
        permit: PermitSettings,
        freeze: FreezeSettings = _FREEZE,
        slot_limits: SlotLimits = _SLOT_LIMITS,
        limits: PlaneLimits | None = None,
        wires: PlaneWires | None = None,
    ):
        self.settings = settings
        # A command is as old as the positions behind it.
        oldest = max(permit.command_periods, joints.silence)
        self.permit = Permit(
            drives, Requests(), permit._replace(command_periods=oldest), period_ns,
            max(drive.settings.enable_timeout for drive in drives),
        )  # fmt: skip
        shoulder, elbow = (Joint(joints, drive.settings, freeze, period_ns) for drive in drives)
        self.joints = shoulder, elbow
        self.motions = self.joints[0].motion, self.joints[1].motion
        wide, deep = settings.half_width, settings.half_depth
        self.guide = Guide(slot_limits, Reach(-wide, wide, -deep, deep))
        self._drives, self._port, self._clock = drives, port, port.clock
        self._joint_settings, self._limits = joints, limits or PlaneLimits()
        self._wires = wires or PlaneWires()
        self._period_ns = period_ns
        self._doubt = Doubt(joints.home_shift, HOMING, 1e3)
        self._heat_ns = self._clock.now_ns()
        self.restart()

    @property
    def share(self) -> float:
        """Share of the force gain left by the guard, 0 to 1."""
        return self.output.share if self.output else 1.0

    @property
    def homed(self) -> bool:
        """Whether both angles are absolute."""
        shoulder, elbow = self.motions
        return shoulder.homed and elbow.homed

    def warm_as(self, before: Plane) -> None:
        """Take over the heat of the motors, which do not cool by a new configuration."""
        self._heat_ns = before._heat_ns
        for joint, same in zip(self.joints, before.joints, strict=True):
            joint.heat = same.heat

    def measures(self, now_ns: int) -> bool:
        """Return whether both drives have told their positions lately, at now_ns [ns]."""
        return self._acted.fresh(now_ns)

    def restart(self) -> None:
        """Forget what was asked for, forces and positions, the home too: for a start of the loop.

        Nobody listened before it.
        """
        self.guide = Guide(self.guide.limits, self.guide.reach)
        self.wanted = SetpointInput(axes=2)
        self.output: PlanarOutput | None = None
        self.written = (0.0, 0.0)
        self.hot = False
        self.meter = DeadlineMeter(self._period_ns)
        self.skipped = 0
        self._ticker = Ticker(self._clock, self._period_ns)
        self.state = initial_state(self.settings)
        self._acted = Age(_FRESH_NS)
        self._forces = Stream("force sensor", self._period_ns, self.permit.fault, numbered=False)
        self._force_age = Age(_FORCE_PERIODS * self._period_ns, self._period_ns)
        self._hand = _UNKNOWN
        self._lose_homes()

    # One tick ------------------------------------------------------------------------------

    def step(self) -> None:
        """Do one tick; whatever goes wrong in it, both drives get a last zero."""
        try:
            self._step()
        except BaseException:
            self.permit.close()
            for drive in self._drives:
                with suppress(Exception):
                    drive.write(0.0, self._clock.now_ns())
            raise

    def _step(self) -> None:
        """Do one tick.

        The driver latches errors of the bus; state and diagnostics show them. Permit and writes run
        whatever else fails.
        """
        tick = self._ticker.sleep()
        self.skipped += tick.skipped
        now_ns = tick.monotonic_ns
        try:
            self.request(now_ns)
        except DeviceError:
            pass
        self._wires.read_inputs(now_ns)
        self._check(now_ns)
        answered = False
        try:
            answered = self._await_drives(now_ns)
        except DeviceError:
            pass
        try:
            if answered:
                self.act(now_ns)
                self.meter.tick(tick.sequence, now_ns, self._clock.now_ns())
            else:
                self.idle(now_ns)
        except DeviceError:
            pass
        self._wires.publish_state(tick)

    def request(self, now_ns: int) -> None:
        """Send SYNC and heartbeat; the heartbeat also when SYNC fails. Raises BusError."""
        shoulder, elbow = self._drives
        try:
            shoulder.sync(now_ns)
        finally:
            shoulder.heartbeat(now_ns)
            elbow.heartbeat(now_ns)  # the drives share one heartbeat

    def on_force(self, sample: ForceReading, now_ns: int) -> None:
        """Check the force of the patient on the robot, and take it as the hand's."""
        if not self._forces.accept(sample.sequence, sample.monotonic_ns, now_ns):
            return
        size = math.hypot(sample.fx, sample.fy)
        problem = force_problem(sample, size, self._limits.handle_force_limit)
        self.permit.fault.set(problem)
        self._force_age.note(sample.monotonic_ns)
        self._hand = _UNKNOWN if problem else (sample.fx, sample.fy)

    def _check(self, now_ns: int) -> None:
        """Stop on missed deadlines, and on a force sensor that has gone silent."""
        self.permit.missed(self.meter.missed_in_a_row(now_ns), self._limits.missed_limit)
        if self._forces.seen and not self._force_age.fresh(now_ns):
            self._hand = _UNKNOWN
            if self.permit.enabled:
                self._forces.check_age(now_ns, self._force_age.limit_ns)

    def answered(self, since_ns: int) -> bool:
        """Return whether both drives have answered since `since_ns` [ns]."""
        for drive in self._drives:
            reading = drive.reading
            if reading is None or reading.monotonic_ns < since_ns:
                return False
        return True

    def _await_drives(self, since_ns: int) -> bool:
        due_ns = self._ticker.due_ns()
        while not self.answered(since_ns):
            if self._clock.now_ns() >= due_ns:
                return False
            self._port.pump(due_ns)
        return True

    def act(self, now_ns: int) -> None:
        """Read both positions and write both torques, the second also when the first fails.

        Raises BusError.
        """
        last_ns = self._acted.stamp_ns
        elapsed_ns = now_ns - last_ns if last_ns else self._period_ns
        self._acted.note(now_ns)
        self._measure(max(1, round(elapsed_ns / self._period_ns)))
        self._check_frozen()
        shoulder, elbow = self.motions
        acts = shoulder.homed and elbow.homed and self.permit.enabled
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
            *self._guidance(now_ns, elapsed_ns * 1e-9),
            *self._hand,
        )
        self.output = planar_step(self.settings, self.state, inp, elapsed_ns * 1e-9)
        self._write(now_ns)

    def idle(self, now_ns: int) -> None:
        """Write zero in a tick without both answers; latch a fault after too many such ticks.

        Raises BusError, after both writes.
        """
        silent_ns = now_ns - self._acted.stamp_ns
        if self.permit.enabled and silent_ns > self._joint_settings.silence * self._period_ns:
            self.permit.fault.set(f"no position for {silent_ns * 1e-6:.0f} ms")
        self.output = None
        self.state = initial_state(self.settings)
        self._write(now_ns)

    def _measure(self, periods: int) -> None:
        for drive, joint in zip(self._drives, self.joints, strict=True):
            assert drive.reading is not None, "the caller waits for both answers"
            if wrong := joint.take(drive.reading.position, periods):
                self.permit.fault.set(f"{drive.label} {wrong}")

    def _guidance(self, now_ns: int, dt: float) -> Guidance:
        if self.guide.free:
            return NO_GUIDANCE
        shoulder, elbow = self.motions
        x, y = forward(shoulder.position, elbow.position, self.settings.arm)
        x_s, x_e, y_s, y_e = jacobian(shoulder.position, elbow.position, self.settings.arm)
        vx = x_s * shoulder.velocity + x_e * elbow.velocity
        vy = y_s * shoulder.velocity + y_e * elbow.velocity
        return self.guide.guidance(x, y, vx, vy, now_ns, dt)

    def _check_frozen(self) -> None:
        """Look for a frozen position while torque passes; `written` acted until now."""
        if not self.permit.enabled:
            for joint in self.joints:
                joint.frozen.restart()
            return
        angles = self.motions[0].position, self.motions[1].position
        judged = clear_of_stops(self.settings, *angles)
        pushed = hand_torques(*angles, *self._hand, self.settings.arm) if judged else _UNKNOWN
        for drive, joint, torque, push in zip(
            self._drives, self.joints, self.written, pushed, strict=True
        ):
            if wrong := joint.check_frozen(torque + push):
                self.permit.fault.set(f"{drive.label}: {wrong}")

    def _write(self, now_ns: int) -> None:
        # The law used the positions of this tick: their age is the command's age.
        scale = self.permit.step(self._acted.stamp_ns, now_ns)
        output = self.output
        wanted = (output.shoulder_torque, output.elbow_torque) if output else (0.0, 0.0)
        kept = self._cooled(now_ns, scale, wanted)
        written, failed = [0.0, 0.0], None
        for number, (drive, torque) in enumerate(zip(self._drives, wanted, strict=True)):
            try:
                written[number] = drive.write(kept * torque, now_ns)
            except BusError as error:  # the other drive still needs its command
                failed = failed or error
        self.written = written[0], written[1]
        if failed is not None:
            raise failed

    def _cooled(self, now_ns: int, scale: float, wanted: tuple[float, float]) -> float:
        """Take the heat of both motors to now; return the factor of the wanted torques [Nm].

        It is `scale`, or less where a motor is too hot: one factor keeps the force's direction.
        """
        elapsed = (now_ns - self._heat_ns) * 1e-9
        self._heat_ns = now_ns
        factor = scale
        for joint, acted, torque in zip(self.joints, self.written, wanted, strict=True):
            limits, size = joint.limits, abs(torque)
            joint.heat += (acted * acted - joint.heat) * min(1.0, elapsed / limits.time_constant)
            if factor * size > limits.continuous:
                largest = largest_torque(limits, joint.heat, self._period_ns * 1e-9)
                factor = min(factor, largest / size)
        self.hot = factor < scale
        return factor

    # -- any thread ------------------------------------------------------------------------------

    def home(self, clock: Clock) -> str:
        """Declare that the handle stands at the reference mark; return why not, empty if done.

        Refused while enabled, moving or without answers. Needs a second call when it contradicts
        the last homing (`Doubt`). The loop carries it out. clock: of the wait.
        """
        return self.permit.requests.ask(lambda: self.take_home(clock.now_ns()), clock)

    def take_home(self, now_ns: int) -> str:
        """Carry out a homing at now_ns [ns]; for the loop's thread."""
        settings = self._joint_settings
        if not self.permit.at_rest(now_ns):
            return "the plane is enabled: disable it first"
        if not self.measures(now_ns):
            return "the drives do not answer"
        for drive, joint in zip(self._drives, self.joints, strict=True):
            if abs(speed := joint.motion.velocity) > settings.home_speed_limit:
                return (
                    f"{drive.label} turns at {speed:.3f} rad/s; let the handle rest at the "
                    "reference mark"
                )
        mark = settings.home_x, settings.home_y
        if self.homed or self._doubt.contradicted:
            shoulder, elbow = self.motions
            place = forward(shoulder.position, elbow.position, self.settings.arm)
            if refused := self._doubt.rejection(mark, place, now_ns):
                for joint in self.joints:
                    joint.motion.homed = False
                return refused
        angles = inverse(*mark, self.settings.arm)
        for joint, angle in zip(self.joints, angles, strict=True):
            joint.motion.home(angle)
        return ""

    def enable(self, clock: Clock) -> str:
        """Enable both drives; return why not, empty if done. clock: see `Permit.enable`."""
        if not self.homed:
            return "not homed: call ~/home first"
        if self._limits.force_required and not self._forces.seen:
            return "force sensor: no sample yet"
        return self.permit.enable(clock)

    def clear_fault(self, clock: Clock) -> str:
        """Recover both drives; home again if one counts from elsewhere now. See `Permit`."""
        elsewhere = any(not drive.running or drive.altered for drive in self._drives)
        problem = self.permit.clear_fault(clock)
        if elsewhere:
            self._lose_homes()
        return problem

    def _lose_homes(self) -> None:
        self._doubt.forget()
        for joint in self.joints:
            joint.motion.restart()

    def shutdown(self) -> str:
        """Shut both drives down cleanly after the loop has ended; return the errors."""
        self.permit.close()  # else the next start would report a stale command
        return drive_group.leave(self._drives, self._port)


def hand_torques(
    shoulder: float, elbow: float, fx: float, fy: float, arm: PlanarArm = MANUS
) -> tuple[float, float]:
    """Return the torques of a handle force [N] at both joints [Nm]: J^T F, angles in rad."""
    x_s, x_e, y_s, y_e = jacobian(shoulder, elbow, arm)
    return x_s * fx + y_s * fy, x_e * fx + y_e * fy


def clear_of_stops(settings: PlanarSettings, shoulder: float, elbow: float) -> bool:
    """Return whether both joints [rad] are within their range, where no stop touches them."""
    return (
        settings.shoulder_low < shoulder < settings.shoulder_high
        and settings.elbow_low < elbow < settings.elbow_high
        and settings.between_low < elbow - shoulder < settings.between_high
    )
