# SPDX-License-Identifier: Apache-2.0
"""`manus`: the planar axes, MIT-MANUS: two CiA 402 drives and the planar impedance."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated, NamedTuple

from screw_module_msgs.msg import PlanarState
from screw_module_msgs.srv import SetImpedance
from std_srvs.srv import Trigger

from screw_module_ros import graph
from screw_module_ros.control.gain_guard import guarded
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.slot import SlotLimits
from screw_module_ros.devices.canopen import Heartbeat
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import JOINTS, SHARED, DriveSettings, adapted
from screw_module_ros.geometry import PlanarArm, inverse, reaches
from screw_module_ros.loop.plane import Plane, PlaneWires
from screw_module_ros.loop.plane_controller import JointSettings, PlaneLimits, clear_of_stops
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

    state_every: Annotated[int, Setting(f"ticks per {graph.MANUS_STATE} message", "", 1, 100)] = 4


class ManusNode(DriveNode):
    """One tick: SYNC, both positions, law, both torques."""

    def __init__(self) -> None:
        super().__init__("manus", rate=JOINTS["shoulder"].rate)
        self.parameters.declare(
            ManusSettings, PlaneLimits, SharedSettings, PlanarSettings, joints=JointSettings,
            freeze=FreezeSettings, arm=PlanarArm, slot=SlotLimits,
        )  # fmt: skip
        for joint, own in JOINTS.items():
            self.parameters.declare_with(DriveSettings, joint, ("rate", *SHARED), **own._asdict())
        self._state = at_base(PlanarState)
        self._latency_p99 = 0.0
        self.serve(Trigger, "~/home", self._home, "homed at the reference mark")
        impedance = partial(set_impedance, self.parameters, PlanarSettings)
        self.serve(SetImpedance, "~/set_impedance", impedance, always=True)

    # Lifecycle -----------------------------------------------------------------------------

    def connect(self) -> None:
        """Find both drives, configure them and their guards."""
        law = self._law_settings().validated()
        place = self.parameters.read(JointSettings, "joints")
        if not reaches(place.home_x, place.home_y, law.arm):
            raise SettingError(
                f"joints.home_x, joints.home_y = {place.home_x:g}, {place.home_y:g} m: the arm "
                "does not reach there; its own are arm.upper_arm, arm.forearm, arm.base_x, "
                "arm.base_y"
            )
        pose = inverse(place.home_x, place.home_y, law.arm)
        if not clear_of_stops(law, *pose):
            raise SettingError(
                f"joints.home_x, joints.home_y = {place.home_x:g}, {place.home_y:g} m: there, with "
                f"arm.elbow = {law.arm.elbow}, shoulder and elbow stand at {pose[0]:.2f} and "
                f"{pose[1]:.2f} rad, beyond shoulder_*, elbow_* or between_*: base, side of the "
                "elbow and joint limits must fit together"
            )
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
        )
        plane.drives.warm_as(getattr(self, "_plane", plane).drives)
        self._plane = plane
        self._make_topics()

    def _law_settings(self) -> PlanarSettings:
        arm = self.parameters.read(PlanarArm, "arm")
        return self.parameters.read(PlanarSettings)._replace(arm=arm)

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
        state = self._state
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
        now_ns, state = self.clock.now_ns(), self._state
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
    message.stiffness, message.damping = controller.state.stiffness, controller.state.damping
    message.samples = plane.meter.samples
    fill_counts(message, plane.meter, now_ns)
