# SPDX-License-Identifier: Apache-2.0
"""`sim_rig`: everything physical, simulated behind the same CAN frames as the hardware.

It meets the rest of the graph on the CAN bus only; `sim/truth` is for tests and figures.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from typing import Annotated, NamedTuple

import can
from screw_module_msgs.msg import SimTruth
from screw_module_msgs.srv import InjectFault, SetArm, SetFixture

from screw_module_ros.devices.bus import BusSettings, open_bus
from screw_module_ros.plant.world import ArmSettings, World, load_world
from screw_module_ros.rig.rig import ALL, BUSES, Rig, RigSettings
from screw_module_ros.settings import Setting

from .support import qos
from .support.module_node import OK, WARN, Health, ModuleNode
from .support.runtime import main as run_node

_ANSWER_S = 1.0


class SimulationSettings(NamedTuple):
    """What is simulated and how time passes in it."""

    plant_file: Annotated[str, Setting("YAML file of the plant, empty for the packaged one")] = ""
    seed: Annotated[int, Setting("seed of the noise", "", 0, 2**31 - 1)] = 0
    perturb_seed: Annotated[
        int, Setting("seed that perturbs the plant's values, -1 for none", "", -1, 2**31 - 1)
    ] = -1
    clock: Annotated[
        str,
        Setting("what advances the physics: wall clock, or one period per SYNC",
                choices=("wall", "sync")),
    ] = "wall"
    period: Annotated[float, Setting("period per SYNC in clock sync", "s", 1e-4, 0.1)] = 0.001
    truth_rate: Annotated[float, Setting("sim/truth messages per second", "Hz", 1.0, 500.0)] = 100.0


class SimRigNode(ModuleNode):
    """Owns the plant and the far ends of all buses."""

    hardware_id = "simulated"

    def __init__(self):
        super().__init__("sim_rig")
        self.parameters.declare(SimulationSettings)
        self.parameters.declare(RigSettings, "devices")
        for index, bus in enumerate(BUSES):
            self.parameters.declare(BusSettings, f"{bus}.can", port=43113 + index)
        self._rig: Rig | None = None
        self._buses: dict[BusSettings, can.BusABC] = {}
        self._slipped = 0
        self._truth = SimTruth()
        self._truth.header.frame_id = "manus_base"

    def connect(self) -> None:
        """Load the plant and open the buses."""
        settings = self.parameters.read(SimulationSettings)
        perturb = settings.perturb_seed if settings.perturb_seed >= 0 else None
        self._world = World(load_world(settings.plant_file or None, perturb), settings.seed)
        by_name = {name: self._open(self.parameters.read(BusSettings, f"{name}.can"))
                   for name in BUSES}
        self._rig = Rig(
            by_name,
            self._world,
            settings.clock,
            round(settings.period * 1e9),
            self.parameters.read(RigSettings, "devices"),
        )
        self._publisher = self.create_publisher(SimTruth, "sim/truth", qos.STATE)
        self._truth_period_ns = round(1e9 / settings.truth_rate)
        self._truth_due_ns = 0
        self._rig_services = [
            self.create_service(SetArm, "~/set_arm", self._set_arm),
            self.create_service(SetFixture, "~/set_fixture", self._set_fixture),
            self.create_service(InjectFault, "~/inject_fault", self._inject),
        ]

    def _open(self, settings: BusSettings) -> can.BusABC:
        if settings not in self._buses:
            self._buses[settings] = open_bus(settings)
        return self._buses[settings]

    def disconnect(self) -> None:
        """Close the buses."""
        if self._rig is not None:
            self._rig.close()
            self.destroy_publisher(self._publisher)
            for service in self._rig_services:
                self.destroy_service(service)
            self._rig = None
        for bus in self._buses.values():
            bus.shutdown()
        self._buses = {}

    def step(self) -> None:
        """Serve the buses until the node is deactivated or stopped."""
        self._rig.run(self._look_up)

    def _look_up(self) -> bool:
        """Between two frames: publish sim/truth when due; return whether to stop serving."""
        if time.monotonic_ns() >= self._truth_due_ns:
            self._truth_due_ns = time.monotonic_ns() + self._truth_period_ns
            self._publish_truth()
        return self.stopping.is_set() or not self.active

    def _publish_truth(self) -> None:
        message = self._truth
        message.header.stamp = self.get_clock().now().to_msg()
        for name, value in self._world.truth()._asdict().items():
            setattr(message, name, list(value) if isinstance(value, tuple) else value)
        message.slipped = self._rig.counters.slipped
        self._publisher.publish(message)

    # Services: what they change, the rig's own thread changes between two frames -------------

    def _set_arm(self, request: SetArm.Request, response: SetArm.Response) -> SetArm.Response:
        return self._asked(response, lambda: self._world.set_arm(ArmSettings(
            request.kind,
            request.mass,
            request.stiffness,
            request.damping,
            _xyz(request.target),
            request.duration,
            _xyz(request.amplitude),
            _xyz(request.omega),
        )), "arm set")

    def _set_fixture(
        self, request: SetFixture.Request, response: SetFixture.Response
    ) -> SetFixture.Response:
        return self._asked(response, lambda: self._world.set_fixture(
            request.fixture, request.speed, request.position, request.upside_down, request.locked
        ), "fixture set")

    def _inject(
        self, request: InjectFault.Request, response: InjectFault.Response
    ) -> InjectFault.Response:
        try:
            response.message = self._rig.inject(
                request.device or ALL, request.fault, request.value, request.duration,
                time.monotonic_ns(),
            )
            response.success = True
        except ValueError as error:
            response.message = str(error)
        return response

    def _asked(self, response, change: Callable[[], None], done: str):
        answer: queue.SimpleQueue[str] = queue.SimpleQueue()

        def carry_out() -> None:
            try:
                change()
                answer.put("")
            except ValueError as error:
                answer.put(str(error))

        self._rig.call(carry_out)
        try:
            problem = answer.get(timeout=_ANSWER_S)
        except queue.Empty:
            problem = "the rig is not running: activate the node"
        response.success, response.message = not problem, problem or done
        return response

    def health(self) -> Health:
        """Frames, slips."""
        counters = self._rig.counters._asdict()
        slipped = counters["slipped"] - self._slipped
        self._slipped = counters["slipped"]
        if slipped:
            return Health(WARN, f"{slipped} periods of simulated time given up", counters)
        return Health(OK, "simulating", counters)


def _xyz(vector) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def main() -> int:
    """Console entry point."""
    return run_node(SimRigNode)


if __name__ == "__main__":
    raise SystemExit(main())
