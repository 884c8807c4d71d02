# SPDX-License-Identifier: Apache-2.0
"""`module`: the vertical axis in one process: encoder, force sensor, controller and amplifier.

::

    tick -> SYNC and poll -> readings -> controller -> torque to the drive -> publish

The four nodes are those of the separate executables, with the same names, topics, services,
parameters and diagnostics; each has its own service thread. Only the connection between them
differs: a call in one hot loop replaces the topic. The loop publishes after it has written the
torque.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from screw_module_ros import graph
from screw_module_ros.loop.ticker import period_of
from screw_module_ros.loop.vertical import Roles, VerticalLoop, Wires
from screw_module_ros.settings import SettingError

from .amplifier import AmplifierNode
from .encoder import EncoderNode
from .force_sensor import ForceSensorNode
from .impedance_controller import ImpedanceControllerNode
from .support.driver import RateSettings
from .support.node import Node
from .support.runtime import run_together
from .support.threads import run_loop

_BY_CALLS = (graph.ENCODER, graph.FORCE, graph.AMPLIFIER_STATE)


def chain_of(nodes: list[Any]) -> Callable[[list[Node]], None]:
    """Return the step of encoder, force sensor, controller and amplifier, for the active ones."""
    encoder, force_sensor, controller, amplifier = nodes
    wires = Wires(
        take_command=amplifier.take_command,
        publish_sample=encoder.publish,
        publish_force=force_sensor.publish,
        publish_command=controller.publish_command,
        read_inputs=controller.read_inputs,
        permission=amplifier.permission,
        publish_controller_state=controller.publish_state,
        publish_drive_state=amplifier.publish_state,
    )
    period_ns = period_of(encoder.parameters.read(RateSettings).rate)
    loop = VerticalLoop(encoder.clock, period_ns, wires)

    def step(active: list[Node]) -> None:
        loop.step(Roles(*[node.role if node in active else None for node in nodes]))

    return step


def make_nodes() -> list[Node]:
    """Return the four nodes. Raises SettingError when their rates are not one rate."""
    controller = ImpedanceControllerNode()
    controller.direct = _BY_CALLS
    nodes = [EncoderNode(), ForceSensorNode(), controller, AmplifierNode()]
    rates = {node.get_name(): node.parameters.read(RateSettings).rate for node in nodes}
    if len(set(rates.values())) > 1:
        listed = ", ".join(f"{name}: {rate:g}" for name, rate in rates.items())
        raise SettingError(f"one loop drives all nodes of `module`, their rates differ: {listed}")
    for node in nodes:
        node.add_on_set_parameters_callback(_keep_rate)
    return nodes


def _keep_rate(parameters: list[Parameter]) -> SetParametersResult:
    if any(parameter.name == "rate" for parameter in parameters):
        reason = "rate is common to the nodes of `module`: give it when the process is started"
        return SetParametersResult(successful=False, reason=reason)
    return SetParametersResult(successful=True)


def main() -> int:
    """Console entry point."""
    return run_together("module", make_nodes, lambda nodes: run_loop(nodes, chain_of(nodes)))
