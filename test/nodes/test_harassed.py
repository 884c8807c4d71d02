# SPDX-License-Identifier: Apache-2.0
"""Two busy loops beside the graph, and processes stopped at random: slower, never wrong."""

from __future__ import annotations

import os
import random

import pytest
from screw_module_msgs.msg import AmplifierState, ForceCommand, PlanarState

import harass
from screw_module_ros.operator.robot import Robot
from screw_module_ros.trials.runner import GraphRun

pytestmark = [pytest.mark.graph, pytest.mark.long]

SECONDS = 2.0


def test_every_tick_is_answered_beside_busy_loops_and_stopped_processes():
    with GraphRun() as graph, Robot("harassed", watch=graph.watch, simulated=True) as robot:
        robot.wait_until_ready(graph.names)
        robot.clear_faults()
        robot.home()
        robot.set_mode(ForceCommand.FORCE_FEEDBACK)
        robot.permit()
        robot.enable()
        robot.enable_plane()
        with harass.harassing(os.getpid(), 2, 0.25, random.Random(1)) as stops:
            before = robot.newest(AmplifierState)
            robot.pause(SECONDS)
            after = robot.newest(AmplifierState)
            assert stops, "nobody was stopped"
        robot.check_enabled()
        assert after.commands - before.commands == pytest.approx(1000 * SECONDS, abs=20)
        assert (after.late, after.lost) == (before.late, before.lost)
        assert robot.newest(PlanarState).lost == 0
