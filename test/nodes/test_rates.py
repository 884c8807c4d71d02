# SPDX-License-Identifier: Apache-2.0
"""Nodes of the chain with different rates: no torque, and both rates are named."""

from __future__ import annotations

import pytest
from screw_module_msgs.msg import ImpedanceState, SafetyState

from screw_module_ros.operator.robot import Robot, RobotError
from screw_module_ros.trials.runner import GraphRun

pytestmark = pytest.mark.graph  # `make test` too: its one graph

CHAIN = ["sim_rig", "supervisor", "encoder", "force_sensor", "impedance_controller", "amplifier"]
NEEDED = "supervisor:required:=[encoder, force_sensor, impedance_controller, amplifier]"


def test_both_rates_are_named_and_nothing_is_enabled():
    extra = ["-p", NEEDED, "-p", "encoder:rate:=500.0"]
    with GraphRun(only=CHAIN, extra=extra) as graph:
        with Robot("tester", watch=graph.watch, simulated=True) as robot:
            graph.wait_until_ready(robot)
            robot.trigger("encoder/home")
            sentence = "encoder: ticks at 500 Hz by the numbers of its samples"
            robot.wait_until(
                lambda: (s := robot.state(ImpedanceState)) and s.reason.startswith(sentence),
                10.0,
                "the controller names no rates",
            )
            assert robot.state(ImpedanceState).commanded_force == 0.0
            robot.wait_until(
                lambda: sentence in "; ".join(robot.newest(SafetyState).reasons),
                10.0,
                "the supervisor names no rates",
            )
            # A reset clears what the controller latched; its next sample latches it again.
            robot.trigger("supervisor/reset")
            robot.wait_until(
                lambda: (safety := robot.newest(SafetyState)).resets == 1
                and safety.level == SafetyState.STOPPED
                and sentence in "; ".join(safety.reasons),
                10.0,
                "after a reset the supervisor names no rates",
            )
            # The amplifier may discover the supervisor only now; until then it refuses for that.
            robot.wait_until(
                lambda: sentence in refusal_to_enable(robot), 10.0, "enabling names no rates"
            )


def refusal_to_enable(robot: Robot) -> str:
    with pytest.raises(RobotError) as refused:
        robot.enable()
    return str(refused.value)
