# SPDX-License-Identifier: Apache-2.0
"""When a node configures and activates by itself: with its rig, and again after a refusal."""

from __future__ import annotations

import pytest

from screw_module_ros.clock import ManualClock
from screw_module_ros.lockstep.conductor import Conductor
from screw_module_ros.nodes.support.node import ACTIVE, UNCONFIGURED
from screw_module_ros.nodes.support.runtime import autostart

MS = 1_000_000


class Wall(ManualClock):
    """Wall clock of a test."""

    simulated = False


@pytest.fixture
def wall():
    return Wall()


def passes(wall: Wall, node, milliseconds: int) -> None:
    """Let the node's service thread make what calls are due while time passes."""
    for _ in range(milliseconds // 10):
        wall.time_ns += 10 * MS
        node.periodic.run()


def test_who_came_before_the_rig_starts_with_it(make_node, wall, capfd):
    """Each node of a graph waited up to a second for a rig that was there."""
    node = make_node("endpoint_state", "-p", "use_sim_time:=true", "-r", "__ns:=/early")
    autostart(node, wall)
    passes(wall, node, 3000)
    assert node.phase == UNCONFIGURED and "waiting for sim_rig" in node.failure
    assert capfd.readouterr().err.count("waiting for sim_rig") == 1
    conductor = Conductor(node.clock.page, 0.0, pytest.fail)
    passes(wall, node, 50)
    conductor.close()
    assert node.phase == ACTIVE and not node.failure


def test_without_a_rig_by_wall_clock_it_starts_at_once(make_node, wall):
    node = make_node("endpoint_state", "-p", "use_sim_time:=false")
    autostart(node, wall)
    assert node.phase == ACTIVE


@pytest.mark.parametrize("what", ["connect", "begin"])
def test_what_was_refused_is_tried_again_each_second_and_told_once(make_node, wall, capfd, what):
    """What looks for the rig twenty times a second leaves a device that is missing alone."""
    node, tried = make_node("endpoint_state", "-p", "use_sim_time:=false"), []
    works = getattr(node, what)

    def refuse() -> None:
        tried.append(wall.now_ns())
        if len(tried) < 4:
            raise OSError("no such device")
        works()

    setattr(node, what, refuse)
    autostart(node, wall)
    passes(wall, node, 5000)
    assert tried == [0, 1000 * MS, 2000 * MS, 3000 * MS]
    assert node.phase == ACTIVE
    assert capfd.readouterr().err.count("no such device") == 1


def test_a_configure_that_lasts_is_not_begun_again(make_node, wall):
    """Opening a bus may wait for longer than a second, and calls are made meanwhile."""
    node, begun = make_node("endpoint_state", "-p", "use_sim_time:=false"), []
    connect = node.connect

    def last() -> None:
        begun.append(wall.now_ns())
        passes(wall, node, 2500)
        connect()

    node.connect = last
    autostart(node, wall)
    passes(wall, node, 2500)
    assert begun == [0] and node.phase == ACTIVE


def test_without_autostart_nothing_begins(make_node, wall):
    node = make_node("endpoint_state", "-p", "use_sim_time:=false", "-p", "autostart:=false")
    autostart(node, wall)
    passes(wall, node, 2000)
    assert node.phase == UNCONFIGURED
