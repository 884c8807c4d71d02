# SPDX-License-Identifier: Apache-2.0
"""Every node class while it is active: its diagnostics, and what it does now and then."""

from __future__ import annotations

import functools
import os

import pytest
from ati_board import AtiBoard
from far_end import LOCAL_NODE, far_end

from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.encoder import Encoder
from screw_module_ros.devices.netcanoem import NetcanoemSensor
from screw_module_ros.graph import BESIDE, table
from screw_module_ros.nodes.support.states import ERROR, OK, WARN
from screw_module_ros.nodes.support.threads import Timers

NODES = sorted(entry.executable for entry in table())
STEPS = 3
ENDLESS = ("sim_rig",)  # one step of its loop lasts until it is deactivated
SHOULDER, ELBOW = 3, 4
# Beside the diagnostics, which every node publishes each second.
PERIODIC = {
    "amplifier": ["_poll_slow"],
    "encoder": ["_poll_slow"],
    "force_sensor": ["_poll_slow"],
    "impedance_controller": ["_end_lease"],
    "manus": ["_poll_slow"],
    "session_recorder": ["_each_second"],
    "supervisor": ["tell"],
}


@pytest.fixture
def devices():
    """Return a maker of the devices of a node; it returns the node's arguments."""
    channel, made = f"active_nodes_{os.getpid()}", []  # devices are locked for a process

    def make(name: str) -> list[str]:
        if name == "force_sensor":
            made.append(AtiBoard(channel))
        elif name == "manus":
            made.extend(
                far_end(LOCAL_NODE, channel, "generic_402", node) for node in (SHOULDER, ELBOW)
            )
        elif name in ("amplifier", "encoder"):
            kind = "generic_402" if name == "amplifier" else "generic_406"
            made.append(far_end(LOCAL_NODE, channel, kind))
        else:
            return []
        told = ["can.interface:=virtual", f"can.channel:={channel}"]
        if name == "manus":
            told += [f"{joint}.rated_torque:=0.42" for joint in ("shoulder", "elbow")]
        return [part for each in told for part in ("-p", each)]

    yield make
    for each in made:
        each.close()


@pytest.fixture
def timers(monkeypatch):
    """What nodes register to be called now and then."""
    registered = []
    every = Timers.every

    def noted(self, clock, period_s, call):
        registered.append(every(self, clock, period_s, call))
        return registered[-1]

    monkeypatch.setattr(Timers, "every", noted)
    return registered


@pytest.fixture
def polled(monkeypatch):
    """The devices whose slow values were read."""
    read = []
    for kind in (Encoder, NetcanoemSensor, Drive):

        def poll(self, original=kind.poll_slow):
            read.append(self)
            original(self)

        monkeypatch.setattr(kind, "poll_slow", functools.wraps(kind.poll_slow)(poll))
    return read


@pytest.mark.parametrize("name", [*NODES, *BESIDE])
def test_it_tells_its_health_and_makes_its_periodic_calls(
    make_node, devices, timers, polled, name
):
    node = make_node(name, *devices(name))
    node.trigger_configure()
    node.trigger_activate()
    try:
        assert node.active, node.failure
        for _ in range(0 if name in ENDLESS else STEPS):
            assert node.enters()
            node.step()
            node.leaves()
        health = node.health()
        assert health.level in (OK, WARN, ERROR) and health.message
        assert all(key and value is not None for key, value in health.values.items())
        own = [timer for timer in timers if getattr(timer.call, "__self__", None) is node]
        calls = sorted(timer.call.__name__ for timer in own)
        assert calls == sorted(["publish_health", *PERIODIC.get(name, [])])
        for timer in timers:
            timer.run()
        if "_poll_slow" in calls:
            assert polled == list(getattr(node, "drives", ()) or [node.device])
    finally:
        node.close()

