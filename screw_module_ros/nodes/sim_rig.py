# SPDX-License-Identifier: Apache-2.0
"""`sim_rig`: the simulated robot, with the same CAN frames as the hardware.

Its devices communicate with the rest of the graph by CAN only; `sim/truth` is for tests and
figures. The patient sees what the robot is asked for (`simulated_patient.py`).
"""

from __future__ import annotations

import os
import queue
from collections.abc import Callable
from functools import partial
from typing import Annotated, NamedTuple

import can
from rosgraph_msgs.msg import Clock as ClockMessage
from screw_module_msgs.msg import SimTruth
from screw_module_msgs.srv import InjectFault, SetArm, SetFixture

from screw_module_ros import graph
from screw_module_ros.can_io.bus import BusSettings, open_bus, where, within
from screw_module_ros.clock import WallClock
from screw_module_ros.locks import lock_simulation
from screw_module_ros.lockstep.clock import SimulatedClock
from screw_module_ros.lockstep.conductor import Conductor
from screw_module_ros.lockstep.page import Page, alive
from screw_module_ros.plant import plane_plant
from screw_module_ros.plant.world import ArmSettings, World, load_world
from screw_module_ros.rig.rig import ALL, Rig, RigSettings
from screw_module_ros.rig.rig_hub import RigHub
from screw_module_ros.settings import Setting
from screw_module_ros.therapy.hand import point_of

from .simulated_patient import SimulatedPatient
from .support.answering import Done
from .support.node import Node
from .support.states import OK, WARN, Due, Health, at_base
from .support.topics import offered

_ANSWER_S = 1.0
_SLOW, _NO_LONGER_SLOW = 0.5, 0.6  # of real time, or of the speed that is asked for
_PATIENCE_NS = 4_000_000_000  # ros2 launch sends SIGTERM after 5 s
_SILENT_NS = 300_000_000  # time without a frame after which no node is left
_WALL = WallClock()
_CLOCK_RATE = graph.TOPICS[graph.CLOCK].rate


class SimulationSettings(NamedTuple):
    """The simulated plant and its time."""

    plant_file: Annotated[str, Setting("YAML file of the plant, empty for the packaged one")] = ""
    seed: Annotated[int, Setting("seed of the noise", "", 0, 2**31 - 1)] = 0
    perturb_seed: Annotated[
        int, Setting("seed of a random change of the plant's values, -1 = none", "", -1, 2**31 - 1)
    ] = -1
    period: Annotated[
        float, Setting("largest step of simulated time; nodes may request smaller ones", "s",
                       1e-4, 0.01)
    ] = 0.001
    speed: Annotated[
        float, Setting("simulated seconds per second at most, 0 = no limit", "", 0.0, 1e3,
                       live=True)
    ] = 1.0
    patient: Annotated[
        str, Setting("who holds the handle: he follows what the robot is asked for; empty: the arm "
                     "of the plant file", choices=("", *graph.PATIENTS))
    ] = ""
    plane_plant: Annotated[
        str, Setting("planar arm of another package, package.module:NAME or an entry point of "
                     f"{plane_plant.GROUP}; empty: the plant file's", at_start=True)
    ] = ""
    truth_rate: Annotated[
        float, Setting(f"{graph.TRUTH} messages per second", "Hz", 1.0, 500.0)
    ] = graph.TOPICS[graph.TRUTH].rate


class Slowness:
    """Tells once that simulated time runs slowly, and once that it no longer does."""

    def __init__(self) -> None:
        self._slow = False

    def told(self, factor: float, speed: float) -> str:
        """Return a sentence when that has changed, else nothing.

        factor: simulated seconds per second of wall clock, 0 = not known yet; speed: the factor
        that is asked for, 0 = as fast as it goes.
        """
        least = (_NO_LONGER_SLOW if self._slow else _SLOW) * (min(speed, 1.0) or 1.0)
        if factor == 0.0 or self._slow == (factor < least):
            return ""
        self._slow = not self._slow
        if not self._slow:
            return f"simulated time keeps up again: {factor:.2f} of real time"
        return (
            f"simulated time runs at {factor:.2f} of real time: this machine is slow or busy; "
            "nothing is lost, everything only takes longer"
        )


class Departure:
    """Decides whether the rig may end: after the nodes that need its devices for a clean exit.

    Ctrl-C reaches all processes of `ros2 launch` at once. A rig that ends first acts like a power
    failure: nodes cannot disable their drives, simulated time stops, and both cause warnings. The
    wait begins with the first look.
    """

    def __init__(self, page: Page | None):
        """Start with the page of simulated time, None by wall clock."""
        self._page = page
        self._until_ns: int | None = None
        self._frames = -1
        self._changed_ns = 0

    @property
    def is_late(self) -> bool:
        """Whether the rig has waited for long enough."""
        now_ns = _WALL.now_ns()
        if self._until_ns is None:
            self._until_ns = now_ns + _PATIENCE_NS
        return now_ns >= self._until_ns

    def is_due(self, frames: int) -> bool:
        """Return whether no node needs the devices any more; frames: number received so far."""
        if self.is_late:
            return True
        now_ns = _WALL.now_ns()
        if self._page is not None:
            others = any(pid != os.getpid() and alive(pid) for pid, _ in self._page.buses())
            frames = now_ns if others else -1  # time may stand between two frames
        if frames != self._frames:
            self._frames, self._changed_ns = frames, now_ns
        return now_ns - self._changed_ns >= _SILENT_NS


class SimRigNode(Node):
    """Owns the plant and the simulated devices of all buses."""

    hardware_id = "simulated"
    moves_time = True

    def __init__(self) -> None:
        super().__init__("sim_rig")
        self.parameters.declare(SimulationSettings, devices=RigSettings)
        for bus in graph.BUSES:
            self.parameters.declare_with(BusSettings, f"{bus.name}.can", channel=bus.name)
        self._buses: dict[BusSettings, can.BusABC] = {}
        self._slipped = 0
        self._has_told_of_loss = False
        self._truth = at_base(SimTruth)
        simulated = self.clock if isinstance(self.clock, SimulatedClock) else None
        self._page = simulated.page if simulated else None
        self._rounds = simulated.rounds if simulated else None
        self._time: Conductor | None = None
        self._departure = Departure(self._page)
        self._slowness = Slowness()
        self._clock_message = ClockMessage()
        self.serve(SetArm, "~/set_arm", self._set_arm, "arm set")
        self.serve(SetFixture, "~/set_fixture", self._set_fixture, "fixture set")
        self.serve(InjectFault, "~/inject_fault", self._inject)

    def connect(self) -> None:
        """Load the plant and open the buses."""
        settings = self.parameters.read(SimulationSettings)
        perturb = settings.perturb_seed if settings.perturb_seed >= 0 else None
        self._world = World(
            load_world(settings.plant_file or None, perturb), settings.seed,
            plane=plane_plant.load(settings.plane_plant),
        )  # fmt: skip
        if settings.patient:
            self._world.set_arm(ArmSettings(patient=settings.patient))
        by_name = {bus.name: self._open(self.parameters.read(BusSettings, f"{bus.name}.can"))
                   for bus in graph.BUSES}
        self._rig = Rig(
            by_name,
            self._world,
            self.clock,
            round(settings.period * 1e9),
            self.parameters.read(RigSettings, "devices"),
        )
        self.opened.callback(self._rig.close)
        patient = SimulatedPatient(
            self, lambda: self._world.arm, lambda to: self._call(lambda: self._world.set_arm(to))
        )
        self.opened.callback(patient.close)
        self._publish = self.outlet(*offered(graph.TRUTH))
        self._truth_due, self._clock_due = Due(settings.truth_rate), Due(_CLOCK_RATE)
        if self._page is not None:
            self._publish_clock = self.outlet(*offered(graph.CLOCK))
            self._time = Conductor(self._page, settings.speed, self.get_logger().warning)
            self.opened.callback(self._time.close)
            self._lead(self._time)

    def _open(self, settings: BusSettings) -> can.BusABC:
        settings = within(settings, self.get_namespace())
        if settings not in self._buses:
            self.opened.callback(lock_simulation(where(settings)).release)
            self._buses[settings] = open_bus(settings, self.clock, self._new_hub)
            self.opened.callback(self._buses[settings].shutdown)
        return self._buses[settings]

    def _new_hub(self, channel: str) -> RigHub:
        """Return the rig's end of a bus, which the nodes of this process join by calls."""
        hub = RigHub(channel)
        if isinstance(buses := self.clock.buses, dict):
            buses[channel] = hub
            self.opened.callback(lambda: buses.pop(channel))
        return hub

    def _lead(self, conductor: Conductor) -> None:
        """Move the time for the waits of this process's main thread."""
        rig, rounds = self._rig, self._rounds
        if rounds is None:
            return
        rounds.serve = rig.serve_expected
        rounds.turn = partial(rig.turn, conductor, self._publish_due, rounds)
        self.opened.callback(rounds.stand_still)

    def changed(self, kind: type) -> None:
        """Apply a new speed."""
        if kind is SimulationSettings and self._time is not None:
            self._time.speed = self.parameters.read(kind).speed

    def disconnect(self) -> None:
        """Close the buses."""
        self._buses, self._time = {}, None
        super().disconnect()

    def step(self) -> None:
        """Serve the buses until the node is deactivated or stopped."""
        if self._time is not None:
            self._rig.run_in_steps(self._time, self._is_over, self._publish_due, self._rounds)
        else:
            self._rig.run(self._look_up)

    def _is_over(self) -> bool:
        if not self.active:
            return True
        if not self.stopping.is_set():
            return False
        if self._rounds is not None:  # until then it serves what they do at their end
            return self._rounds.ended or self._departure.is_late
        return self._departure.is_due(self._rig.counters["frames_in"])

    def _look_up(self) -> bool:
        """Publish what is due, between two frames; return whether to stop serving."""
        self._publish_due(self.clock.now_ns())
        return self._is_over()

    def _publish_due(self, now_ns: int) -> None:
        if self.periodic.is_due():
            self.service.wake()
        if self._truth_due(now_ns):
            self._publish_truth()
        if self._time is not None and self._clock_due(now_ns):
            now = self._clock_message.clock
            now.sec, now.nanosec = divmod(now_ns, 1_000_000_000)
            self._publish_clock(self._clock_message)

    def _publish_truth(self) -> None:
        message = self._truth
        self.stamp(message.header)
        for name, value in self._world.truth()._asdict().items():
            setattr(message, name, list(value) if isinstance(value, tuple) else value)
        message.slipped = self._rig.physics.slipped
        self._publish(message)

    # Services: the rig's own thread carries out their changes between two frames -------------

    def _set_arm(self, request: SetArm.Request) -> str:
        return self._changed(lambda: self._world.set_arm(ArmSettings(
            request.kind,
            request.mass,
            request.stiffness,
            request.damping,
            point_of(request.target),
            request.duration,
            point_of(request.amplitude),
            point_of(request.omega),
            tuple(request.traits),
            tuple(request.values),
            request.patient,
        )))

    def _set_fixture(self, request: SetFixture.Request) -> str:
        return self._changed(lambda: self._world.set_fixture(
            request.fixture, request.speed, request.position, request.upside_down, request.locked
        ))

    def _inject(self, request: InjectFault.Request) -> str:
        return Done(self._rig.inject(
            request.device or ALL, request.fault, request.value, request.duration,
            self.clock.now_ns(),
        ))

    def _changed(self, change: Callable[[], None]) -> str:
        """Let the rig's thread carry out a change; return the error, empty if done."""
        answer: queue.SimpleQueue[str] = queue.SimpleQueue()

        def carry_out() -> None:
            try:
                change()
                answer.put("")
            except ValueError as error:
                answer.put(str(error))

        self._call(carry_out)
        try:
            return answer.get(timeout=_ANSWER_S)
        except queue.Empty:
            return "the rig is not running: activate the node"

    def _call(self, change: Callable[[], None]) -> None:
        """Let the rig's thread carry out a change, also while time stands still."""
        self._rig.call(change)
        if self._page is not None:
            self._page.wake_conductor()

    def health(self) -> Health:
        """Frames, slips."""
        counters = self._rig.counters
        if counters["lost"] and not self._has_told_of_loss:
            self._has_told_of_loss = True
            self.get_logger().warning("a process that reads no frames of its bus loses them")
        if self._time is not None and self._page is not None:
            factor = self._page.factor
            if told := self._slowness.told(factor, self._time.speed):
                self.get_logger().info(told)
            counters["real-time factor"] = f"{factor:.2f}"
            counters["given up"] = self._time.given_up
            return Health(OK, f"simulating, real-time factor {factor:.2f}", counters)
        slipped = counters["slipped"] - self._slipped
        self._slipped = counters["slipped"]
        if slipped:
            return Health(WARN, f"{slipped} periods of simulated time given up", counters)
        return Health(OK, "simulating", counters)
