# SPDX-License-Identifier: Apache-2.0
"""Nodes of the chain with different rates: no torque, and both rates are named."""

from __future__ import annotations

import pytest
from screw_module_msgs.msg import ImpedanceState, SafetyState

from screw_module_ros.operator.robot import Robot, RobotError
from screw_module_ros.trials.graph_run import GraphRun

pytestmark = [pytest.mark.graph, pytest.mark.long]

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
            with pytest.raises(RobotError, match=sentence):
                robot.trigger("supervisor/reset")
            with pytest.raises(RobotError, match=sentence):
                robot.enable()
