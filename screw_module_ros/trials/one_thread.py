# SPDX-License-Identifier: Apache-2.0
"""The whole robot in one thread: the loops of the nodes, virtual buses, the simulated rig.

`tick` is one period of both loops. Their waits serve the rig and move the time.
"""

from __future__ import annotations

import math
import threading
import uuid
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import can
from can.interfaces.virtual import VirtualBus

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.can_io.frames import Frame, word_of
from screw_module_ros.can_io.port import Port
from screw_module_ros.clock import ManualClock, PlainArrivals
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
    """A wait of the loop's thread serves the rig and moves time; another one waits for that thread.

    `settle` lets the other thread run until it waits again, so that a run can be repeated exactly.
    """

    def __init__(self) -> None:
        super().__init__(_START_NS)
        self.serve: Callable[[], object] = lambda: None
        self._loop = threading.current_thread()
        self._turn = threading.Condition()
        self._may_go_on = True
        self._due_ns: int | None = None  # until when the other thread waits; None while it works

    def sleep_until(self, due_ns: int) -> None:
        """Advance the time to `due_ns`."""
        if threading.current_thread() is self._loop:
            self.time_ns = max(self.time_ns, due_ns)
            self.serve()
            if self._due_ns is not None:
                with self._turn:
                    self._turn.notify_all()
            return
        with self._turn:
            self._due_ns = due_ns
            self._turn.notify_all()
            self._turn.wait_for(lambda: self._may_go_on and self.time_ns >= due_ns)
            self._due_ns = None

    def settle(self, ended: list) -> None:
        """Wait until the other thread waits for a later time, or has put something in `ended`.

        Until it has, only meanwhile it goes on: within a tick it would find things now done and
        now not yet.
        """
        with self._turn:
            self._may_go_on = True
            self._turn.notify_all()
            self._turn.wait_for(lambda: ended or (self._due_ns or 0) > self.time_ns)
            self._may_go_on = bool(ended)

    def run(self, work: Callable[[], object], ended: list) -> None:
        """Do the other thread's work, and note in `ended` that it is done."""
        work()
        with self._turn:
            ended.append(True)
            self._turn.notify_all()

    def arrivals(self, frames: Any) -> Served:
        """Return the arrivals of a bus; a wait for a frame lets the rig answer."""
        return Served(self, frames)


class Served(PlainArrivals):
    """What the rig sends on one bus: it may answer before time moves."""

    _clock: OneThreadClock

    def receive(self, until_ns: int) -> Frame | None:
        """Return the next frame; None without one, when time has moved to `until_ns`."""
        waiting = self._frames.queue
        if not waiting and until_ns:
            self._clock.serve()
            if not waiting:
                self._clock.sleep_until(until_ns)
                return None
        return waiting.popleft() if waiting else None


class FrameQueue(deque):
    """Frames that wait at one end of a bus; python-can's own ends put messages into it."""

    def put(self, message: can.Message, **_: Any) -> None:
        """Take a message."""
        self.append((word_of(message), bytes(message.data)))


class InProcessBus(VirtualBus):
    """python-can's `virtual` bus without a message for each frame and a lock for each queue."""

    queue: Any  # a FrameQueue, in place of a `queue.Queue`
    channel: list[Any]

    def __init__(self, channel: str):
        super().__init__(channel)
        at = next(i for i, queue in enumerate(self.channel) if queue is self.queue)
        self.queue = self.channel[at] = FrameQueue()

    def send_frame(self, can_id: int, data: bytes) -> None:
        """Hand a plain frame to every other end of the channel."""
        for queue in self.channel:
            if type(queue) is FrameQueue:
                if queue is not self.queue:
                    queue.append((can_id, data))
            else:
                message = can.Message(arbitration_id=can_id, data=data, is_extended_id=False)
                queue.put(message)

    def receive_frame(self, _timeout_s: float) -> Frame | None:
        """Return the next frame, None without one; never waits."""
        return self.queue.popleft() if self.queue else None


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
    controller; plane_plant: the simulated arm.
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
        name = uuid.uuid4().hex
        self._buses: list[can.BusABC] = []
        far = {bus: self._bus(f"{name}-{bus}") for bus in BUSES}
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
        self.rig = Rig(far, self.world, self.clock, PERIOD_NS, settings)
        self.clock.serve = self._serve
        self._kept_ns = 0
        self.ports = {bus: Port(self._bus(f"{name}-{bus}"), clock=self.clock) for bus in BUSES}
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

    def _bus(self, channel: str) -> can.BusABC:
        bus = InProcessBus(channel)
        self._buses.append(bus)
        return bus

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
        """Return what an act returns that runs in a thread while the loop ticks, as services do.

        Raises what the act raises.
        """
        ended: list[bool] = []
        asked = Requests(self.clock)
        answer = asked.put(act)
        thread = threading.Thread(
            target=self.clock.run, args=(asked.serve, ended), daemon=True
        )  # a failing test must end
        for port in self.ports.values():
            port.pump()  # as loops do that tick: else the thread reads itself, and they wait for it
        thread.start()
        self.clock.settle(ended)
        while not ended:
            self.tick()
            self.clock.settle(ended)
        thread.join()
        return answer.result()

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
        self._serve()
        self.rows.append(self._row(self._sample))

    def _serve(self) -> None:
        """Let the rig answer; its timers run once for each time, as in lock step."""
        now_ns = self.now_ns
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
        for bus in self._buses:
            bus.shutdown()
