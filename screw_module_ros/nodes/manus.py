# SPDX-License-Identifier: Apache-2.0
"""`manus`: the planar axes, MIT-MANUS: two CiA 402 drives and the planar impedance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, NamedTuple

from screw_module_msgs.msg import PlanarState
from screw_module_msgs.srv import SetImpedance
from std_srvs.srv import Trigger

from screw_module_ros import graph
from screw_module_ros.calibration.limits_file import GainLimitsSettings
from screw_module_ros.calibration.plane_limits import (
    WITHOUT,
    PlaneGainLimits,
    load_plane_limits,
)
from screw_module_ros.calibration.plane_version import arm_version, plane_law_version
from screw_module_ros.control import arms
from screw_module_ros.control.gain_guard import guarded
from screw_module_ros.control.laws import GROUP, refusal
from screw_module_ros.control.laws import plane as plane_laws
from screw_module_ros.control.laws.plane_impedance import PLANE_IMPEDANCE
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.slot import SlotLimits
from screw_module_ros.devices.canopen import Heartbeat
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import JOINTS, SHARED, DriveSettings, adapted
from screw_module_ros.loop.plane import Plane, PlaneWires
from screw_module_ros.loop.plane_controller import JointSettings, PlaneLimits, clear_of_stops
from screw_module_ros.loop.plane_drives import PlaneDrives
from screw_module_ros.loop.ticker import Tick
from screw_module_ros.profiles import DRIVE, GENERIC_402, load
from screw_module_ros.safety.checks import FreezeSettings
from screw_module_ros.safety.permit import Permit, PermitSettings
from screw_module_ros.settings import Setting, SettingError, fields

from .support.driver import RateSettings, device_values
from .support.drives import PLANAR, DriveNode
from .support.law_inputs import SlotInbox, set_impedance
from .support.states import OK, WARN, Health, at_base, fill_counts, fill_permit
from .support.topics import offered, requested

_UNKNOWN = [math.nan, math.nan]


class SharedSettings(NamedTuple):
    """Settings that both drives share: those of `SHARED`."""

    master_id: Annotated[int, fields(DriveSettings)["master_id"].setting] = (
        JOINTS["shoulder"].master_id
    )
    profile: Annotated[str, fields(DriveSettings)["profile"].setting] = GENERIC_402
    waived: Annotated[str, fields(DriveSettings)["waived"].setting] = ""
    allow_no_heartbeat: Annotated[
        bool, fields(DriveSettings)["allow_no_heartbeat"].setting
    ] = False


class ManusSettings(NamedTuple):
    """Settings of the node beside those of drives and law."""

    module_serial: Annotated[
        str, Setting("serial of this robot: gain limits of another one are refused")
    ] = ""
    state_every: Annotated[int, Setting(f"ticks per {graph.MANUS_STATE} message", "", 1, 100)] = 4
    law: Annotated[
        str, Setting(f"law of the plane: {PLANE_IMPEDANCE.name}, package.module:NAME, or an entry "
                     f"point of {GROUP}", at_start=True)
    ] = PLANE_IMPEDANCE.name
    arm: Annotated[
        str, Setting(f"arm: {arms.FIVE_BAR.name}, package.module:NAME, or an entry point of "
                     f"{arms.GROUP}", at_start=True)
    ] = arms.FIVE_BAR.name


class ManusNode(DriveNode):
    """One tick: SYNC, both positions, law, both torques. state: the newest message."""

    def __init__(self) -> None:
        super().__init__("manus", rate=JOINTS["shoulder"].rate)
        self.parameters.declare(
            ManusSettings, PlaneLimits, SharedSettings, GainLimitsSettings, joints=JointSettings,
            freeze=FreezeSettings, slot=SlotLimits,
        )  # fmt: skip
        chosen = self.parameters.read(ManusSettings)
        self._arm, self._law = arms.load(chosen.arm), plane_laws.load(chosen.law)
        limits: Any = {name: float(limit) for name, limit in self._arm.limits.items()}
        self.parameters.declare_with(PlanarSettings, **limits)
        self.parameters.declare(arm=self._arm.settings)
        for joint, own in JOINTS.items():
            self.parameters.declare_with(DriveSettings, joint, ("rate", *SHARED), **own._asdict())
        if self._law not in plane_laws.PLANE_LAWS:
            self.parameters.declare_law(self._law.name, self._law.settings)
        self.state = at_base(PlanarState)
        self.state.law = f"{self._law.name} {plane_law_version(self._law)}"
        self.state.arm = f"{self._arm.name} {arm_version(self._arm)}"
        self._latency_p99 = 0.0
        self._limits: PlaneGainLimits | None = None
        self._warm: PlaneDrives | None = None  # of the last configuration: no motor cools by one
        self.serve(Trigger, "~/home", self._home, "homed at the reference mark")
        impedance = partial(set_impedance, self.parameters, PlanarSettings)
        self.serve(SetImpedance, "~/set_impedance", impedance, always=True)

    # Lifecycle -----------------------------------------------------------------------------

    def connect(self) -> None:
        """Find both drives, configure them and their guards."""
        law = self._law_settings().validated()
        place = self.parameters.read(JointSettings, "joints")
        self._check_arm(law, place)
        limited = self.parameters.read(GainLimitsSettings).gain_limits_file
        serial = self.parameters.read(ManusSettings).module_serial
        self._limits = load_plane_limits(limited, serial) if limited else None
        if refused := self.refusal({}) or (self._own() is None and self._beyond_limits()):
            raise SettingError(refused)
        profile = load(self.parameters.read(SharedSettings).profile, DRIVE)
        settings = [
            adapted(self._drive_settings("shoulder", law.shoulder_torque), profile.drive),
            adapted(self._drive_settings("elbow", law.elbow_torque), profile.drive),
        ]
        port = self.open_port(*dict.fromkeys(name for each in settings for name in each.claims))
        beat = Heartbeat(port, settings[0].master_id, settings[0].heartbeat_period)
        shoulder, elbow = (
            Drive(port, each, f"{joint} drive", beat, profile=profile)
            for joint, each in zip(JOINTS, settings, strict=True)
        )
        self.configure_drives(shoulder, elbow)
        self.check_bus_load([*shoulder.traffic, *elbow.traffic[1:]])
        self._state_every = self.parameters.read(ManusSettings).state_every
        plane = Plane(
            (shoulder, elbow),
            port,
            self.period_ns,
            law,
            place,
            self.parameters.read(PermitSettings, "gate"),
            self.parameters.read(FreezeSettings, "freeze"),
            self.parameters.read(SlotLimits, "slot"),
            self.parameters.read(PlaneLimits),
            PlaneWires(self._read_inputs, self._publish_due_state),
            self._law,
            self._arm,
            self._own(),
            self.clock.work_ns,
        )
        if self._warm is not None:
            plane.drives.warm_as(self._warm)
        self._plane, self._warm = plane, plane.drives
        self._make_topics()

    def _check_arm(self, law: PlanarSettings, place: JointSettings) -> None:
        """Raise SettingError when an arm, its limits and the reference mark do not fit together."""
        arm, own, mark = self._arm, law.arm, (place.home_x, place.home_y)
        if arm is not arms.FIVE_BAR:
            wrong = arms.kinematics_flaw(arm, own, law.half_width, law.half_depth)
            if wrong:
                raise SettingError(f"arm {arm.name}: {wrong}")
        where = f"joints.home_x, joints.home_y = {mark[0]:g}, {mark[1]:g} m"
        if not arms.reaches(arm, *mark, own):
            names = ", ".join(f"arm.{name}" for name in own._fields)
            raise SettingError(f"{where}: the arm does not reach there; its own are {names}")
        pose = arm.inverse(*mark, own)
        if not clear_of_stops(arm, law, *pose):
            side = getattr(own, "elbow", "")
            raise SettingError(
                f"{where}: there{side and f', with arm.elbow = {side}'}, shoulder and elbow stand "
                f"at {pose[0]:.2f} and {pose[1]:.2f} rad, beyond shoulder_*, elbow_* or between_*: "
                "base, side of the elbow and joint limits must fit together"
            )

    def _law_settings(self) -> PlanarSettings:
        arm = self.parameters.read(self._arm.settings, "arm")
        return self.parameters.read(PlanarSettings)._replace(arm=arm)

    def _own(self, changes: Mapping[str, Any] = {}) -> Any:
        """Return the settings of a law of others, None of this package's."""
        if self._law in plane_laws.PLANE_LAWS:
            return None
        return self.parameters.read(self._law.settings, self._law.name, changes)

    def refusal(self, changes: Mapping[str, Any]) -> str:
        """Return why the law cannot run with its settings, or goes beyond the gain limits.

        Before it is configured it goes beyond none: `connect` loads them.
        """
        own = self._own(changes)
        if own is not None:
            return refusal(self._law, own)
        return self._beyond_limits(changes) if self.configured else ""

    def _beyond_limits(self, changes: Mapping[str, Any] = {}) -> str:
        law, limits = self.parameters.read(PlanarSettings, changes=changes), self._limits
        asked = self.parameters.read(GainLimitsSettings, changes=changes)
        if asked.beyond_gain_limits or law.force_gain == 0.0:
            return ""
        if limits:
            return limits.refusal(law, self.parameters.read(RateSettings).rate)
        return WITHOUT.format(gain=law.force_gain) if asked.gain_limits_required else ""

    def _drive_settings(self, joint: str, largest: float) -> DriveSettings:
        """Return the settings of a drive.

        largest: torque of the law; also the drive's own limit, unless max_torque is smaller.
        """
        found = self.parameters.read(DriveSettings, joint)
        return found._replace(
            rate=self.parameters.read(RateSettings).rate,
            max_torque=min(found.max_torque, largest),
            **self.parameters.read(SharedSettings)._asdict(),
        )

    def _make_topics(self) -> None:
        inbox = self.new_inbox()
        self._take_setpoint = inbox.subscribe(*requested(graph.SETPOINT))
        self._take_force = inbox.subscribe(*requested(graph.FORCE))
        self._slot = SlotInbox(inbox, vertical=False)
        self.follow(inbox, PLANAR, alone=graph.FORCE)
        self._pullers = self.senders(graph.SETPOINT)
        self._publish = self.outlet(*offered(graph.MANUS_STATE))

    def begin(self) -> None:
        """Start the drives, disabled."""
        self._plane.restart()
        self.start_drives()

    def leave(self) -> str:
        """Shut both drives down cleanly; return the errors."""
        return self._plane.drives.shutdown()

    def changed(self, kind: type) -> None:
        """Apply live parameters; the law fades them in."""
        if kind is PlanarSettings and self.configured:
            self._plane.controller.settings = self._law_settings()
        elif kind is self._law.settings and self.configured:
            self._plane.controller.laws.choose(self._own())

    # Hot loop ------------------------------------------------------------------------------

    def step(self) -> None:
        """One tick."""
        self._plane.step()

    def _read_inputs(self, now_ns: int) -> None:
        controller = self._plane.controller
        self.permission(self._plane.drives.permit, now_ns)
        force = self._take_force()
        if force is not None:
            controller.on_force(force, now_ns)
        self._slot.read(controller.guide, now_ns)
        wanted = self._take_setpoint()
        if wanted is not None:
            position, velocity = wanted.position, wanted.velocity
            controller.wanted.ask((position.x, position.y), (velocity.x, velocity.y), now_ns)

    def _publish_due_state(self, tick: Tick) -> None:
        if tick.sequence % self._state_every:
            return
        state = self.state
        self.stamp(state.header)
        state.sequence, state.monotonic_ns = tick.sequence, tick.monotonic_ns
        fill_plane(state, self._plane, tick.monotonic_ns)
        self._latency_p99 = self._plane.meter.latency(0.99)
        self._publish(state)

    # Services ------------------------------------------------------------------------------

    @property
    def permit(self) -> Permit:
        """The gate with both drives."""
        return self._plane.drives.permit

    def enable(self) -> str:
        """Enable both drives; return why not, empty if done. Refused while not homed."""
        return self._senders.count() or self._plane.enable(self.requests)

    def clear_fault(self) -> str:
        """Recover; a drive that restarted must be homed again."""
        return self._plane.clear_fault(self.requests)

    def _home(self, request: Trigger.Request) -> str:
        return self.requests.ask(lambda: self._plane.take_home(self.clock.now_ns()))

    def health(self) -> Health:
        """State of the drives, timing, counters."""
        # Another thread owns the meter: this is the value that the loop stored last.
        now_ns, state = self.clock.now_ns(), self.state
        controller, drives = self._plane.controller, self._plane.drives
        values = {
            "rate [1/s]": f"{state.rate:.0f}",
            "latency p99 [us]": f"{self._latency_p99 * 1e6:.0f}",
            "late": state.late,
            "lost": state.lost,
            "homed": controller.homed,
            "force gain [%]": f"{100.0 * controller.share:.0f}",
            "slot refused": self._slot.refused or "no",
            **self.port_values(self._plane.skipped),
        }
        for joint, drive, motor in zip(JOINTS, self.drives, drives.motors, strict=True):
            values[f"{joint} state"] = drive.state(now_ns).text
            values[f"{joint} heat [%]"] = f"{100.0 * motor.warmth:.0f}"
            counters = device_values(drive.counters)
            values.update({f"{joint} {name}": count for name, count in counters.items()})
        health, share = self.drive_health(values, state), controller.share
        warning = guarded(share) if share < 1.0 else self._pullers.warning
        if health.level == OK and warning:
            return health._replace(level=WARN, message=warning)
        return health


def fill_plane(message: PlanarState, plane: Plane, now_ns: int) -> None:
    """Write the plane's state into its message; where the drives are silent, NaN as positions."""
    controller, drives = plane.controller, plane.drives
    output = controller.output
    message.homed = controller.homed
    fill_permit(message, drives.permit)
    message.drive_state = [int(drive.state(now_ns)) for drive in drives.pair]
    message.error_code = [drive.error_code for drive in drives.pair]
    message.joint_position = [motion.position for motion in controller.motions]
    message.joint_velocity = [motion.velocity for motion in controller.motions]
    message.commanded_torque = list(drives.written)
    message.measured_torque = [
        drive.reading.torque if drive.reading else 0.0 for drive in drives.pair
    ]
    if output is not None:
        message.position = [output.x, output.y]
        message.velocity = [output.vx, output.vy]
        message.force = [output.force_x, output.force_y]
        message.desired_position = [output.desired_x, output.desired_y]
        message.saturated = output.saturated or drives.hot
    if not controller.measured.fresh(now_ns):
        message.position = message.velocity = _UNKNOWN
        message.joint_position = message.joint_velocity = _UNKNOWN
    state, shown = controller.laws.state, controller.laws.shown
    message.stiffness, message.damping = state.stiffness, state.damping
    message.law_names, message.law_values = list(shown), list(shown.values())
    message.samples = plane.meter.samples
    fill_counts(message, plane.meter, now_ns)
