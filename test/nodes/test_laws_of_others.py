# SPDX-License-Identifier: Apache-2.0
"""A law of another package in the graph by wall clock: what is too slow, or exits, is no force."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from laws_of_others import ODD
from screw_module_msgs.msg import ImpedanceState

from screw_module_ros.operator.robot import Robot
from screw_module_ros.trials.runner import GraphRun

pytestmark = [pytest.mark.graph, pytest.mark.long]

CHAIN = ["sim_rig", "supervisor", "encoder", "force_sensor", "impedance_controller", "amplifier"]
LAWS = Path(__file__).parents[1] / "loop"
GIVEN = """impedance_controller:laws:=["laws_of_others:THE_ODD"]"""


def test_a_law_that_takes_too_long_or_would_end_the_process_is_told(monkeypatch):
    """Of the thread's own time: a full machine, which only makes it wait, is no fault of a law."""
    monkeypatch.setenv("PYTHONPATH", str(LAWS), prepend=os.pathsep)
    with GraphRun(only=CHAIN, extra=["-p", GIVEN], wall_clock=True) as graph:
        with Robot("tester", watch=graph.watch) as robot:
            graph.wait_until_ready(robot)
            robot.set_mode(ODD)
            robot.wait_until(
                lambda: (s := robot.state(ImpedanceState)) and s.law.startswith("odd "), 20.0,
                "the law does not run",
            )  # fmt: skip
            assert list(robot.newest(ImpedanceState).law_names) == ["ticks"]
            robot.set_parameter("impedance_controller", "odd.busy", 5.0)
            robot.wait_until(
                lambda: "of processor time for a step, more than 2 ms"
                in robot.newest(ImpedanceState).reason,
                20.0,
                "nobody says that the law takes too long",
            )
            assert robot.newest(ImpedanceState).commanded_force == 0.0
            robot.set_parameter("impedance_controller", "odd.busy", 0.0)
            robot.set_parameter("impedance_controller", "odd.exits", True)
            robot.wait_until(
                lambda: robot.newest(ImpedanceState).reason
                == "law odd: SystemExit: no such muscle ?",
                20.0, "nobody says that the law would end the process",
            )  # fmt: skip
            robot.set_parameter("impedance_controller", "odd.exits", False)
