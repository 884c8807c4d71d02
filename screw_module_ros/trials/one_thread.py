# SPDX-License-Identifier: Apache-2.0
"""The whole robot in one thread: the loops of the nodes, the buses, the simulated rig.

`tick` is one period of both loops. Their waits serve the rig and move the time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.can_io.port import Port
from screw_module_ros.clock import ManualClock
from screw_module_ros.control import arms
from screw_module_ros.control.law import Law
from screw_module_ros.control.laws import LAWS, flaw
from screw_module_ros.control.laws import plane as plane_laws
from screw_module_ros.control.laws.plane_impedance import PLANE_IMPEDANCE
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.planar_settings import STUDIED_GAIN, PlanarSettings
from screw_module_ros.control.plane_law import PlaneLaw
from screw_module_ros.control.torque_chain import TorqueChain
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.devices import force_sensors
from screw_module_ros.devices.canopen import Heartbeat
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.encoder import Encoder
from screw_module_ros.devices.encoder_setup import EncoderSettings
from screw_module_ros.devices.errors import NotNow
from screw_module_ros.devices.force_base import ForceSensor
from screw_module_ros.devices.force_sensor_settings import ForceSensorSettings
from screw_module_ros.geometry import SCREW, Screw
from screw_module_ros.lockstep.rounds import NearFrames, Rounds
from screw_module_ros.loop import gate
from screw_module_ros.loop.controller import VerticalController
from screw_module_ros.loop.drive import VerticalDrive
from screw_module_ros.loop.plane import Plane
from screw_module_ros.loop.plane_controller import JointSettings
from screw_module_ros.loop.requests import Requests
from screw_module_ros.loop.sensor import PolledSensor
from screw_module_ros.loop.vertical import Roles, VerticalLoop, Wires
from screw_module_ros.plant.plane_plant import MANUS_PLANT, PlanePlant
from screw_module_ros.plant.world import World, WorldSettings, load_world
from screw_module_ros.profiles import (
    DRIVE,
    ENCODER,
    FORCE_SENSOR,
    GENERIC_402,
    GENERIC_406,
    NETCANOEM,
    load,
)
from screw_module_ros.rig.local_bus import LocalHub
from screw_module_ros.rig.rig import Rig, RigSettings
from screw_module_ros.safety.checks import AgreementSettings, WatchSettings
from screw_module_ros.safety.permit import PermitSettings
from screw_module_ros.samples import EncoderReading, ForceReading
from screw_module_ros.settings import SettingError

PERIOD_NS = 1_000_000
BUSES = ("encoder", "drive", "force_sensor", "planar")
_POLL_TICKS = 100  # ticks between two looks at what the drive has to be asked for
_COMMAND_DELAY_NS = 250_000
_START_NS = 1_000_000_000_000

Answer = TypeVar("Answer")


class OneThreadClock(ManualClock):
    """A wait of the loops serves the rig and moves time; one of an act ends between two ticks.

    rounds: the acts that wait, each a greenlet.
    """

    def __init__(self) -> None:
        super().__init__(_START_NS)
        self.rounds = Rounds()

    def sleep_until(self, due_ns: int) -> None:
        """Advance the time to `due_ns`; in an act, return when it is."""
        if self.time_ns >= due_ns or not self.rounds.wait(due_ns):
            self.time_ns = max(self.time_ns, due_ns)
            self.rounds.serve(self.time_ns)

    def arrivals(self, frames: Any) -> NearFrames:
        """Return the arrivals of a bus."""
        return NearFrames(self, frames)

    def await_frame(self, until_ns: int, at: NearFrames) -> bool:
        """Let the rig answer; return whether it has before `until_ns`, when it is that time."""
        self.rounds.serve(self.time_ns)
        if at.queue:
            return True
        self.sleep_until(until_ns)
        return False


class Row(NamedTuple):
    """What one tick came to; force: commanded, patient: on the handle, both [N].

    plane: written torques [Nm]; plane_reason: why there are none.
    """

    time: float
    position: float
    velocity: float
    patient: float
    force: float
    torque: float
    reason: str
    plane: tuple[float, float]
    plane_reason: str


def _check_plane(law: PlaneLaw, arm: arms.Arm) -> None:
    """Raise SettingError when a law or an arm of others cannot be taken."""
    if law not in plane_laws.PLANE_LAWS and (wrong := plane_laws.flaw(law)):
        raise SettingError(f"law {law.name}: {wrong}")
    if arm is not arms.FIVE_BAR and (wrong := arms.flaw(arm)):
        raise SettingError(f"arm {arm.name}: {wrong}")


class OneThreadRobot:
    """One robot. `tick` is one period; `rows` is what happened.

    laws: with those of others; work_ns: processor time that a law counts as used [ns], see
    `LawRunner`; screw: for which encoder and amplifier are set, amplifier_screw: the
    amplifier where it is another. plane_law, arm: of the plane's
    controller; plane_plant: the simulated arm. buses: the rig's ends; `join` makes another member.
    """

    def __init__(
        self,
        seed: int = 1,
        drive: DriveSettings | None = None,
        drive_profile: str = GENERIC_402,
        encoder_profile: str = GENERIC_406,
        sensor_profile: str = NETCANOEM,
        world: WorldSettings | None = None,
        laws: tuple[Law, ...] = LAWS,
        work_ns: Callable[[], int] | None = None,
        screw: Screw = SCREW,
        amplifier_screw: Screw | None = None,
        plane_law: PlaneLaw = PLANE_IMPEDANCE,
        arm: arms.Arm = arms.FIVE_BAR,
        plane_plant: PlanePlant = MANUS_PLANT,
    ):
        turning = amplifier_screw or screw
        self.buses = {bus: LocalHub(bus) for bus in BUSES}
        self.world = World(world or load_world(), seed, plane=plane_plant)
        self.clock = OneThreadClock()
        self.requests = Requests(self.clock)
        settings = RigSettings(
            command_latency=_COMMAND_DELAY_NS * 1e-9,
            drive_profile=drive_profile,
            encoder_profile=encoder_profile,
            sensor_profile=sensor_profile,
        )
        profile, counter = load(drive_profile, DRIVE), load(encoder_profile, ENCODER)
        for law in laws[len(LAWS) :]:
            if wrong := flaw(law):
                raise SettingError(f"law {law.name}: {wrong}")
        _check_plane(plane_law, arm)
        self.rig = Rig(self.buses, self.world, self.clock, PERIOD_NS, settings)
        self.clock.rounds.serve = self._serve
        self._kept_ns = 0
        self.ports = {
            bus: Port(hub.join(), clock=self.clock, open_anew=hub.join)
            for bus, hub in self.buses.items()
        }
        self.home = self.world.settings.start.position
        counting = EncoderSettings(home_position=self.home, **counter.simulated.parameters)
        self.encoder = Encoder(self.ports["encoder"], counting, screw, profile=counter)
        needed = load(sensor_profile, FORCE_SENSOR).simulated.parameters
        chosen = ForceSensorSettings(profile=sensor_profile, **needed)
        self.force_sensor = force_sensors.driver(
            chosen, lambda *_claims: self.ports["force_sensor"], self.clock
        )
        drive = (drive or DriveSettings())._replace(**profile.simulated.parameters)
        self.drive = Drive(self.ports["drive"], drive, per_turn=turning.lead, profile=profile)
        beat = Heartbeat(self.ports["planar"], 113, self.drive.settings.heartbeat_period)
        shoulder, elbow = (
            Drive(
                self.ports["planar"],
                drive._replace(node_id=node, master_id=113, rated_torque=10.0, max_torque=25.0,
                               counts_per_turn=65536),  # fmt: skip
                f"{label} drive",
                beat,
                profile=profile,
            )
            for node, label in ((3, "shoulder"), (4, "elbow"))
        )
        self.planar_drives = shoulder, elbow
        self.controller = VerticalController(
            VerticalSettings(),
            thesis_friction(),
            WatchSettings(),
            AgreementSettings(),
            PERIOD_NS,
            laws=laws,
            work_ns=work_ns,
        )
        self.axis = VerticalDrive(
            self.drive,
            self.ports["drive"],
            PERIOD_NS,
            PermitSettings(),
            TorqueChain(screw=turning, linearization=default_linearization()),
        )
        self.plane = Plane(
            self.planar_drives, self.ports["planar"], PERIOD_NS,
            PlanarSettings(force_gain=STUDIED_GAIN, arm=arm.settings(), **arm.limits),
            JointSettings(), PermitSettings(), law=plane_law, arm=arm, work_ns=work_ns,
        )  # fmt: skip
        self.setpoint = (math.nan, 0.0)
        self.planar_setpoint = (math.nan, math.nan, 0.0, 0.0)
        self.permitted = True
        self.commanding = self.plane_hears_force = True
        self.rows: list[Row] = []
        self._sample: EncoderReading | None = None
        self._readings: list[ForceReading] = []
        self._make_loops()
        self.devices: tuple[Encoder | ForceSensor | Drive, ...] = (
            self.encoder, self.force_sensor, self.drive, *self.planar_drives
        )

    def _make_loops(self) -> None:
        clock, ports = self.clock, self.ports
        self.roles = Roles(
            PolledSensor(self.encoder, ports["encoder"], clock),
            PolledSensor(self.force_sensor, self.force_sensor.port, clock),
            self.controller,
            self.axis,
        )
        wires = Wires(publish_sample=self._on_sample, publish_force=self._on_force)
        self.vertical = VerticalLoop(clock, PERIOD_NS, wires)

    @property
    def now_ns(self) -> int:
        """The time [ns]."""
        return self.clock.time_ns

    # Bring-up ------------------------------------------------------------------------------

    def connect(self) -> None:
        """Configure and start every device against the rig."""
        for device in self.devices:
            device.configure()
        for device in self.devices:
            device.start()

    def ready(self) -> None:
        """Connect, home, tare, and let the gate have fresh commands."""
        self.connect()
        self.ticks(30)
        self.encoder.home()
        if refused := self.plane.take_home(self.now_ns):
            raise NotNow(refused)
        self.force_sensor.tare(self.gather(120))
        self.ticks(20)

    def gather(self, count: int) -> list:
        """Return the force readings of `count` ticks."""
        self._readings = []
        self.ticks(count)
        return self._readings

    def enable(self) -> str:
        """Enable the vertical axis; return why not."""
        return self.served(lambda: gate.enable(self.axis.permit, self.requests))

    def disable(self) -> str:
        """Disable the vertical axis; return why not."""
        self.served(lambda: gate.disable(self.axis.permit, self.requests))
        return ""

    def enable_plane(self) -> str:
        """Enable the planar axes; return why not."""
        return self.served(lambda: self.plane.enable(self.requests))

    def clear_fault(self) -> str:
        """Clear the vertical axis's faults; return what is left."""
        return self.served(lambda: gate.clear_fault(self.axis.permit, self.requests))

    def clear_plane_fault(self) -> str:
        """Clear the planar axes' faults; return what is left."""
        return self.served(lambda: self.plane.clear_fault(self.requests))

    def served(self, act: Callable[[], Answer]) -> Answer:
        """Return what an act returns that waits while the loops tick, as services do.

        It goes on between two ticks, until it waits for a later time: within a tick it would find
        things now done and now not yet. Raises what the act raises.
        """
        rounds, answers = self.clock.rounds, list[Answer]()
        rounds.add(lambda: answers.append(act()))
        for port in self.ports.values():
            port.pump()  # as loops do that tick: else the act reads, and they wait for it
        rounds.run_ready(self.now_ns)
        while not answers:
            self.tick()
            rounds.run_ready(self.now_ns)
        return answers[0]

    # Running -------------------------------------------------------------------------------

    def ticks(self, count: int) -> list[Row]:
        """Run `count` ticks; return their rows. The drive is asked for what it does not report."""
        end = len(self.rows) + count
        while len(self.rows) < end:
            look = len(self.rows) % _POLL_TICKS == 0
            if look and self.drive.poll_due(self.now_ns):
                self.poll_slow()
            else:
                self.tick()
        return self.rows[-count:]

    def poll_slow(self) -> None:
        """Ask the vertical drive for what it does not report by itself, as its node does."""
        self.served(self.drive.poll_slow)

    def seconds(self, duration: float) -> list[Row]:
        """Run for `duration` [s] of simulated time; return the rows."""
        return self.ticks(round(duration * 1e9 / PERIOD_NS))

    def tick(self) -> None:
        """One period of both loops."""
        now, refused = self.now_ns, "" if self.permitted else "test"
        for permit in (self.axis.permit, self.plane.drives.permit):
            permit.supervise(self.permitted, refused, now)
        self.controller.wanted.ask(self.setpoint[:1], self.setpoint[1:], now)
        self.plane.controller.wanted.ask(self.planar_setpoint[:2], self.planar_setpoint[2:], now)
        self._sample = None
        self.requests.serve()
        commanded = self.roles if self.commanding else self.roles._replace(controller=None)
        self.vertical.step(commanded)
        self.plane.step()
        self._serve(self.now_ns)
        self.rows.append(self._row(self._sample))

    def _serve(self, now_ns: int) -> None:
        """Let the rig answer; its timers run once for each time, as in lock step."""
        if now_ns == self._kept_ns:
            self.rig.serve(now_ns)
        else:
            self.rig.process(now_ns)
            self._kept_ns = now_ns

    def _on_sample(self, sample: EncoderReading) -> None:
        self._sample = sample

    def _on_force(self, force: ForceReading) -> None:
        self._readings.append(force)
        if self.plane_hears_force:
            self.plane.controller.on_force(force, self.now_ns)

    def _row(self, sample: EncoderReading | None) -> Row:
        controller, axis = self.controller, self.axis
        return Row(
            self.world.simulated_time,
            sample.position if sample else math.nan,
            sample.velocity if sample else math.nan,
            controller.handle_force,
            controller.output.force,
            axis.last.command,
            axis.permit.reason or controller.reason,
            self.plane.drives.written,
            self.plane.drives.permit.reason,
        )

    def close(self) -> None:
        """Close all buses."""
        self.rig.close()
        for port in self.ports.values():
            port.close()
        for hub in self.buses.values():
            hub.shutdown()
