# SPDX-License-Identifier: Apache-2.0
"""`module`: the vertical axis in one process: encoder, force sensor, controller and amplifier.

::

    tick -> SYNC and poll -> readings -> controller -> torque to the drive -> publish

The four nodes are the same as those of the separate executables, names, topics, services,
parameters and diagnostics included; each is served by a thread of its own. Only the way from one to
the next is another: a call in one hot loop in place of a topic. What they publish goes out after
the torque.
"""

from __future__ import annotations

from typing import NamedTuple

from rcl_interfaces.msg import SetParametersResult

from screw_module_ros.clock import TimeStandsStill
from screw_module_ros.control.vertical import VerticalOutput
from screw_module_ros.samples import EncoderReading, ForceReading

from .amplifier import AmplifierNode
from .encoder import EncoderNode
from .force_sensor import ForceSensorNode
from .impedance_controller import ImpedanceControllerNode
from .support.driver import RateSettings, period_of
from .support.module_node import ModuleNode
from .support.pace import Pace
from .support.parameters import ParameterError
from .support.realtime import Tick, Ticker
from .support.runtime import run_together

_LOOK_NS = 10_000  # for what lies in the socket already
_IDLE_S = 0.05
_BY_CALLS = ("screw/encoder", "handle/force", "screw/amplifier_state")


class Parts(NamedTuple):
    """The nodes that take part in a period; one that is not active is None."""

    encoder: EncoderNode | None
    force_sensor: ForceSensorNode | None
    controller: ImpedanceControllerNode | None
    amplifier: AmplifierNode | None


class ModuleLoop:
    """The hot loop of the four nodes."""

    def __init__(self, nodes: list[ModuleNode]):
        self._nodes = nodes
        self._stopping = nodes[0].stopping
        period_ns = period_of(nodes[0].parameters.read(RateSettings).rate)
        self._clock = nodes[0].clock
        self._ticker = Ticker(self._clock, period_ns)
        self._force_pace = Pace(period_ns)

    def run(self) -> None:
        """Run until the nodes are to stop."""
        try:
            while not self._stopping.is_set():
                active = [node if node.takes_part() else None for node in self._nodes]
                if any(active):
                    self._one_period(Parts(*active))
                else:
                    self._clock.idle()
                    self._stopping.wait(_IDLE_S)
        except TimeStandsStill as error:  # only raised here when the process is to end
            self._nodes[0].get_logger().warning(str(error))
        finally:
            for node in self._nodes:
                node.leaves()

    def _one_period(self, parts: Parts) -> None:
        if parts.controller is None and parts.amplifier is not None:
            self._listen(parts.amplifier)
        tick = self._ticker.sleep()
        due_ns = self._ticker.due_ns()
        self._ask(parts, tick)
        sample, force = self._answers(parts, due_ns)
        now = self._clock.now_ns()
        output = self._act(parts, sample, force, now)
        # The torque is out; what follows only tells of it and looks after the drive.
        self._publish(parts, sample, force, output)
        self._look_after(parts, tick, now)
        if force is None and parts.force_sensor is not None:
            self._take_late_force(parts, due_ns)

    def _listen(self, amplifier: AmplifierNode) -> None:
        """Let another process command the amplifier while there is no controller here."""
        while (due_ns := self._ticker.due_ns()) > self._clock.now_ns():
            amplifier.listen(due_ns)

    def _ask(self, parts: Parts, tick: Tick) -> None:
        for sensor in (parts.encoder, parts.force_sensor):
            if sensor is not None:
                sensor.skipped += tick.skipped
                sensor.ask(sensor.device, tick)
        if parts.amplifier is not None:
            parts.amplifier.begin_tick(tick)

    def _answers(
        self, parts: Parts, due_ns: int
    ) -> tuple[EncoderReading | None, ForceReading | None]:
        """Return what encoder and force sensor answered; for the latter the wait is short."""
        sample = force = None
        if parts.encoder is not None:
            sample = parts.encoder.answer(parts.encoder.device, due_ns)
        if parts.force_sensor is not None:
            worth = self._force_pace.worth_waiting()
            wait_ns = self._force_pace.wait_ns if worth else _LOOK_NS
            until_ns = min(due_ns, self._clock.now_ns() + wait_ns)
            force = parts.force_sensor.answer(parts.force_sensor.device, until_ns)
            self._force_pace.came(force is not None)
        return sample, force

    def _act(
        self, parts: Parts, sample: EncoderReading | None, force: ForceReading | None, now: int
    ) -> VerticalOutput | None:
        """Turn the samples into torque; return the controller's output, None without one.

        Without a sample to act upon that is the zero in place of the last force, once.
        """
        controller = parts.controller
        if controller is None:
            return None
        if force is not None:
            controller.feel(force, now)
        output = controller.respond(sample, now) if sample is not None else None
        responded = output is not None
        if not responded:
            output = controller.idle(now)
        if output is not None and parts.amplifier is not None:
            behind = controller.answered
            parts.amplifier.act(behind.sequence, behind.monotonic_ns, output.force, now)
        if responded:
            controller.count()
        return output

    def _publish(
        self,
        parts: Parts,
        sample: EncoderReading | None,
        force: ForceReading | None,
        output: VerticalOutput | None,
    ) -> None:
        if sample is not None:
            parts.encoder.publish(sample)
        if force is not None:
            parts.force_sensor.publish(force)
        if output is not None:
            parts.controller.tell(output)

    def _look_after(self, parts: Parts, tick: Tick, now: int) -> None:
        controller = parts.controller
        state = parts.amplifier.end_tick(tick) if parts.amplifier is not None else None
        if controller is None:
            return
        if state is not None:
            controller.hear_amplifier(state, now)
        controller.follow(now)

    def _take_late_force(self, parts: Parts, due_ns: int) -> None:
        force = parts.force_sensor.answer(parts.force_sensor.device, due_ns)
        if force is None:
            return
        if parts.controller is not None:
            parts.controller.feel(force, self._clock.now_ns())
        parts.force_sensor.publish(force)


def make_nodes() -> list[ModuleNode]:
    """Return the four nodes. Raises ParameterError when their rates are not one rate."""
    controller = ImpedanceControllerNode()
    controller.direct = _BY_CALLS
    nodes = [EncoderNode(), ForceSensorNode(), controller, AmplifierNode()]
    rates = {node.get_name(): node.parameters.read(RateSettings).rate for node in nodes}
    if len(set(rates.values())) > 1:
        told = ", ".join(f"{name}: {rate:g}" for name, rate in rates.items())
        raise ParameterError(f"one loop drives all nodes of `module`, their rates differ: {told}")
    for node in nodes:
        node.add_on_set_parameters_callback(_keep_rate)
    return nodes


def _keep_rate(parameters) -> SetParametersResult:
    if any(parameter.name == "rate" for parameter in parameters):
        reason = "rate is common to the nodes of `module`: give it when the process is started"
        return SetParametersResult(successful=False, reason=reason)
    return SetParametersResult(successful=True)


def main() -> int:
    """Console entry point."""
    return run_together("module", make_nodes, lambda nodes: ModuleLoop(nodes).run())


if __name__ == "__main__":
    raise SystemExit(main())
