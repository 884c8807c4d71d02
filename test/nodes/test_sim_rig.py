# SPDX-License-Identifier: Apache-2.0
"""`sim_rig`: it ends after those who need its devices, and says when a machine is too slow."""

from __future__ import annotations

import os
import signal
from types import SimpleNamespace

import pytest

from screw_module_ros.clock import ManualClock, WallClock
from screw_module_ros.nodes import sim_rig
from screw_module_ros.nodes.sim_rig import Departure, Slowness
from screw_module_ros.operator.robot import Robot
from screw_module_ros.trials.runner import GraphRun

STEP_NS = 50_000_000


@pytest.fixture
def wall(monkeypatch):
    """Return the wall clock, moved by hand."""
    clock = ManualClock(1)
    monkeypatch.setattr(sim_rig, "_WALL", clock)
    return clock


def left_after(wall, due) -> float:
    """Return after how many seconds it is due."""
    begun = wall.time_ns
    while not due((wall.time_ns - begun) * 1e-9):
        wall.time_ns += STEP_NS
        assert wall.time_ns - begun < 10_000_000_000
    return (wall.time_ns - begun) * 1e-9


def test_by_wall_clock_it_goes_when_the_buses_are_silent(wall):
    one = Departure(None)
    assert left_after(wall, lambda t: one.is_due(int(min(t, 1.0) * 1000))) == pytest.approx(1.3)


def test_it_does_not_wait_for_ever(wall):
    one = Departure(None)
    assert left_after(wall, lambda t: one.is_due(int(t * 1000))) == pytest.approx(4.0)


def test_in_simulated_time_it_goes_when_the_other_buses_are_closed(wall):
    users = [(os.getpid(), 5), (os.getppid(), 5)]
    one = Departure(SimpleNamespace(buses=lambda: users))

    def due(seconds: float) -> bool:
        if seconds > 1.0:
            del users[1:]
        return one.is_due(5)

    assert left_after(wall, due) == pytest.approx(1.35, abs=0.06)


@pytest.mark.long
@pytest.mark.graph
@pytest.mark.parametrize("clock", ["rig", "wall"])
def test_ctrl_c_reaches_all_at_once_and_nobody_complains(capfd, wait_until, clock):
    """As under `ros2 launch`: SIGINT for every process in one moment.

    The rig stays for 4 s at most: who needs its devices longer, on a machine that starves it, may
    complain, but ends in order all the same.
    """
    with GraphRun(wall_clock=clock == "wall") as graph:
        with Robot("tester", watch=graph.watch) as robot:
            graph.wait_until_ready(robot)
        capfd.readouterr()
        others, wall = [name for name in graph.pids if name != "sim_rig"], WallClock()
        stays_until_ns = wall.now_ns() + sim_rig._PATIENCE_NS - STEP_NS
        for name in graph.pids:
            graph.signal(name, signal.SIGINT)
        for name in others:
            wait_until(lambda name=name: graph.exit_code(name) is not None, 30.0, f"{name}'s end")
        in_time = wall.now_ns() < stays_until_ns
        wait_until(lambda: graph.exit_code("sim_rig") is not None, 30.0, "the rig's end")
        ended = {name: graph.exit_code(name) for name in graph.pids}
        assert ended == dict.fromkeys(graph.pids, 0)
        told = capfd.readouterr()
    complaints = [line for line in (told.out + told.err).splitlines()
                  if "[WARN]" in line or "[ERROR]" in line]  # fmt: skip
    assert complaints == [] or not in_time


def sentences(factors, speed=1.0):
    slowness = Slowness()
    return [told.split(":")[0] for factor in factors if (told := slowness.told(factor, speed))]


def test_each_change_is_told_once():
    assert sentences([0.0, 0.9, 0.4, 0.3, 0.55, 0.3, 0.7, 0.9, 0.52, 0.45]) == [
        "simulated time runs at 0.40 of real time",
        "simulated time keeps up again",
        "simulated time runs at 0.45 of real time",
    ]


def test_who_asked_for_slow_motion_is_not_told():
    assert sentences([0.04, 0.05], speed=0.05) == []
    assert len(sentences([0.02], speed=0.05)) == 1


def test_as_fast_as_it_goes_is_compared_with_real_time():
    assert len(sentences([0.4], speed=0.0)) == 1
    assert sentences([3.0], speed=0.0) == []
